"""Uneven ground: a height above every place, and the terrain of scenarios."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from roadscope.core import Category, Pose
from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record
from roadscope.envs.traffic.road_maps import RoadMap

# --------------------------------------------------------------------------------------------------
# A height field.

CELL_M = 0.5
"""Heights are bilinear between the corners of square cells of this length."""
TILE = 8
"""Cells along the side of a tile, whose greatest height is known."""
STEEPEST = 0.5
"""Greatest slope along the sides of cells."""
WHEELS_AHEAD, WHEELS_LEFT = 0.3, 0.4
"""Where wheels touch the ground, as shares of length and width from the middle of a vehicle."""
WAVE, HUMP, RAMP = range(3)
"""Kinds of terms."""


class HeightGrid(NamedTuple):
    """Heights of the ground, metres.

    heights: (X, Y) at the corners of cells. tops: greatest height of each tile.
    x, y: place of the first corner.
    """

    heights: np.ndarray
    tops: np.ndarray
    x: float
    y: float


@dataclass(frozen=True, slots=True, eq=False)
class Terrain(Record):
    """Ground whose height is a sum of terms, each of which varies in one direction only.

    terms: (T, 7) float64: kind, x and y of a point, direction in radians, then a, b and c. With u
        the distance in metres from the point in that direction, a term is
        `WAVE`: a sin(2 pi u / b); `HUMP`: a cos^2(pi u / b) while |u| < b / 2;
        `RAMP`: slope a from u = b to u = c, level before and after, with height 0 at u = 0.
    area: (4,) float64, metres, least x and y, greatest x and y of the ground. Beyond, rays hit no
        ground, and what stands there stands as high as the nearest ground.

    Between the corners of cells of `CELL_M` the height is bilinear; this is the exact surface for
    rays, vehicles and people.
    """

    terms: np.ndarray
    area: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, terms=(np.float64, ("T", 7)), area=(np.float64, (4,)))
        kinds, lengths = self.terms[:, 0], self.terms[:, 5]
        known = bool(np.isin(kinds, (WAVE, HUMP, RAMP)).all())
        require(known, self, "terms", "kinds 0 to 2", kinds.tolist())
        long = bool((lengths[kinds != RAMP] > 0).all())
        require(long, self, "terms", "waves and humps longer than 0 m", lengths.tolist())
        wide = bool((self.area[2:] - self.area[:2] >= TILE * CELL_M).all())
        require(wide, self, "area", f"sides of at least {TILE * CELL_M:g} m", self.area.tolist())
        heights = self.grid.heights
        slope = max(float(np.abs(np.diff(heights, axis=axis)).max()) / CELL_M for axis in (0, 1))
        require(slope <= STEEPEST, self, "terms", f"slopes of at most {STEEPEST:g}", slope)

    @property
    def grid(self) -> HeightGrid:
        """The heights at the corners of cells."""
        return _grid(self.terms.tobytes(), self.area.tobytes())

    def heights(self, places: np.ndarray) -> np.ndarray:
        """Return the height of the ground at places (..., 2), metres."""
        heights, _, x, y = self.grid
        u = np.clip((places[..., 0] - x) / CELL_M, 0, heights.shape[0] - 1)
        v = np.clip((places[..., 1] - y) / CELL_M, 0, heights.shape[1] - 1)
        i = np.minimum(u.astype(np.int64), heights.shape[0] - 2)
        j = np.minimum(v.astype(np.int64), heights.shape[1] - 2)
        u, v = u - i, v - j
        near = heights[i, j] * (1 - v) + heights[i, j + 1] * v
        far = heights[i + 1, j] * (1 - v) + heights[i + 1, j + 1] * v
        between: np.ndarray = near * (1 - u) + far * u
        return between

    def stances(
        self, centres: np.ndarray, yaws: np.ndarray, sizes: np.ndarray, categories: np.ndarray
    ) -> np.ndarray:
        """Return how road users stand on the ground, (..., A, 3): height, rise and lean.

        centres: (..., A, 2) of their boxes; yaws: (..., A); sizes: (A, 3); categories: (A,).
        Height is that of the ground under the centre, metres. Rise and lean are slopes of the
        plane through four wheels, ahead and to the left. People stand upright; motorcycles and
        bicycles do not lean.
        """
        ahead = np.stack([np.cos(yaws), np.sin(yaws)], -1)
        left = np.stack([-ahead[..., 1], ahead[..., 0]], -1)
        x = (WHEELS_AHEAD * sizes[:, 0])[:, None] * ahead
        y = (WHEELS_LEFT * sizes[:, 1])[:, None] * left
        wheels = {(u, v): self.heights(centres + u * x + v * y) for u in (1, -1) for v in (1, -1)}
        mean = sum(wheels.values()) / 4
        rise = (wheels[1, 1] + wheels[1, -1]) / 2 - mean
        lean = (wheels[1, 1] + wheels[-1, 1]) / 2 - mean
        upright = categories == Category.PEDESTRIAN
        riding = upright | np.isin(categories, (Category.MOTORCYCLE, Category.CYCLIST))
        rise = np.where(upright, 0.0, rise / (WHEELS_AHEAD * sizes[:, 0]))
        lean = np.where(riding, 0.0, lean / (WHEELS_LEFT * sizes[:, 1]))
        return np.stack([mean, rise, lean], -1)

    def shears(self, places: np.ndarray) -> np.ndarray:
        """Return height, and slopes along x and y, of the ground at places (N, 2), as (N, 3)."""
        step = np.array([[CELL_M, 0.0], [-CELL_M, 0.0], [0.0, CELL_M], [0.0, -CELL_M]])
        around = self.heights(places[:, None] + step)
        slopes = (around[:, ::2] - around[:, 1::2]) / (2 * CELL_M)
        return np.column_stack([self.heights(places), slopes])

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Name the arrays for a file."""
        return {"terrain_terms": self.terms, "terrain_area": self.area}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray]) -> Terrain:
        """Undo `to_arrays`."""
        return Terrain(arrays["terrain_terms"], arrays["terrain_area"])


def axle_pose(axle: np.ndarray, yaw: float, ahead_m: float, stance: np.ndarray) -> Pose:
    """Return the pose of a vehicle's rear axle on the ground, frame `world`.

    axle: (2,) its place, metres. ahead_m: distance of the middle of the vehicle ahead of it.
    stance: (3,) height, rise and lean, as `Terrain.stances`.
    """
    height, rise, lean = stance
    pitch, roll = (float(angle) for angle in tilt_angles(rise, lean))
    x, y = axle
    return Pose.from_euler(x, y, height - rise * ahead_m, yaw=yaw, pitch=pitch, roll=roll)


def tilt_angles(rise: np.ndarray, lean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pitch and roll, ISO 8855, radians, of a body on a plane of these slopes."""
    # On level ground this is 0, not -0: poses are the same bytes as without a terrain.
    return np.arctan(0.0 - rise), np.arctan(lean / np.hypot(1.0, rise))


@lru_cache(maxsize=4)
def _grid(terms: bytes, area: bytes) -> HeightGrid:
    low_x, low_y, high_x, high_y = np.frombuffer(area)
    first = np.floor(np.array([low_x, low_y]) / CELL_M) * CELL_M
    tiles = np.ceil((np.array([high_x, high_y]) - first) / (TILE * CELL_M)).astype(int)
    x = first[0] + CELL_M * np.arange(TILE * tiles[0] + 1)[:, None]
    y = first[1] + CELL_M * np.arange(TILE * tiles[1] + 1)
    heights = np.zeros((len(x), len(y)))
    for kind, at_x, at_y, turn, a, b, c in np.frombuffer(terms).reshape(-1, 7):
        u = np.cos(turn) * (x - at_x) + np.sin(turn) * (y - at_y)
        if kind == WAVE:
            heights += a * np.sin(2 * np.pi / b * u)
        elif kind == HUMP:
            heights += np.where(np.abs(u) < b / 2, a * np.cos(np.pi / b * u) ** 2, 0.0)
        else:
            heights += a * (np.clip(u, b, c) - min(max(0.0, b), c))
    corners = np.lib.stride_tricks.sliding_window_view(heights, (TILE + 1, TILE + 1))
    tops = corners[::TILE, ::TILE].max(axis=(2, 3))
    return HeightGrid(heights, tops, float(first[0]), float(first[1]))


# --------------------------------------------------------------------------------------------------
# The terrain of scenarios on straight roads. All figures are chosen by hand.

MARGIN_M = 130.0
"""Ground reaches this far around the path of the ego: farther than rotating LiDARs measure."""
_ENDLESS_M = 1e4


class RoadLine(NamedTuple):
    """A straight road: a point on its middle, direction in radians, half the width in metres."""

    x: float
    y: float
    turn: float
    half_m: float


def terrain_of(name: str, road: RoadMap, path: np.ndarray, rng: np.random.Generator) -> Terrain:
    """Return the terrain of a scenario of that name along a straight road.

    path: (K, 2) positions of the ego.
    """
    terms = TERRAINS[name](_road_line(road, path[0]), rng)
    area = np.concatenate([path.min(axis=0) - MARGIN_M, path.max(axis=0) + MARGIN_M])
    return Terrain(np.array(terms), area)


def _road_line(road: RoadMap, near: np.ndarray) -> RoadLine:
    ahead = road.points[1] - road.points[0]
    turn = float(np.arctan2(ahead[1], ahead[0]))
    left = np.array([-np.sin(turn), np.cos(turn)])
    aside = (road.points - near) @ left
    low, high = (aside - road.widths / 2).min(), (aside + road.widths / 2).max()
    x, y = near + (low + high) / 2 * left
    return RoadLine(float(x), float(y), turn, float(high - low) / 2)


Terms = list[list[float]]


def hills(road: RoadLine, rng: np.random.Generator) -> Terms:
    """Return crests and sags along and beside the road, of slopes up to about 15 %."""
    waves = [
        [
            WAVE,
            road.x + rng.uniform(-200, 200),
            road.y,
            road.turn + rng.normal(0, 0.35),
            rng.uniform(0.02, 0.05) * length / (2 * np.pi),
            length,
            0.0,
        ]
        for length in rng.uniform(70, 200, 3)
    ]
    slope = [RAMP, road.x, road.y, road.turn, rng.uniform(-0.04, 0.04), -_ENDLESS_M, _ENDLESS_M]
    crown = _both_sides(road, -rng.uniform(0.01, 0.025), 0.0, road.half_m)
    return [*waves, slope, *crown, *_verges(road, rng), *_unevenness(road, rng, 0.01)]


def camber(road: RoadLine, rng: np.random.Generator) -> Terms:
    """Return a road that leans to one side or falls to both, between banks and ditches."""
    slope = rng.uniform(0.025, 0.06)
    if rng.random() < 0.5:
        side = road.turn + np.pi / 2 * rng.choice([-1, 1])
        across = [[RAMP, road.x, road.y, side, slope, -road.half_m - 2, road.half_m + 2]]
    else:
        across = _both_sides(road, -slope, 0.0, road.half_m)
    length = rng.uniform(80, 200)
    wave = rng.uniform(0.005, 0.02) * length / (2 * np.pi)
    along = [WAVE, road.x + rng.uniform(-200, 200), road.y, road.turn, wave, length, 0.0]
    return [*across, along, *_verges(road, rng), *_unevenness(road, rng, 0.01)]


def bumps(road: RoadLine, rng: np.random.Generator) -> Terms:
    """Return a street with humps of 6 to 12 cm, raised pavements and a rough surface."""
    places = np.cumsum(rng.uniform(18, 40, 24)) - 300.0
    ahead = np.array([np.cos(road.turn), np.sin(road.turn)])
    heights, lengths = rng.uniform(0.06, 0.12, len(places)), rng.uniform(2.5, 5, len(places))
    humps = [
        [HUMP, *(ahead * along + (road.x, road.y)), road.turn, height, length, 0.0]
        for along, height, length in zip(places, heights, lengths, strict=True)
    ]
    slope = [RAMP, road.x, road.y, road.turn, rng.uniform(-0.03, 0.03), -_ENDLESS_M, _ENDLESS_M]
    crown = _both_sides(road, -rng.uniform(0.01, 0.03), 0.0, road.half_m)
    kerb = _both_sides(road, 0.24, road.half_m, road.half_m + CELL_M)
    return [*humps, slope, *crown, *kerb, *_unevenness(road, rng, 0.02)]


def _both_sides(road: RoadLine, slope: float, near_m: float, far_m: float) -> Terms:
    """Return a slope away from the middle of the road, on either side."""
    return [
        [RAMP, road.x, road.y, road.turn + side, slope, near_m, far_m]
        for side in (np.pi / 2, -np.pi / 2)
    ]


def _verges(road: RoadLine, rng: np.random.Generator) -> Terms:
    """Return a bank or a ditch beside the road, on either side."""
    sides = _both_sides(road, 0.0, road.half_m + 2.0, road.half_m + 8.0)
    for side in sides:
        side[4] = rng.uniform(-0.15, 0.3)
    return sides


def _unevenness(road: RoadLine, rng: np.random.Generator, height_m: float) -> Terms:
    """Return short waves in all directions."""
    return [
        [WAVE, road.x, road.y, rng.uniform(-np.pi, np.pi), rng.uniform(0, height_m), length, 0.0]
        for length in rng.uniform(4, 15, 6)
    ]


TERRAINS: Mapping[str, Callable[[RoadLine, np.random.Generator], Terms]] = MappingProxyType(
    {"hills": hills, "camber": camber, "bumps": bumps}
)
"""Makes the terms of a terrain, by the name of its scenario."""
