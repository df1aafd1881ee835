"""Labelled pictures of one episode: rendered once, kept in a folder, read as needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np

from roadscope.benchmarks.cache import write_atomically
from roadscope.benchmarks.fingerprint import fingerprint, sensing_hash
from roadscope.benchmarks.metrics.image_labels import Labels, labels_of
from roadscope.benchmarks.parked import parked_boxes
from roadscope.benchmarks.train.recipe import DARK, FAULTS, WORST, Recipe
from roadscope.envs.sensors.faults import condition_name, faults_of
from roadscope.envs.sensors.rig import CameraMount, Rig

if TYPE_CHECKING:
    from roadscope.envs.sensors.sensing import Sensing

FOCALS_PX = (360.0, 840.0)
"""Between a wide camera's and half of a Bumblebee's."""
HEIGHTS_M = (1.2, 1.9)
PITCHES_RAD = (-0.03, 0.03)
USUAL = 0.5
"""Share of the episodes seen by the camera of the rig `wide` as it is."""


@dataclass(frozen=True, slots=True)
class View:
    """What decides every pixel of an episode's pictures.

    light: a name of `LIGHTS`. faults: one condition, such as `rain:2 + night:3`.
    focal_px, height_m, pitch_rad: of the camera; None, as the rig has it.
    images, every_s: how many pictures, and the time from one to the next.
    """

    scenario: str
    seed: int
    weather: str = "clear"
    images: int = 10
    every_s: float = 0.5
    focal_px: float | None = None
    height_m: float = 1.4
    pitch_rad: float = 0.0
    light: str = "day"
    faults: str = "clear"

    @property
    def name(self) -> str:
        """A name for files, another one whenever anything differs, code of sensors included."""
        key = fingerprint({"view": repr(self), "code": sensing_hash(self.scenario)})
        return f"{self.scenario}-{self.seed}-{key}"

    def sensing(self) -> Sensing:
        """Return what takes the pictures."""
        from roadscope.envs.sensors.sensing import Sensing

        light = None if self.light == "day" else self.light
        return Sensing(self.rig(), self.seed, weather=self.weather, light=light, faults=self.faults)

    def rig(self) -> Rig:
        """Return the rig that takes the pictures."""
        from roadscope.envs.imaging.pinhole import Pinhole, mounted
        from roadscope.envs.sensors.rigs import rig

        usual = rig("wide")
        assert usual.camera is not None
        if self.focal_px is None:
            return usual
        spec = replace(usual.camera.spec, pinhole=Pinhole.centred(640, 480, self.focal_px))
        pose = mounted(2.0, 0.0, self.height_m, pitch=self.pitch_rad)
        return replace(usual, camera=CameraMount(usual.camera.name, spec, pose))


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Pictures and what is in them.

    pixels: (K, H, W, 3) uint8. labels: K of them.
    """

    pixels: np.ndarray
    labels: tuple[Labels, ...]

    def __len__(self) -> int:
        return len(self.labels)


def drawn_views(recipe: Recipe, count: int, seeds: range, *, varied: bool = True) -> list[View]:
    """Draw episodes for a recipe; the same recipe and seeds give the same ones."""
    rng = np.random.default_rng([recipe.seed, seeds.start])
    # What is met on the way is drawn apart: without it, all else is drawn as ever.
    met = np.random.default_rng([recipe.seed, seeds.start, 1])
    numbers = np.sort(rng.choice(seeds, count, replace=False))
    views = []
    for i, number in enumerate(rng.permutation(numbers).tolist()):
        view = View(
            recipe.scenarios[i % len(recipe.scenarios)], number, str(rng.choice(recipe.weathers)),
            recipe.images, recipe.every_s,
        )  # fmt: skip
        focal, height, pitch, usual = rng.random(4)
        if varied and usual > USUAL:
            view = replace(
                view,
                focal_px=round(float(FOCALS_PX[0] * (FOCALS_PX[1] / FOCALS_PX[0]) ** focal), 1),
                height_m=round(_between(HEIGHTS_M, height), 2),
                pitch_rad=round(_between(PITCHES_RAD, pitch), 4),
            )
        views.append(_met(recipe, view, met))
    return views


def _met(recipe: Recipe, view: View, rng: np.random.Generator) -> View:
    """Draw light and faults of a view."""
    if recipe.conditions:
        return replace(view, faults=str(rng.choice(recipe.conditions)))
    chance, dark = rng.random(2)
    light = str(rng.choice(recipe.lights))
    kind = str(rng.choice(FAULTS))
    severity, night = (int(n) for n in rng.integers(1, WORST + 1, 2))
    if chance >= recipe.faulty:
        return replace(view, light=light)
    found = [f"{kind}:{severity}"]
    found += [f"night:{night}"] if dark < DARK and kind != "night" else []
    return replace(view, weather="clear", faults=condition_name(faults_of(found)))


def _between(bounds: tuple[float, float], share: float) -> float:
    return float(bounds[0] + share * (bounds[1] - bounds[0]))


def render(view: View) -> Pictures:
    """Record the traffic and take the pictures."""
    from roadscope.core.projection import Projection
    from roadscope.envs.sensors.sensing import world_of
    from roadscope.envs.traffic.scenarios import record

    sensing = view.sensing()
    rig = sensing.rig
    assert rig.camera is not None
    timeline = record(view.scenario, view.seed, (view.images + 0.5) * view.every_s)
    world = world_of(timeline, view.seed)
    pinhole = rig.camera.spec.pinhole
    projection = Projection.of(
        pinhole.intrinsics, rig.camera.ego_from_camera, pinhole.width, pinhole.height
    )
    step = round(view.every_s / rig.camera.spec.period_s)
    pixels, labels = [], []
    for k in range(view.images):
        frame, truth = sensing.sense_image(timeline, k * step)
        assert frame.camera is not None
        pixels.append(frame.camera.pixels)
        labels.append(labels_of(truth, parked_boxes(world, truth.world_from_ego, projection)))
    return Pictures(np.stack(pixels), tuple(labels))


def keep(view: View, folder: Path) -> str:
    """Render pictures unless the folder has them; return the hash of their pixels."""
    if (digest := kept(view, folder)) is not None:
        return digest
    made = render(view)
    digest = sha256(made.pixels.tobytes()).hexdigest()
    write_atomically(_pixels_path(view, folder), lambda path: _save(path, made.pixels))
    write_atomically(_labels_path(view, folder), lambda p: _save_labels(p, made.labels, digest))
    return digest


def kept(view: View, folder: Path) -> str | None:
    """Return the hash of the pixels of pictures in the folder; None if they need rendering.

    Files that were cut short or damaged do not count.
    """
    try:
        np.load(_pixels_path(view, folder), mmap_mode="r")
        with _labels_path(view, folder).open("rb") as file, np.load(file) as data:
            for name in (*Labels.names(), "ends"):
                _ = data[name]
            return str(data["digest"])
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None


def read(view: View, folder: Path) -> Pictures:
    """Read kept pictures; pixels stay on the disk until they are looked at.

    Who is lost in rain or fog is not asked for.
    """
    pixels = np.load(_pixels_path(view, folder), mmap_mode="r")
    with np.load(_labels_path(view, folder)) as data:
        rows = {name: data[name] for name in Labels.names()}
        ends = data["ends"]
    split = {name: np.split(values, ends[:-1]) for name, values in rows.items()}
    labels = (Labels(**{name: split[name][k] for name in rows}) for k in range(len(ends)))
    extinction = view.sensing().weather.extinction_per_m
    return Pictures(pixels, tuple(each.in_air(extinction) for each in labels))


def _pixels_path(view: View, folder: Path) -> Path:
    return folder / f"{view.name}.npy"


def _labels_path(view: View, folder: Path) -> Path:
    return folder / f"{view.name}.npz"


def _save(path: Path, pixels: np.ndarray) -> None:
    with path.open("wb") as file:
        np.save(file, pixels)


def _save_labels(path: Path, labels: Sequence[Labels], digest: str) -> None:
    columns = {n: np.concatenate([getattr(x, n) for x in labels]) for n in Labels.names()}
    with path.open("wb") as file:
        ends = np.cumsum([len(x) for x in labels])
        np.savez(file, allow_pickle=False, digest=np.array(digest), ends=ends, **columns)
