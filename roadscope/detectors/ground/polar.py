"""Ground removal by straight lines in polar segments (Himmelsbach et al. 2010).

M. Himmelsbach, F. von Hundelshausen and H.-J. Wuensche, "Fast segmentation of 3D point clouds for
ground vehicles", Intelligent Vehicles Symposium 2010, section III.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud

MOST_BINS = 4096
"""The last bin of a segment takes all that lies beyond."""
BELIEVED = 3
"""Least measured prototypes of a line: two of one bumper, or any two, lie on one."""


@dataclass(frozen=True, slots=True)
class PolarRule:
    """When prototypes are a line of the ground; the paper's letters, its values are not printed.

    slope (T_m): a road rises by 15 % at most.
    flat_slope (T_m_small), intercept_m (T_b): a line that hardly rises must begin at the height
        of the wheels, or it is a roof or a loading bed.
    residual_m (T_RMSE): root mean square about the line; lanes are crowned by less. The prototype
        that is added lies within twice that, for one alone hardly changes a long line's mean.
    resume_m (T_dprev): a line begins this near to where the one before goes; below the sills of
        vehicles.
    """

    slope: float = 0.15
    flat_slope: float = 0.02
    intercept_m: float = 0.3
    residual_m: float = 0.05
    resume_m: float = 0.3


RULE = PolarRule()


def polar_above_ground(
    cloud: Cloud,
    *,
    segment_deg: float = 1.0,
    bin_m: float = 0.5,
    clear_m: float = 0.2,
    ceiling_m: float = 2.5,
    rule: PolarRule = RULE,
) -> np.ndarray:
    """Keep what stands above lines fitted to polar segments (Himmelsbach 2010).

    Returns (N,) bool, true for returns that are kept.

    Segments of `segment_deg` around the sensor are cut into bins of `bin_m`; lines are fitted to
    the lowest return of each bin from the sensor outwards, and what lies more than `clear_m`
    above the nearest line stands. Returns more than `ceiling_m` above it are dropped, as by the
    grid.

    Readings taken. A line is believed from three measured prototypes on. The ground under the
    sensor, which no beam reaches, is known from the calibration: it is the first prototype and,
    until a line is believed, the plane on which the wheels stand is the ground; so the rule holds
    for a blind near zone and for four layers of which two meet the ground. The first two
    prototypes of a line, not the first alone, lie near to where the line before goes: a roof and
    the ground under the sensor are no ramp. What lies below a line is ground too.
    """
    if not len(cloud):
        return np.zeros(0, bool)
    origin, segments = cloud.origin, max(1, round(360 / segment_deg))
    segment, reach = _polar(cloud.points, origin, segments)
    bins = int(min(reach.max() // bin_m + 1, MOST_BINS))
    prototypes = _prototypes(cloud.points[:, 2], segment, reach, (segments, bins, bin_m))
    bounds = (rule.slope, rule.flat_slope, rule.intercept_m, rule.residual_m, rule.resume_m)
    lines = _ground_lines(*prototypes, bounds)
    heights = _heights(cloud.points[:, 2], segment, reach, lines, bin_m)
    mask: np.ndarray = (heights > clear_m) & (heights < ceiling_m)
    return mask


@compiled()
def _polar(points: np.ndarray, origin: np.ndarray, segments: int) -> tuple[np.ndarray, np.ndarray]:
    """Return segment and range in metres of each point, (N,)."""
    segment, reach = np.empty(len(points), np.int64), np.empty(len(points))
    for row in range(len(points)):
        x, y = points[row, 0] - origin[0], points[row, 1] - origin[1]
        turn = (np.arctan2(y, x) / (2 * np.pi) + 0.5) * segments
        segment[row], reach[row] = min(int(turn), segments - 1), np.sqrt(x * x + y * y)
    return segment, reach


@compiled()
def _prototypes(
    z: np.ndarray, segment: np.ndarray, reach: np.ndarray, table: tuple[int, int, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return range and height of the lowest point of each bin, (S, B); inf where there is none.

    Of equally low points the nearest counts.
    """
    segments, bins, bin_m = table
    ranges, heights = np.full((segments, bins), np.inf), np.full((segments, bins), np.inf)
    for row in range(len(z)):
        s, b = segment[row], min(int(reach[row] / bin_m), bins - 1)
        lower = z[row] < heights[s, b]
        if lower or (z[row] == heights[s, b] and reach[row] < ranges[s, b]):
            ranges[s, b], heights[s, b] = reach[row], z[row]
    return ranges, heights


@compiled()
def _ground_lines(
    ranges: np.ndarray, heights: np.ndarray, bounds: tuple[float, float, float, float, float]
) -> np.ndarray:
    """Return slope and height at the sensor of the ground line of each bin, (S, B, 2)."""
    segments, bins = ranges.shape
    nearest = np.empty((segments, bins, 2))
    ends, lines = np.empty((bins + 2, 2), np.int64), np.empty((bins + 2, 2))
    for s in range(segments):
        count = _segment_lines(ranges[s], heights[s], bounds, ends, lines)
        current = 0
        for b in range(bins):
            while current + 1 < count and ends[current + 1, 0] - b < b - ends[current, 1]:
                current += 1
            nearest[s, b] = lines[current]
    return nearest


@compiled()
def _segment_lines(
    ranges: np.ndarray,
    heights: np.ndarray,
    bounds: tuple[float, float, float, float, float],
    ends: np.ndarray,
    lines: np.ndarray,
) -> int:
    """Fill first and last bin, slope and offset of a segment's lines; return how many there are.

    Algorithm 1 of the paper.
    """
    _, _, _, residual_m, resume_m = bounds
    ends[0], lines[0] = 0, 0.0
    count, first, foot = 1, 0, 1
    sums = np.zeros(6)
    sums[0] = 1.0
    for b in range(len(ranges)):
        r, z = ranges[b], heights[b]
        if z == np.inf:
            continue
        if sums[0] >= 2:
            slope, offset, residual = _fit(sums, r, z)
            off = max(residual, abs(z - slope * r - offset) / 2)
            if not _is_ground(slope, offset, bounds) or off > residual_m:
                sums[:], foot = 0.0, 0
                continue
            _add(sums, r, z)
            if sums[0] < BELIEVED + foot:
                continue
            # A line that holds the sensor's foot takes the place of the wheels' plane.
            count += sums[0] == BELIEVED and not foot
            ends[count - 1, 0], ends[count - 1, 1] = first, b
            lines[count - 1, 0], lines[count - 1, 1] = slope, offset
        elif abs(z - lines[count - 1, 0] * r - lines[count - 1, 1]) <= resume_m:
            first = b if sums[0] == 0 else first
            _add(sums, r, z)
    return count


@compiled()
def _fit(sums: np.ndarray, r: float, z: float) -> tuple[float, float, float]:
    """Return slope, height at range 0 and residual of the line through a set and one more point.

    sums: number, r, z, r^2, rz and z^2 of the set. A set has one point a bin, so its ranges
    differ.
    """
    n = sums[0] + 1
    mean_r, mean_z = (sums[1] + r) / n, (sums[2] + z) / n
    rr = (sums[3] + r * r) / n - mean_r * mean_r
    rz = (sums[4] + r * z) / n - mean_r * mean_z
    zz = (sums[5] + z * z) / n - mean_z * mean_z
    slope = rz / rr
    return slope, mean_z - slope * mean_r, np.sqrt(max(zz - slope * rz, 0.0))


@compiled()
def _add(sums: np.ndarray, r: float, z: float) -> None:
    sums[0] += 1
    sums[1] += r
    sums[2] += z
    sums[3] += r * r
    sums[4] += r * z
    sums[5] += z * z


@compiled()
def _is_ground(
    slope: float, offset: float, bounds: tuple[float, float, float, float, float]
) -> bool:
    """Whether a line may be one of the ground (Algorithm 1, line 6)."""
    most, flat, intercept_m, _, _ = bounds
    return abs(slope) <= most and (abs(slope) > flat or abs(offset) <= intercept_m)


@compiled()
def _heights(
    z: np.ndarray, segment: np.ndarray, reach: np.ndarray, lines: np.ndarray, bin_m: float
) -> np.ndarray:
    """Return the height of each point above the line of its bin, (N,) metres."""
    heights = np.empty(len(z))
    for row in range(len(z)):
        line = lines[segment[row], min(int(reach[row] / bin_m), lines.shape[1] - 1)]
        heights[row] = z[row] - line[0] * reach[row] - line[1]
    return heights
