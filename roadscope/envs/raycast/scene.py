"""Everything that a sensor can measure during one sweep."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record
from roadscope.envs.traffic.terrain import Terrain
from roadscope.envs.world.prisms import Prisms


@dataclass(frozen=True, slots=True, eq=False)
class Scene(Record):
    """Scenery and bodies in motion on the ground, world frame.

    static: scenery, in the world frame; heights are above the ground.
    moving: bodies; owner is the row of the actor, footprints in the frame of the actor's box
        centre on the ground, x ahead.
    knots_s: (K,) float64, increasing, seconds since reset.
    poses: (K, A, 3) float64, x, y (metres) and yaw (radians, unwrapped) of each actor's box
        centre at the knots. Between two knots x, y and yaw are linear in time; outside they
        stay as at the nearest knot.
    present: (A,) bool; bodies of absent actors are invisible.
    seed: of the random paths of rays through porous prisms.
    ground_reflectivity: of the road at normal incidence; dry asphalt at 905 nm.
    terrain: the ground; None: the plane z = 0. Scenery is sheared upwards so that its bottom is
        parallel to the ground under its middle; its sides stay upright.
    stances: (K, A, 3) float64, how actors stand on the terrain at the knots, as
        `Terrain.stances`, linear in time as the poses; bodies are pitched and rolled.
    """

    static: Prisms
    moving: Prisms
    knots_s: np.ndarray
    poses: np.ndarray
    present: np.ndarray
    seed: int = 0
    ground_reflectivity: float = 0.15
    terrain: Terrain | None = None
    stances: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3)))

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            knots_s=(np.float64, ("K",)),
            poses=(np.float64, ("K", "A", 3)),
            present=(np.bool_, ("A",)),
            stances=(np.float64, ("S", "T", 3)),
        )
        shape = (0, 0, 3) if self.terrain is None else self.poses.shape
        require(self.stances.shape == shape, self, "stances", f"shape {shape}", self.stances.shape)
        rising = len(self.knots_s) > 0 and bool((np.diff(self.knots_s) > 0).all())
        require(rising, self, "knots_s", "at least one knot, increasing", self.knots_s.tolist())
        owners = self.moving.owners
        known = bool(((owners >= 0) & (owners < len(self.present))).all())
        require(known, self, "moving", f"owners below {len(self.present)} actors", owners.tolist())
        scenery = bool((self.static.owners <= -2).all())
        require(scenery, self, "static", "owners of -2 and below", self.static.owners.tolist())

    @staticmethod
    def still(static: Prisms, moving: Prisms, poses: np.ndarray, seed: int = 0) -> Scene:
        """Return a scene in which nothing moves, (A, 3) poses."""
        return Scene(static, moving, np.zeros(1), poses[None], np.ones(len(poses), bool), seed)

    def poses_at(self, stamps_s: np.ndarray) -> np.ndarray:
        """Interpolate all actors, (T,) stamps to (T, A, 3) x, y, yaw."""
        knots, fractions = self.segments(stamps_s)
        after = np.minimum(knots + 1, len(self.knots_s) - 1)
        start = self.poses[knots]
        moved: np.ndarray = start + fractions[:, None, None] * (self.poses[after] - start)
        return moved

    def segments(self, stamps_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the knot before each (T,) stamp and the fraction of the interval to the next."""
        last = len(self.knots_s) - 1
        if last == 0:
            return np.zeros(len(stamps_s), np.int64), np.zeros(len(stamps_s))
        knots = np.clip(np.searchsorted(self.knots_s, stamps_s, "right") - 1, 0, last - 1)
        start = self.knots_s[knots]
        fractions = (stamps_s - start) / (self.knots_s[knots + 1] - start)
        return knots, np.clip(fractions, 0.0, 1.0)
