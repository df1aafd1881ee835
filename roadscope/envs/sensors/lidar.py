"""One sweep of a scanning LiDAR through a moving scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from roadscope.core import WEATHER, LidarScan, Pose, RecordError
from roadscope.core.checks import settle_arrays
from roadscope.core.jit import compiled
from roadscope.core.record import Record
from roadscope.envs.raycast.casting import NOTHING, Columns, Hits, cast
from roadscope.envs.raycast.depth import Surfaces
from roadscope.envs.raycast.prism_hits import SPLITMIX_STEP, mix
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.lidar_spec import LidarSpec
from roadscope.envs.sensors.weathers import CLEAR, Weather

# --------------------------------------------------------------------------------------------------
# From surfaces to returns.


class Firings(NamedTuple):
    """Directions of C columns of B beams: azimuths (C, 2), elevations (B, 2), cosines and sines.

    order: (B,) beams in firing order.
    column_offsets_s: (C,) start of each column after the stamp. beam_offsets_s: (B,) delay of each
        beam in its column; seconds.
    """

    azimuths: np.ndarray
    elevations: np.ndarray
    order: np.ndarray
    column_offsets_s: np.ndarray
    beam_offsets_s: np.ndarray


class SensorPath(NamedTuple):
    """Motion of a sensor between K knots.

    matrices: (K, 4, 4), world_from_lidar. turns: (K, 3, 3), cross-product matrix of the unit axis
    of its turn after the knot; angles: (K,), radians of the turn until the next.
    """

    matrices: np.ndarray
    turns: np.ndarray
    angles: np.ndarray


@compiled()
def collect(
    surfaces: Surfaces, noise: np.ndarray, chances: np.ndarray, firings: Firings, limits: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return points, intensity, ring, column, time offset and owner of each return.

    They are in firing order.

    A surface returns energy in proportion to reflectivity and cosine over range squared; below
    the limit the return is lost. The receiver compensates for the range squared only in the far
    field, so intensity is reflectivity * cosine / (1 + (4 range / range_max)^2).

    noise: (B, C) normal, chances: (B, C) uniform.
    limits: range_min, range_max, noise, resolution in metres, dropout, detection limit.
    """
    ranges, owners, cosines, reflectivity = surfaces
    azimuths, elevations, order, column_offsets_s, beam_offsets_s = firings
    near, far, sigma, step, dropout, limit = limits
    size = ranges.size
    points = np.empty((size, 3), np.float32)
    intensity, source = np.empty(size, np.float32), np.empty(size, np.int32)
    ring, column = np.empty(size, np.int16), np.empty(size, np.int32)
    times = np.empty(size, np.float32)
    count = 0
    for c in range(ranges.shape[1]):
        for j in order:
            true = np.float64(ranges[j, c])
            if owners[j, c] == NOTHING or chances[j, c] < dropout:
                continue
            signal = np.float64(reflectivity[j, c]) * np.float64(cosines[j, c])
            if signal * far * far < limit * true * true:
                continue
            measured = true + sigma * np.float64(noise[j, c])
            if step > 0.0:
                measured = step * np.rint(measured / step)
            if measured < near or measured > far:
                continue
            flat = measured * elevations[j, 0]
            points[count, 0], points[count, 1] = flat * azimuths[c, 0], flat * azimuths[c, 1]
            points[count, 2] = measured * elevations[j, 1]
            intensity[count] = signal / (1.0 + (4.0 * true / far) ** 2)
            ring[count], column[count], source[count] = j, c, owners[j, c]
            times[count] = column_offsets_s[c] + beam_offsets_s[j]
            count += 1
    points, intensity, ring = points[:count], intensity[:count], ring[:count]
    return points, intensity, ring, column[:count], times[:count], source[:count]


@compiled()
def interpolate_columns(
    path: SensorPath,
    knots: np.ndarray,
    fractions: np.ndarray,
    azimuths: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Fill origin, direction and z axis of each column, (3, C, 3), from poses at the knots.

    knots, fractions: (C,) knot before each column, and the share of the interval to the next.
    azimuths: (C, 2) cosines and sines.
    """
    matrices, turns, angles = path
    origins, ahead, up = columns[0], columns[1], columns[2]
    step, lidar = np.empty((3, 3)), np.empty((3, 3))
    for c in range(len(knots)):
        k, f = knots[c], fractions[c]
        after = min(k + 1, len(matrices) - 1)
        sine, versine = np.sin(f * angles[k]), 1.0 - np.cos(f * angles[k])
        for i in range(3):
            for j in range(3):
                square = 0.0
                for m in range(3):
                    square += turns[k, i, m] * turns[k, m, j]
                # Rodrigues' formula; a turn about z leaves the z axis as it is, to the bit.
                step[i, j] = (1.0 if i == j else 0.0) + sine * turns[k, i, j] + versine * square
        for i in range(3):
            for j in range(3):
                lidar[i, j] = 0.0
                for m in range(3):
                    lidar[i, j] += matrices[k, i, m] * step[m, j]
            start = matrices[k, i, 3]
            origins[c, i] = start + f * (matrices[after, i, 3] - start)
            ahead[c, i] = azimuths[c, 0] * lidar[i, 0] + azimuths[c, 1] * lidar[i, 1]
            up[c, i] = lidar[i, 2]


# --------------------------------------------------------------------------------------------------
# Rays through rain and fog.


@compiled(borrowing=True)
def add_weather(
    surfaces: Surfaces, echoes: Echoes, extinction_per_m: float, least_power: float, key: np.uint64
) -> None:
    """Add weather between sensor and surfaces, in place; the strongest return of a ray is kept.

    Surfaces lose reflectivity. Where an echo of a drop is stronger it replaces the surface, with
    the reflectivity of a wall of the same brightness.
    extinction_per_m: of the air. least_power: least power that the receiver reports.
    key: of the sweep; an echo depends only on it, the beam and the column.
    """
    ranges, owners, cosines, reflectivity = surfaces
    total_echoes = echoes.tails[-1] if len(echoes.tails) else 0.0
    loudest = np.exp(echoes.log_powers[0]) if len(echoes.tails) else 0.0
    for j in range(ranges.shape[0]):
        for c in range(ranges.shape[1]):
            range_m, expected = np.inf, total_echoes
            if owners[j, c] != NOTHING:
                range_m = np.float64(ranges[j, c])
                reflectivity[j, c] *= np.exp(-2.0 * extinction_per_m * range_m)
                signal = np.float64(reflectivity[j, c]) * np.float64(cosines[j, c])
                power = (
                    signal * _gain(range_m) if signal >= least_power * range_m * range_m else 0.0
                )
                if power > least_power:
                    expected = _tail(echoes, np.log(power)) if power < loudest else 0.0
            if expected <= 0.0:
                continue
            state = mix(key + np.uint64(j * ranges.shape[1] + c) * SPLITMIX_STEP)
            measured, power = _strongest(echoes, range_m, expected, state)
            if measured > 0.0:
                owners[j, c], ranges[j, c], cosines[j, c] = WEATHER, measured, 1.0
                reflectivity[j, c] = power / _gain(measured)


@compiled(borrowing=True)
def _strongest(
    echoes: Echoes, reach: float, expected: float, state: np.uint64
) -> tuple[float, float]:
    """Return range and power of the strongest echo before the surface, zeros if there is none.

    expected: expected number of echoes that are strong enough. The echoes of a Poisson process,
    strongest first, are where its tail passes the sums of exponential paths.
    state: of the ray's own random numbers.
    """
    powers, tails, quantiles = echoes
    expected_so_far = 0.0
    while True:
        expected_so_far -= np.log(_uniform(mix(state + SPLITMIX_STEP)))
        if expected_so_far >= expected:
            break
        k = _last_entry_below(tails, expected_so_far)
        share = max(expected_so_far - tails[k], 0.0) / (tails[k + 1] - tails[k])
        power = np.exp(powers[k] + share * (powers[k + 1] - powers[k]))
        state += SPLITMIX_STEP + SPLITMIX_STEP
        place = _uniform(mix(state)) * (quantiles.shape[1] - 1)
        q = min(int(place), quantiles.shape[1] - 2)
        measured = quantiles[k, q] + (place - q) * (quantiles[k, q + 1] - quantiles[k, q])
        if measured < reach:
            return measured, power
    return 0.0, 0.0


@compiled(borrowing=True)
def _uniform(bits: np.uint64) -> float:
    """Return a number above 0 and up to 1 from 64 random bits."""
    return (np.float64(bits >> np.uint64(11)) + 1.0) * 2.0**-53


@compiled(borrowing=True)
def _last_entry_below(tails: np.ndarray, value: float) -> int:
    """Return the last entry, except the end, whose tail is at most the value."""
    low, high = 0, len(tails) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if tails[middle] <= value:
            low = middle
        else:
            high = middle
    return low


@compiled(borrowing=True)
def _tail(echoes: Echoes, log_power: float) -> float:
    """Return the expected number of echoes stronger than a power."""
    powers, tails, _ = echoes
    step = (powers[-1] - powers[0]) / (len(powers) - 1)
    place = (log_power - powers[0]) / step
    k = min(int(place), len(powers) - 2)
    share = min(place - k, 1.0)
    tail: float = tails[k] + share * (tails[k + 1] - tails[k])
    return tail


@compiled(borrowing=True)
def _gain(reach: float) -> float:
    """Return power over signal: the receiver's share of the beam, over range squared."""
    square = reach * reach
    gain: float = square / (square + OVERLAP_M * OVERLAP_M) ** 2
    return gain


# --------------------------------------------------------------------------------------------------
# Echoes of droplets in the air.

PULSE_M = 0.75
"""Half the length of a light pulse of 5 ns; assumed for all sensors, as are the next three."""
APERTURE_M, DIVERGENCE_RAD = 0.01, 0.003
"""Width of the beam at the sensor, and its growth per metre."""
OVERLAP_M = 5.0
"""Range at which a quarter of the beam is in the receiver's view: lenses 3 cm apart, 3 mrad."""
SAMPLES = 16.0
"""Shape of the gamma distribution of a fog sample: its deviation is a quarter of its mean, as for a
signal at a detection limit of four standard deviations of noise."""

DROPS_PER_M3_MM = 8000.0
LARGEST_MM = 8.0
"""Larger drops break up."""

LEAST_POWER = 1e-9
LEAST_TAIL = 1e-8
POWERS, RANGES, QUANTILES = 256, 600, 257
"""Least power and least expected number of echoes in the tables, and sizes of the tables."""


class Echoes(NamedTuple):
    """The strongest echo of a ray, as tables.

    log_powers: (K,) float64, decreasing to the receiver's limit.
    tails: (K,) float64, expected number of echoes stronger than that, increasing.
    quantiles: (K - 1, Q) float64, metres, range of an echo between two powers at Q
        probabilities from 0 to 1.
    """

    log_powers: np.ndarray
    tails: np.ndarray
    quantiles: np.ndarray


def overlap(ranges: np.ndarray) -> np.ndarray:
    """Return the share of the beam in the receiver's view, 0 to 1, at ranges in metres."""
    square = ranges**2
    share: np.ndarray = (square / (square + OVERLAP_M**2)) ** 2
    return share


def echo_rate(weather: Weather, powers: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Return the rate of echoes stronger than a power, per metre, at a range in metres."""
    gain = overlap(ranges) / ranges**2 * np.exp(-2 * weather.extinction_per_m * ranges)
    if weather.kind == "rain":
        return _drop_rate(weather, powers / gain, ranges)
    if weather.kind == "fog":
        from scipy.special import gammainc

        mean = np.pi * weather.extinction_per_m / weather.lidar_ratio_sr * PULSE_M
        below = gammainc(SAMPLES, SAMPLES * powers / (gain * mean))
        rate: np.ndarray = -np.log(np.maximum(below, 1e-20)) / PULSE_M
        return rate
    return np.zeros(np.broadcast_shapes(powers.shape, ranges.shape))


def _drop_rate(weather: Weather, signal: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Return the rate of drops brighter than a wall of a reflectivity, per metre of beam."""
    area = np.pi / 4 * (APERTURE_M + DIVERGENCE_RAD * ranges) ** 2
    # A drop extinguishes twice its outline; over the beam's area that is extinction times length.
    square = signal * area * weather.lidar_ratio_sr / np.pi / (np.pi / 2)
    least_mm = np.minimum(1e3 * np.sqrt(square), LARGEST_MM)
    slope = 4.1 * weather.rain_rate_mm_h**-0.21
    drops = np.exp(-slope * least_mm) - np.exp(-slope * LARGEST_MM)
    rate: np.ndarray = DROPS_PER_M3_MM / slope * drops * area
    return rate


@lru_cache(maxsize=32)
def echoes(weather: Weather, near_m: float, far_m: float, least_power: float) -> Echoes:
    """Return the tables of echoes from near to far that are stronger than the receiver's limit."""
    edges = np.geomspace(max(near_m, 0.1), far_m, RANGES + 1)
    widths, middles = np.diff(edges), np.sqrt(edges[1:] * edges[:-1])
    least = max(least_power, LEAST_POWER)

    def rates(powers: np.ndarray) -> np.ndarray:
        return echo_rate(weather, powers[:, None], middles) * widths

    coarse = np.geomspace(max(1.0, 2 * least), least, POWERS)
    detectable = np.flatnonzero(rates(coarse).sum(axis=1) > LEAST_TAIL)
    if len(detectable) == 0:
        return Echoes(np.empty(0), np.empty(0), np.empty((0, QUANTILES)))
    powers = np.geomspace(coarse[max(detectable[0] - 1, 0)], least, POWERS)
    rate = rates(powers)
    between = np.cumsum(np.maximum(np.diff(rate, axis=0), 0) + 1e-300, axis=1)
    shares = np.column_stack([np.zeros(POWERS - 1), between / between[:, -1:]])
    # The nearest and farthest ten-thousandth of the echoes are moved slightly inwards.
    chances = np.linspace(0, 1, QUANTILES).clip(5e-5, 1 - 5e-5)
    quantiles = np.stack([np.interp(chances, share, edges) for share in shares])
    return Echoes(np.log(powers), rate.sum(axis=1), quantiles)


# --------------------------------------------------------------------------------------------------
# One sweep of a scanning LiDAR through a moving scene.

LidarPath = Sequence[Pose] | Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""`world_from_lidar` at the scene's knots, or a function from (T,) stamps to (T, 3, 3) rotations
and (T, 3) positions."""


@dataclass(frozen=True, slots=True, eq=False)
class SweepTruth(Record):
    """The true sources of the returns of a scan.

    owners: (N,) int32, per return the actor's row, `GROUND`, `WEATHER`, or otherwise -2 and
        below for scenery.
    returns: (A,) int64, returns per actor.
    occluded_fraction: (A,) float64, share of the rays on the actor's outline that hit something
        else first; 1 without such rays.
    """

    owners: np.ndarray
    returns: np.ndarray
    occluded_fraction: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            owners=(np.int32, ("N",)),
            returns=(np.int64, ("A",)),
            occluded_fraction=(np.float64, ("A",)),
        )


def sweep(
    scene: Scene,
    spec: LidarSpec,
    world_from_lidar: LidarPath,
    stamp_s: float,
    *,
    sensor: str = "lidar",
    rng: np.random.Generator,
    weather: Weather = CLEAR,
    weather_seed: int = 0,
) -> tuple[LidarScan, SweepTruth]:
    """Measure one sweep whose middle is at the stamp; sensor and bodies move meanwhile.

    All beams of a column are cast at the column's start and azimuth: within a column of tens of
    microseconds nothing on a road moves by more than 2 mm. A real Velodyne also turns by about
    0.13 deg while the beams of a column fire one after the other, 0.1 m across at 50 m; here
    points have the azimuth of their column, so scans agree with their stated geometry. Noise
    depends only on `rng`, and each ray's noise does not depend on the scene; echoes of rain and
    fog depend on the weather, its seed and the stamp.
    """
    columns = lidar_columns(scene, spec, world_from_lidar, stamp_s)
    hits = cast(
        scene, columns, np.tan(spec.elevations), max_range_m=spec.range_max_m, outlines=True
    )
    if weather.kind != "clear":
        nanoseconds = int(np.rint(stamp_s * 1e9)) % 2**64
        key = np.random.SeedSequence([weather_seed, nanoseconds]).generate_state(1, np.uint64)[0]
        _add_weather(spec, hits, weather, key)
    return _measure(spec, hits, stamp_s, sensor, rng)


def lidar_columns(
    scene: Scene, spec: LidarSpec, world_from_lidar: LidarPath, stamp_s: float
) -> Columns:
    """Return the columns of a sweep, in firing order, world frame.

    Between the scene's knots the sensor moves and turns at constant rates.
    """
    stamps_s = stamp_s + spec.column_offsets_s()
    azimuths = _directions(spec.azimuths())
    if callable(world_from_lidar):
        rotations, positions = world_from_lidar(stamps_s)
        ahead = np.einsum("cij,cj->ci", rotations[:, :, :2], azimuths)
        return Columns(positions, ahead, rotations[:, :, 2], stamps_s)
    if len(world_from_lidar) != len(scene.knots_s):
        raise RecordError(
            f"one pose a knot: {len(scene.knots_s)} knots, {len(world_from_lidar)} poses"
        )
    matrices = np.stack([pose.matrix for pose in world_from_lidar])
    starts = matrices[:, :3, :3]
    turns, angles = _turns(np.swapaxes(starts, 1, 2) @ np.concatenate([starts[1:], starts[-1:]]))
    columns = np.empty((3, len(stamps_s), 3))
    knots, fractions = scene.segments(stamps_s)
    interpolate_columns(SensorPath(matrices, turns, angles), knots, fractions, azimuths, columns)
    return Columns(columns[0], columns[1], columns[2], stamps_s)


def _turns(rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return cross-product matrices of the unit axes, and angles in radians below half a turn."""
    skew = 0.5 * (rotations - np.swapaxes(rotations, 1, 2))
    sines = np.sqrt(0.5 * (skew**2).sum(axis=(1, 2)))
    cosines = 0.5 * (np.trace(rotations, axis1=1, axis2=2) - 1)
    return skew / np.where(sines > 0, sines, 1)[:, None, None], np.arctan2(sines, cosines)


def _add_weather(spec: LidarSpec, hits: Hits, weather: Weather, key: np.uint64) -> None:
    """Apply the extinction of the weather to the hits, in place, and add its echoes."""
    least = max(spec.detection_limit / spec.range_max_m**2, LEAST_POWER)
    add_weather(
        _surfaces(hits),
        echoes(weather, spec.range_min_m, spec.range_max_m, least),
        weather.extinction_per_m,
        least,
        key,
    )


def _surfaces(hits: Hits) -> Surfaces:
    """Return views of the hits by beam, as they are stored; writes change the hits."""
    return Surfaces(hits.ranges.T, hits.owners.T, hits.cosines.T, hits.reflectivity.T)


def _measure(
    spec: LidarSpec, hits: Hits, stamp_s: float, sensor: str, rng: np.random.Generator
) -> tuple[LidarScan, SweepTruth]:
    shape = hits.ranges.T.shape
    noise = rng.standard_normal(shape, np.float32)
    chances = rng.random(shape, np.float32)
    order = np.argsort(spec.firing_offsets_s, kind="stable")
    limits = np.array(
        [
            spec.range_min_m,
            spec.range_max_m,
            spec.range_noise_m,
            spec.range_resolution_m,
            spec.dropout,
            spec.detection_limit,
        ]
    )
    firings = Firings(
        _directions(spec.azimuths()),
        _directions(spec.elevations),
        order,
        spec.column_offsets_s(),
        spec.firing_offsets_s,
    )
    points, intensity, ring, column, times, owners = collect(
        _surfaces(hits), noise, chances, firings, limits
    )
    scan = LidarScan(points, intensity, ring, column, times, stamp_s, sensor)
    assert hits.outline_rays is not None
    assert hits.outline_hits is not None
    actors = len(hits.outline_rays)
    hidden = 1 - hits.outline_hits / np.maximum(hits.outline_rays, 1)
    return scan, SweepTruth(owners, np.bincount(owners[owners >= 0], minlength=actors), hidden)


def _directions(angles: np.ndarray) -> np.ndarray:
    """Return cosines and sines, (N, 2)."""
    return np.column_stack([np.cos(angles), np.sin(angles)])
