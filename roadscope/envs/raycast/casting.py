"""Exact ray casting against prisms and the ground, for LiDAR and cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import GROUND
from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record
from roadscope.envs.raycast.blocks import RayColumns, is_level
from roadscope.envs.raycast.depth import NOTHING, Surfaces
from roadscope.envs.raycast.kernels import CastWorld, cast_all
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.raycast.shapes import STILL, Shapes, shapes_of
from roadscope.envs.traffic.terrain import HeightGrid

__all__ = ["GROUND", "NOTHING", "Columns", "Hits", "cast"]


@dataclass(frozen=True, slots=True, eq=False)
class Columns(Record):
    """C fans of rays; ray j of column c has direction ahead[c] + slopes[j] * up[c].

    With `ahead` the horizontal direction of a column in the sensor and `up` the sensor's z axis
    these are LiDAR columns and slopes are tangents of elevations; with `ahead` = (x, 0, 1) and
    `up` = (0, 1, 0) of a camera they are columns of pixels.

    origins, ahead, up: (C, 3) float64, world frame; ahead and up span a plane.
    stamps_s: (C,) float64, seconds since reset.
    """

    origins: np.ndarray
    ahead: np.ndarray
    up: np.ndarray
    stamps_s: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            origins=(np.float64, ("C", 3)),
            ahead=(np.float64, ("C", 3)),
            up=(np.float64, ("C", 3)),
            stamps_s=(np.float64, ("C",)),
        )

    def __len__(self) -> int:
        return len(self.stamps_s)


@dataclass(frozen=True, slots=True, eq=False)
class Hits(Record):
    """The nearest hit of each of C x B rays.

    ranges: (C, B) float32, metres, 0 without a hit.
    owners: (C, B) int32, actor row, `GROUND`, -2 and below for scenery, or `NOTHING`.
    cosines: (C, B) float32, cosine of the angle of incidence.
    reflectivity: (C, B) float32, of the surface at normal incidence.
    outline_rays: (A,) int64, rays that would hit the actor without any other object, or None.
    outline_hits: (A,) int64, rays that hit it, or None.
    """

    ranges: np.ndarray
    owners: np.ndarray
    cosines: np.ndarray
    reflectivity: np.ndarray
    outline_rays: np.ndarray | None = None
    outline_hits: np.ndarray | None = None


def cast(
    scene: Scene,
    columns: Columns,
    slopes: np.ndarray,
    *,
    max_range_m: float,
    outlines: bool = False,
) -> Hits:
    """Return the nearest surface on every ray, in double precision and without approximation.

    Bodies have their poses at the stamp of the column. A ray does not hit a prism that contains
    its origin. With `outlines`, the rays that reach each actor's outline are counted too.
    """
    rays = _rays(scene, columns, slopes)
    require(0 < max_range_m < np.inf, columns, "max_range_m", "a finite range above 0", max_range_m)
    shape = (len(slopes), len(columns))
    surfaces = Surfaces(
        np.empty(shape, np.float32),
        np.empty(shape, np.int32),
        np.empty(shape, np.float32),
        np.empty(shape, np.float32),
    )
    outline = np.zeros(len(scene.present) if outlines else 0, np.int64)
    # With other number types Numba would compile everything again.
    shapes = shapes_of(scene)
    grid, shears = _ground(scene, shapes)
    world = CastWorld(
        shapes,
        scene.poses,
        scene.knots_s,
        int(scene.seed),
        float(scene.ground_reflectivity),
        float(max_range_m),
        scene.terrain is not None,
        grid,
        shears,
        scene.stances,
    )
    cast_all(rays, world, surfaces, outline)
    ranges, owners, cosines, reflectivity = (surface.T for surface in surfaces)
    if not outlines:
        return Hits(ranges, owners, cosines, reflectivity)
    hits = np.bincount(owners[owners >= 0], minlength=len(outline))
    return Hits(ranges, owners, cosines, reflectivity, outline, hits)


def _ground(scene: Scene, shapes: Shapes) -> tuple[HeightGrid, np.ndarray]:
    """Return the grid of the ground and, for each unit of scenery, how it is sheared."""
    if scene.terrain is None:
        return HeightGrid(np.empty((0, 0)), np.empty((0, 0)), 0.0, 0.0), np.empty((0, 3))
    still = shapes.unit_poses == STILL
    return scene.terrain.grid, scene.terrain.shears(shapes.unit_circles[still, :2])


def _rays(scene: Scene, columns: Columns, slopes: np.ndarray) -> RayColumns:
    tangents = np.ascontiguousarray(slopes, np.float64)
    rising = tangents.ndim == 1 and len(tangents) > 0 and bool((np.diff(tangents) > 0).all())
    require(rising and len(columns) > 0, columns, "slopes", "columns and increasing slopes", slopes)
    knots, fractions = scene.segments(columns.stamps_s)
    ahead, up = columns.ahead, columns.up
    # On a terrain bodies are tilted.
    level = scene.terrain is None and is_level(ahead, up)
    return RayColumns(
        columns.origins, ahead, up, columns.stamps_s, tangents, knots, fractions, level
    )
