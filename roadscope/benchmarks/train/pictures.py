"""Labelled pictures of one episode: rendered once, stored in a folder, read as needed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from zipfile import BadZipFile

import numpy as np

from roadscope.benchmarks.cache import write_atomically
from roadscope.benchmarks.fingerprints import fingerprint, sensing_hash
from roadscope.benchmarks.metrics.image_labels import Labels, labels_of
from roadscope.benchmarks.parked import parked_boxes
from roadscope.envs.sensors.rig import CameraMount, Rig

if TYPE_CHECKING:
    from roadscope.envs.sensors.sensing import Sensing


class PixelSize(NamedTuple):
    """Rows and columns of a picture or of a crop, in the order of NumPy's axes."""

    height: int
    width: int


@dataclass(frozen=True, slots=True)
class PictureEpisode:
    """Settings that decide every pixel of an episode's pictures.

    light: a name of `LIGHTS`. faults: one condition, such as `rain:2 + night:3`.
    focal_px, height_m, pitch_rad: of the camera; without focal_px, the camera is that of the rig
        `wide`, and the other two have no effect.
    images: how many pictures. every_s: seconds from one picture to the next.
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
        """A name for files; it differs when any field or the code of the sensors differs."""
        key = fingerprint({"episode": repr(self), "code": sensing_hash(self.scenario)})
        return f"{self.scenario}-{self.seed}-{key}"

    def sensing(self) -> Sensing:
        """Return the sensing that takes the pictures."""
        from roadscope.envs.sensors.sensing import Sensing

        light = None if self.light == "day" else self.light
        return Sensing(self.rig(), self.seed, weather=self.weather, light=light, faults=self.faults)

    def rig(self) -> Rig:
        """Return the rig that takes the pictures."""
        from roadscope.envs.imaging.pinhole import Pinhole, mounted
        from roadscope.envs.sensors.rigs import rig

        wide = rig("wide")
        assert wide.camera is not None
        if self.focal_px is None:
            return wide
        spec = replace(wide.camera.spec, pinhole=Pinhole.centred(640, 480, self.focal_px))
        pose = mounted(2.0, 0.0, self.height_m, pitch=self.pitch_rad)
        return replace(wide, camera=CameraMount(wide.camera.name, spec, pose))


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Pictures of one episode and what is in them.

    pixels: (K, H, W, 3) uint8. labels: K of them.
    """

    pixels: np.ndarray
    labels: tuple[Labels, ...]

    def __len__(self) -> int:
        return len(self.labels)


def render(episode: PictureEpisode) -> Pictures:
    """Record the traffic of an episode and take its pictures."""
    from roadscope.benchmarks.images import projection_of
    from roadscope.envs.sensors.sensing import world_of
    from roadscope.envs.traffic.scenarios import record

    sensing = episode.sensing()
    rig = sensing.rig
    assert rig.camera is not None
    timeline = record(episode.scenario, episode.seed, (episode.images + 0.5) * episode.every_s)
    world = world_of(timeline, episode.seed)
    projection = projection_of(rig)
    step = round(episode.every_s / rig.camera.spec.period_s)
    pixels, labels = [], []
    for k in range(episode.images):
        frame, truth = sensing.sense_image(timeline, k * step)
        assert frame.camera is not None
        pixels.append(frame.camera.pixels)
        labels.append(labels_of(truth, parked_boxes(world, truth.world_from_ego, projection)))
    return Pictures(np.stack(pixels), tuple(labels))


# --------------------------------------------------------------------------------------------------
# The folder: pixels in an .npy, labels of all pictures in the .npz of the same name.


def store_pictures(episode: PictureEpisode, folder: Path) -> str:
    """Render an episode's pictures unless the folder has them; return the hash of their pixels."""
    if (digest := stored_hash(episode, folder)) is not None:
        return digest
    pictures = render(episode)
    digest = sha256(pictures.pixels.tobytes()).hexdigest()
    labels = {n: np.concatenate([getattr(x, n) for x in pictures.labels]) for n in Labels.names()}
    ends = np.cumsum([len(x) for x in pictures.labels])

    def save_pixels(path: Path) -> None:
        with path.open("wb") as file:
            np.save(file, pictures.pixels)

    def save_labels(path: Path) -> None:
        with path.open("wb") as file:
            np.savez(file, allow_pickle=False, digest=np.array(digest), ends=ends, **labels)

    write_atomically(folder / f"{episode.name}.npy", save_pixels)
    write_atomically(folder / f"{episode.name}.npz", save_labels)
    return digest


def stored_hash(episode: PictureEpisode, folder: Path) -> str | None:
    """Return the hash of the pixels that the folder has of an episode, None if it lacks them.

    Files that are incomplete or damaged do not count.
    """
    try:
        np.load(folder / f"{episode.name}.npy", mmap_mode="r")
        with (folder / f"{episode.name}.npz").open("rb") as file, np.load(file) as data:
            for name in (*Labels.names(), "ends"):
                _ = data[name]
            return str(data["digest"])
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None


def read_pictures(episode: PictureEpisode, folder: Path) -> Pictures:
    """Read stored pictures; pixels are mapped from the file, not loaded.

    Objects that rain or fog leaves too little contrast are labelled as hidden.
    """
    pixels = np.load(folder / f"{episode.name}.npy", mmap_mode="r")
    with np.load(folder / f"{episode.name}.npz") as data:
        rows = {name: data[name] for name in Labels.names()}
        ends = data["ends"]
    split = {name: np.split(values, ends[:-1]) for name, values in rows.items()}
    labels = (Labels(**{name: split[name][k] for name in rows}) for k in range(len(ends)))
    extinction = episode.sensing().weather.extinction_per_m
    return Pictures(pixels, tuple(each.in_air(extinction) for each in labels))
