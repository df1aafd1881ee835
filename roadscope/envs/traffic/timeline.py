"""The recorded motion of all road users, interpolated at any instant."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from roadscope.core import Pose, RecordError
from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record
from roadscope.envs.traffic.road_maps import RoadMap
from roadscope.envs.traffic.terrain import Terrain, axle_pose

FORMAT = "roadscope-timeline-1"


@dataclass(frozen=True, slots=True, eq=False)
class States(Record):
    """All actors at several instants, world frame.

    stamps_s: (T,) float64.
    present: (T, A) bool.
    axles: (T, A, 2) float64, metres, rear axle on the ground; where an actor is absent, its
        nearest recorded position.
    yaws: (T, A) float64, radians, continuous in time.
    velocities: (T, A, 2) float64, m/s, of the rear axle.
    """

    stamps_s: np.ndarray
    present: np.ndarray
    axles: np.ndarray
    yaws: np.ndarray
    velocities: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            stamps_s=(np.float64, ("T",)),
            present=(np.bool_, ("T", "A")),
            axles=(np.float64, ("T", "A", 2)),
            yaws=(np.float64, ("T", "A")),
            velocities=(np.float64, ("T", "A", 2)),
        )

    def select(self, instants: slice) -> States:
        """Return the states at some of the instants."""
        return self._trusted(**{name: getattr(self, name)[instants] for name in self.__slots__})


@dataclass(frozen=True, slots=True, eq=False)
class Timeline(Record):
    """Motion of A actors sampled at K stamps; actor 0 is the ego.

    stamps_s: (K,) float64, increasing.
    ids: (A,) int64, unique.
    categories: (A,) int8, values of `Category`.
    sizes: (A, 3) float64, metres, length width height of the sensed body.
    centre_ahead_m: (A,) float64, distance of the box centre ahead of the rear axle.
    present: (K, A) bool; an actor is present in one unbroken interval.
    axles: (K, A, 2) float64, metres, rear axle on the ground, world frame.
    yaws: (K, A) float64, radians, unwrapped along K.
    speeds: (K, A) float64, m/s, of the rear axle along the yaw (it has no slip).
    crashed: (K, A) bool.
    road: lanes of the place.
    style: roadside style, a name of `roadside.STYLES`.
    raw: whether the motion comes from a foreign environment and may be unphysical.
    obstacles: (O, 6) float64, obstacles on the road, world frame: centre x and y, yaw, length,
        width, height.
    terrain: the ground; None: the plane z = 0. Motion is in x and y only and does not depend on it.
    """

    stamps_s: np.ndarray
    ids: np.ndarray
    categories: np.ndarray
    sizes: np.ndarray
    centre_ahead_m: np.ndarray
    present: np.ndarray
    axles: np.ndarray
    yaws: np.ndarray
    speeds: np.ndarray
    crashed: np.ndarray
    road: RoadMap
    style: str = "bare"
    raw: bool = False
    obstacles: np.ndarray = field(default_factory=lambda: np.empty((0, 6)))
    terrain: Terrain | None = None

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            stamps_s=(np.float64, ("K",)),
            ids=(np.int64, ("A",)),
            categories=(np.int8, ("A",)),
            sizes=(np.float64, ("A", 3)),
            centre_ahead_m=(np.float64, ("A",)),
            present=(np.bool_, ("K", "A")),
            axles=(np.float64, ("K", "A", 2)),
            yaws=(np.float64, ("K", "A")),
            speeds=(np.float64, ("K", "A")),
            crashed=(np.bool_, ("K", "A")),
            obstacles=(np.float64, ("O", 6)),
        )
        require(len(self.stamps_s) > 0, self, "stamps_s", "at least one stamp", 0)
        require(
            bool((np.diff(self.stamps_s) > 0).all()),
            self,
            "stamps_s",
            "increasing stamps",
            "others",
        )
        require(len(np.unique(self.ids)) == len(self.ids) > 0, self, "ids", "unique ids", self.ids)

    @property
    def start_s(self) -> float:
        """The first stamp."""
        return float(self.stamps_s[0])

    @property
    def end_s(self) -> float:
        """The last stamp."""
        return float(self.stamps_s[-1])

    def at(self, stamps_s: np.ndarray) -> States:
        """Interpolate all actors by cubic Hermite splines of the rear axle, (T,) stamps.

        The rear axle does not slip, so its velocity is the speed along the yaw and the curve is
        smooth; between two samples yaw turns at a constant rate. Outside the samples of an actor
        its velocity is constant; there it is absent, unless the recording itself ends.
        """
        times = np.atleast_1d(np.asarray(stamps_s, np.float64))
        first, last = self._presence()
        low, high = self.stamps_s[first], self.stamps_s[last]
        t = times[:, None]
        present = self.present.any(axis=0) & (
            ((t >= low) | (first == 0)) & ((t <= high) | (last == len(self.stamps_s) - 1))
        )
        k = np.searchsorted(self.stamps_s, times, "right")[:, None] - 1
        before = np.clip(k, first, np.maximum(last - 1, first))
        after = np.minimum(before + 1, last)
        axles, yaws, velocities = self._hermite(before, after, np.clip(t, low, high))
        outside = (t - np.clip(t, low, high))[..., None]
        return States(times, present, axles + velocities * outside, yaws, velocities)

    def centres(self, states: States) -> np.ndarray:
        """Return the (T, A, 2) middles of all boxes on the ground."""
        ahead = np.stack([np.cos(states.yaws), np.sin(states.yaws)], axis=-1)
        middles: np.ndarray = states.axles + self.centre_ahead_m[:, None] * ahead
        return middles

    def stances(self, states: States) -> np.ndarray:
        """Return how all actors stand on the ground, (T, A, 3), as `Terrain.stances`."""
        if self.terrain is None:
            return np.zeros((*states.yaws.shape, 3))
        return self.terrain.stances(self.centres(states), states.yaws, self.sizes, self.categories)

    def ego_poses(self, states: States) -> list[Pose]:
        """Return the pose of the ego's rear axle on the ground at each of T instants."""
        ego = zip(states.axles[:, 0], states.yaws[:, 0], self.stances(states)[:, 0], strict=True)
        ahead_m = float(self.centre_ahead_m[0])
        return [axle_pose(axle, yaw, ahead_m, stance) for axle, yaw, stance in ego]

    def world_from_ego(self, stamp_s: float) -> Pose:
        """Return the pose of the ego's rear axle on the ground."""
        ego = self.ego_only()
        return ego.ego_poses(ego.at(np.array([stamp_s])))[0]

    def ego_only(self) -> Timeline:
        """Return the timeline with the ego only."""
        per_actor = ("ids", "categories", "sizes", "centre_ahead_m")
        per_state = ("present", "axles", "yaws", "speeds", "crashed")
        return self._trusted(
            **{name: getattr(self, name)[:1] for name in per_actor},
            **{name: getattr(self, name)[:, :1] for name in per_state},
        )

    def save(self, file: Path | str | BinaryIO) -> None:
        """Write the timeline to a compressed `.npz` file."""
        if isinstance(file, Path | str):
            with Path(file).open("wb") as opened:
                self.save(opened)
            return
        header = {"format": FORMAT, "style": self.style, "raw": self.raw}
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        ground = {} if self.terrain is None else self.terrain.to_arrays()
        contents = {
            "header": np.array(json.dumps(header)),
            **self.road.to_arrays(),
            **ground,
            **arrays,
        }
        np.savez_compressed(file, allow_pickle=False, **contents)

    @staticmethod
    def load(file: Path | str | BinaryIO) -> Timeline:
        """Read a timeline that `save` wrote; raise `RecordError` for anything else."""
        if isinstance(file, Path | str):
            with Path(file).open("rb") as opened:
                return Timeline.load(opened)
        try:
            return _unpack(np.load(file, allow_pickle=False))
        except OSError:
            raise
        # A damaged archive may raise any error of zipfile, zlib, NumPy and our records.
        except Exception as error:
            name = getattr(file, "name", "content")
            raise RecordError(f"{name}: not a timeline file: {error}") from error

    def _presence(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the first and the last sample of each actor, (A,) each."""
        first = self.present.argmax(axis=0)
        return first, len(self.stamps_s) - 1 - self.present[::-1].argmax(axis=0)

    def _hermite(
        self, before: np.ndarray, after: np.ndarray, times: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return axles, yaws and velocities at (T, A) times, from the cubics between samples."""
        actors = np.arange(len(self.ids))
        step = np.where(after > before, self.stamps_s[after] - self.stamps_s[before], 1.0)
        u = (times - self.stamps_s[before]) / step
        yaw0, yaw1 = self.yaws[before, actors], self.yaws[after, actors]
        p0, p1 = self.axles[before, actors], self.axles[after, actors]
        m0 = _along(self.speeds[before, actors] * step, yaw0)
        m1 = _along(self.speeds[after, actors] * step, yaw1)
        still = (after == before)[..., None]
        w = u[..., None]
        square, cube = w**2, w**3
        axles = (
            (2 * cube - 3 * square + 1) * p0
            + (cube - 2 * square + w) * m0
            + (3 * square - 2 * cube) * p1
            + (cube - square) * m1
        )
        slopes = (
            (6 * square - 6 * w) * (p0 - p1)
            + (3 * square - 4 * w + 1) * m0
            + (3 * square - 2 * w) * m1
        )
        velocities = np.where(still, m0, slopes) / step[..., None]
        return np.where(still, p0, axles), yaw0 + u * (yaw1 - yaw0), velocities


def _unpack(data: Mapping[str, np.ndarray]) -> Timeline:
    """Read a timeline from the arrays of a file."""
    header = json.loads(str(data["header"]))
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ValueError(f"its header is {header!r}, not that of {FORMAT!r}")
    return Timeline(
        **{name: data[name] for name in _ARRAYS},
        road=RoadMap.from_arrays(data),
        style=header["style"],
        raw=header["raw"],
        terrain=Terrain.from_arrays(data) if "terrain_terms" in data else None,
    )


def _along(lengths: np.ndarray, yaws: np.ndarray) -> np.ndarray:
    vectors: np.ndarray = lengths[..., None] * np.stack([np.cos(yaws), np.sin(yaws)], axis=-1)
    return vectors


_ARRAYS = (
    "stamps_s",
    "ids",
    "categories",
    "sizes",
    "centre_ahead_m",
    "present",
    "axles",
    "yaws",
    "speeds",
    "crashed",
    "obstacles",
)
