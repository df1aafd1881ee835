"""LiDAR detectors on simulated roads that rise, fall, lean and are rough, with an HDL-64.

A check of the suite `uneven` that does not use the ray caster. Here the road bends upwards or
downwards ahead of the vehicle and behind it, or the vehicle stands tilted by the slope on a plane.
It has a crown, waves, kerbs and banks beside it; the vehicle pitches and rolls on its springs, and
its sensor is up to 10 cm higher or lower than believed. On it stand five cars, walls, posts and
shrubs. Returns are missing at random, more of them from dark ground far away.

Printed for each detector: cars found (within 2 m, of those with 30 returns and more), boxes without
a car, and those of them whose returns are mostly ground, with 95 % intervals over seeds; and the
time relative to the first one. Shrubs and posts are boxes of the size of a part of a car, so that
boxes without a car are not all the fault of the ground.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from time import process_time
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import t as student

from roadscope import DETECTORS, Calibration, Detections, Frame, LidarScan, Pose
from roadscope.core.jit import compiled
from roadscope.envs.sensors.lidar_spec import SPECS

ENTRIES = (
    "distance-l-shape",
    "distance-l-shape?level=False",
    "distance-l-shape?ground=polar&level=False",
)
FIRST_SEED = 20_000
"""Constants of the ground's estimate were chosen on other roads than those from here on."""
CELL_M, HALF_M = 0.25, 100.0
"""Heights are interpolated between the corners of such cells, this far from the vehicle."""
HEIGHT_M, CAR_M = 1.73, (4.4, 1.8, 1.5)
FAR_M, MATCH_M, LEAST_RETURNS, SCORED_M = 90.0, 2.0, 30, 60.0
WHEELBASE_M, TRACK_M = 2.8, 1.6
SHAPES = ("plane", "bend ahead", "bend both ways")


class Road(NamedTuple):
    """Heights at the corners of cells, (G, G) metres by x and y, and half the width in metres."""

    heights: np.ndarray
    half_width_m: float

    def at(self, x: float, y: float) -> float:
        """Return the height at a place."""
        return float(height_at(self.heights, x, y))


class Thing(NamedTuple):
    """Upright box standing on the road, sheared so that its floor is parallel to the ground."""

    x: float
    y: float
    yaw: float
    length: float
    width: float
    height: float


class UnevenScene(NamedTuple):
    """A scan with its truth.

    cars: (C, 3) x and y in the believed ego frame, and returns. owners: (N,) thing of each return,
    cars first, -1 for the ground.
    """

    frame: Frame
    cars: np.ndarray
    owners: np.ndarray


class DetectorScore(NamedTuple):
    """Counts of one scan: cars, cars found, boxes without a car, those of ground; and seconds."""

    cars: int
    found: int
    false: int
    ground: int
    seconds: float


# --------------------------------------------------------------------------------------------------
# A road and what stands on it.


def road_of(rng: np.random.Generator, shape: str, slope_deg: float) -> Road:
    """Return a road along x whose slope reaches so many degrees."""
    slope, start, length = np.tan(np.radians(slope_deg)), rng.uniform(5, 20), rng.uniform(15, 40)
    half, crown, kerb = rng.uniform(4, 8), rng.uniform(0.0, 0.03), rng.choice([0.0, 0.12, 0.15])
    bank, wave, rough = rng.uniform(-0.2, 0.35), rng.uniform(0.0, 0.05), rng.uniform(0.0, 0.06)
    corners = np.linspace(-HALF_M, HALF_M, round(2 * HALF_M / CELL_M) + 1)
    x, y = np.meshgrid(corners, corners, indexing="ij")
    along = x if shape != "bend both ways" else np.abs(x)
    beyond = np.maximum(along - start, 0.0)
    bent = np.minimum(beyond, length)
    z = slope * x if shape == "plane" else slope * (bent**2 / (2 * length) + beyond - bent)
    z = z - crown * np.minimum(np.abs(y), half)
    for number, turn, phase in zip(
        rng.uniform(0.05, 1.2, 8),
        rng.uniform(-np.pi, np.pi, 8),
        rng.uniform(0, 2 * np.pi, 8),
        strict=True,
    ):
        waves = np.sin(number * (np.cos(turn) * x + np.sin(turn) * y) + phase)
        z = z + wave / np.sqrt(8) * waves
    outside = np.abs(y) - half
    z = z + np.where(outside > 0, kerb, 0.0) + bank * np.clip(outside - 2.0, 0.0, 6.0)
    grass = rough * np.sin(37 * x + 17 * y) * np.sin(23 * y - 11 * x)
    return Road(z + np.where(outside > 2.0, grass, 0.0), float(half))


def things_of(rng: np.random.Generator, half_m: float) -> list[Thing]:
    """Return five cars, then walls, shrubs and posts."""
    cars = [
        Thing(rng.uniform(12, 28), rng.uniform(-2, -1), rng.normal(0, 0.05), *CAR_M),
        Thing(rng.uniform(30, 45), 2.0, np.pi, *CAR_M),
        Thing(-rng.uniform(8, 25), -1.5, 0.0, *CAR_M),
        Thing(rng.uniform(5, 12), half_m - 1.0, 0.0, *CAR_M),
        Thing(rng.uniform(18, 24), half_m - 1.0, 0.0, *CAR_M),
    ]
    side, away = rng.choice([1, -1]), rng.uniform(3, 8)
    walls = [Thing(x, side * (half_m + away), 0.0, 6, 0.3, 2.2) for x in np.arange(-57, 60, 6.0)]
    rest = []
    for k in range(28):
        x, y = rng.uniform(-60, 60), (1 if k % 2 else -1) * (half_m + rng.uniform(0.8, 4))
        size = (rng.uniform(0.15, 2.5), rng.uniform(0.15, 1.5), rng.uniform(0.6, 2.5))
        shrub = rng.random() < 0.7
        rest.append(Thing(x, y, rng.uniform(0, 3), *(size if shrub else (0.15, 0.15, 6.0))))
    return [*cars, *walls, *rest]


# --------------------------------------------------------------------------------------------------
# One scan of it.


@compiled()
def height_at(heights: np.ndarray, x: float, y: float) -> float:
    """Return the height between corners of cells, metres."""
    u, v = (x + HALF_M) / CELL_M, (y + HALF_M) / CELL_M
    i = min(max(int(u), 0), heights.shape[0] - 2)
    j = min(max(int(v), 0), heights.shape[1] - 2)
    u, v = u - i, v - j
    near = heights[i, j] * (1 - v) + heights[i, j + 1] * v
    far = heights[i + 1, j] * (1 - v) + heights[i + 1, j + 1] * v
    height: float = near * (1 - u) + far * u
    return height


@compiled()
def ground_ranges(origin: np.ndarray, rays: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Return the range at which each of (N, 3) unit rays meets the ground, inf if it does not."""
    ranges = np.full(len(rays), np.inf)
    for k in range(len(rays)):
        flat = np.sqrt(rays[k, 0] ** 2 + rays[k, 1] ** 2)
        x, y, climb = rays[k, 0] / flat, rays[k, 1] / flat, rays[k, 2] / flat
        reach = 1.0
        over = origin[2] + climb - height_at(heights, origin[0] + x, origin[1] + y)
        while reach < FAR_M:
            after = reach + max(0.15, 0.7 * over / (0.5 + abs(climb)))
            at = height_at(heights, origin[0] + x * after, origin[1] + y * after)
            left = origin[2] + climb * after - at
            if left <= 0:
                ranges[k] = (reach + over / (over - left + 1e-12) * (after - reach)) / flat
                break
            reach, over = after, left
    return ranges


def box_ranges(origin: np.ndarray, rays: np.ndarray, thing: Thing, road: Road) -> np.ndarray:
    """Return the range at which each of (N, 3) unit rays meets a thing, inf if it does not."""
    cos, sin = np.cos(thing.yaw), np.sin(thing.yaw)
    half_l, half_w = thing.length / 2, thing.width / 2
    ends = [
        road.at(
            thing.x + u * cos * half_l - v * sin * half_w,
            thing.y + u * sin * half_l + v * cos * half_w,
        )
        for u in (1, -1)
        for v in (1, -1)
    ]
    rise = (ends[0] + ends[1] - ends[2] - ends[3]) / (2 * thing.length)
    lean = (ends[0] - ends[1] + ends[2] - ends[3]) / (2 * thing.width)

    def local(vectors: np.ndarray) -> np.ndarray:
        x, y = (
            cos * vectors[..., 0] + sin * vectors[..., 1],
            cos * vectors[..., 1] - sin * vectors[..., 0],
        )
        return np.stack([x, y, vectors[..., 2] - rise * x - lean * y], axis=-1)

    start = local(origin - (thing.x, thing.y, float(np.mean(ends))))
    heading, best = local(rays), np.full(len(rays), np.inf)
    for low, high in _parts(thing):
        with np.errstate(all="ignore"):
            one, other = (low - start) / heading, (high - start) / heading
        near, far = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
        best = np.where((near <= far) & (near > 0), np.minimum(best, near), best)
    return best


def _parts(thing: Thing) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return lower and upper corners of the boxes of a thing: a car is a body and a cabin."""
    x, y, top = thing.length / 2, thing.width / 2, thing.height
    whole = (-x, -y, 0.0), (x, y, top)
    body = (-x, -y, 0.22), (x, y, 0.55 * top)
    cabin = (-0.7 * x, -0.85 * y, 0.55 * top), (0.45 * x, 0.85 * y, top)
    parts = [body, cabin] if (thing.length, thing.width, top) == CAR_M else [whole]
    return [(np.array(low), np.array(high)) for low, high in parts]


def scene_of(seed: int, shape: str, slope_deg: float) -> UnevenScene:
    """Return a scan of a road of that seed; another seed is another road."""
    rng, spec = np.random.default_rng(seed), SPECS["hdl64e"]
    road = road_of(rng, shape, slope_deg)
    things = things_of(rng, road.half_width_m)
    rise = (road.at(WHEELBASE_M / 2, 0) - road.at(-WHEELBASE_M / 2, 0)) / WHEELBASE_M
    lean = (road.at(0, TRACK_M / 2) - road.at(0, -TRACK_M / 2)) / TRACK_M
    sway, offset_m = np.radians(rng.normal(0, 0.7, 2)), rng.uniform(-0.1, 0.1)
    world_from_lidar = Pose.from_euler(
        0,
        0,
        road.at(0, 0) + HEIGHT_M,
        pitch=sway[0] - np.arctan(rise),
        roll=sway[1] + np.arctan(lean),
    )
    azimuths, elevations = np.meshgrid(spec.azimuths(), spec.elevations, indexing="ij")
    flat = np.cos(elevations)
    rays = np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), np.sin(elevations)], -1)
    rays = rays.reshape(-1, 3)
    turned, origin = rays @ world_from_lidar.rotation.T, world_from_lidar.translation
    ranges, owners = ground_ranges(origin, turned, road.heights), np.full(len(rays), -1)
    for number, thing in enumerate(things):
        hit = box_ranges(origin, turned, thing, road)
        owners = np.where(hit < ranges, number, owners)
        ranges = np.minimum(ranges, hit)
    lost = rng.random(len(rays)) < np.where((owners < 0) & (ranges > 40), 0.23, 0.03)
    rows = np.flatnonzero((ranges < FAR_M) & ~lost)
    # After five cars and twenty walls come shrubs and posts.
    leaves = (owners[rows] >= 25) & (rng.random(len(rows)) < 0.3)
    measured = ranges[rows] + spec.range_noise_m * rng.standard_normal(len(rows))
    measured += np.where(leaves, rng.uniform(0, 0.8, len(rows)), 0.0)
    column, ring = np.divmod(rows, spec.beams)
    scan = LidarScan(
        rays[rows] * measured[:, None],
        np.where(owners[rows] < 0, 0.15, 0.4),
        ring,
        column,
        np.zeros(len(rows)),
        0.0,
        "lidar",
    )
    believed = Pose.planar(0, 0, 0, HEIGHT_M + offset_m)
    places = np.array([(c.x, c.y, road.at(c.x, c.y) + c.height / 2) for c in things[:5]])
    seen = (believed @ world_from_lidar.inverse()).apply(places)[:, :2]
    returns = np.bincount(owners[rows][owners[rows] >= 0], minlength=5)[:5]
    frame = Frame(0.0, Calibration((("lidar", believed),)), lidar=scan)
    return UnevenScene(frame, np.column_stack([seen, returns]), owners[rows])


# --------------------------------------------------------------------------------------------------
# Detectors on it.


def judged(spec: str) -> Callable[[UnevenScene], DetectorScore]:
    """Return what counts the boxes of a detector in a scene."""
    detector = DETECTORS.make(spec)

    def count(scene: UnevenScene) -> DetectorScore:
        begun = process_time()
        boxes = detector.detect(scene.frame)
        seconds = process_time() - begun
        assert isinstance(boxes, Detections)
        assert scene.frame.lidar is not None
        places = boxes.centres[:, :2]
        away = np.linalg.norm(places[:, None] - scene.cars[:, :2], axis=-1)
        matched: set[int] = set()
        eligible = np.flatnonzero(scene.cars[:, 2] >= LEAST_RETURNS)
        for car in eligible:
            order = [int(k) for k in np.argsort(away[:, car]) if int(k) not in matched]
            if order and away[order[0], car] < MATCH_M:
                matched.add(order[0])
        alone = (away > MATCH_M).all(axis=1) & (np.linalg.norm(places, axis=1) < SCORED_M)
        points, ground = scene.frame.lidar.points[:, :2], 0
        for k in np.flatnonzero(alone):
            cos, sin = np.cos(boxes.yaws[k]), np.sin(boxes.yaws[k])
            x, y = (points - places[k]).T
            u, v = np.abs(cos * x + sin * y), np.abs(cos * y - sin * x)
            inside = (u < boxes.sizes[k, 0] / 2 + 0.25) & (v < boxes.sizes[k, 1] / 2 + 0.25)
            ground += bool(inside.any()) and bool((scene.owners[inside] < 0).mean() > 0.8)
        return DetectorScore(len(eligible), len(matched), int(alone.sum()), ground, seconds)

    return count


def interval(values: np.ndarray) -> str:
    """Return the mean over seeds with its 95 % interval."""
    half = student.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return f"{values.mean():.2f} +- {half:.2f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table for each slope."""
    parser = argparse.ArgumentParser(
        prog="python -m research.uneven_roads",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seeds", type=int, default=20, help="at least 2; default: %(default)s")
    parser.add_argument("--slopes", type=float, nargs="+", default=[0.0, 3.0, 6.0], help="degrees")
    parser.add_argument("--entry", action="append", help="a detector, in place of the usual ones")
    options = parser.parse_args(arguments)
    entries = {spec: judged(spec) for spec in options.entry or ENTRIES}
    warm = scene_of(0, SHAPES[0], 0.0)
    for count in entries.values():
        count(warm)
    for slope_deg in options.slopes:
        scores: dict[str, list[DetectorScore]] = {spec: [] for spec in entries}
        for seed in range(FIRST_SEED, FIRST_SEED + options.seeds):
            scene = scene_of(seed, SHAPES[seed % len(SHAPES)], slope_deg)
            for spec, count in entries.items():
                scores[spec].append(count(scene))
        table = Table(title=f"slope up to {slope_deg:g} degrees, {options.seeds} roads")
        for name in ("detector", "cars found", "false a scan", "of ground a scan", "time"):
            table.add_column(name)
        first = sum(score.seconds for score in next(iter(scores.values())))
        for spec, rows in scores.items():
            cars, found, false, ground, seconds = np.array(rows).T
            share = found / np.maximum(cars, 1)
            cells = (interval(share), interval(false), interval(ground))
            table.add_row(spec, *cells, f"{seconds.sum() / first:.2f}")
        Console().print(table)


if __name__ == "__main__":
    main()
