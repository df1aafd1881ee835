"""Ground removal by straight lines in polar segments (Himmelsbach et al. 2010).

M. Himmelsbach, F. von Hundelshausen and H.-J. Wuensche, "Fast segmentation of 3D point clouds for
ground vehicles", Intelligent Vehicles Symposium 2010, section III.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud

MOST_BINS = 4096
"""Most bins of a segment; the last one also takes all returns beyond it."""
LEAST_PROTOTYPES = 3
"""A line of the ground needs so many measured prototypes: any two points lie on a line, even two of
one bumper."""


class PolarRule(NamedTuple):
    """Which prototypes form a line of the ground.

    The paper's letters stand in brackets. It does not print its values; ours are chosen by hand.

    slope (T_m): greatest slope; roads rise by 15 % at most.
    flat_slope (T_m_small), intercept_m (T_b): a line of less than this slope has to begin within
        `intercept_m` of the height of the wheels. Otherwise it is a roof or a loading bed.
    residual_m (T_RMSE): greatest root mean square about the line; the crown of a lane is less. A
        prototype that is added lies within twice that, because one alone hardly changes the mean
        of a long line.
    resume_m (T_dprev): greatest distance between the first prototypes of a line and the line before
        it; vehicles' sills are higher.
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
    """Keep returns above lines fitted to the ground in polar segments (Himmelsbach 2010).

    Returns (N,) bool, true for returns that are kept.

    Segments of `segment_deg` around the sensor are cut into bins of `bin_m`. The lowest return of a
    bin is its prototype. Lines are fitted to the prototypes from the sensor outwards. Returns from
    `clear_m` to `ceiling_m` above the nearest line are kept.

    Where the paper leaves a choice: a line needs three measured prototypes. The ground under the
    sensor, which no beam reaches, is known from the calibration. It is the first prototype, and the
    plane on which the wheels stand is the ground until the first line is found. So the rule also
    works with a blind near zone, and with four layers of which two meet the ground. Not only the
    first prototype of a line but also the second lies near the line before it; otherwise a roof and
    the ground under the sensor would form a ramp. Whatever lies below a line is ground, too. The
    defaults are chosen by hand.
    """
    if not len(cloud):
        return np.zeros(0, bool)
    segments = max(1, round(360 / segment_deg))
    segment, reach = _polar(cloud.points, cloud.origin, segments)
    bins = int(min(reach.max() // bin_m + 1, MOST_BINS))
    heights = np.ascontiguousarray(cloud.points[:, 2])
    returns = PolarReturns(segment, reach, heights, segments, bins, bin_m)
    above = _heights_above_lines(returns, *_prototypes(returns), rule)
    mask: np.ndarray = (above > clear_m) & (above < ceiling_m)
    return mask


class PolarReturns(NamedTuple):
    """Returns in segments around the sensor that are cut into bins.

    segment: (N,) int64. reach, height: (N,) metres, range and z. segments: how many there are.
    bins, bin_m: how many a segment has, and the length of each in metres.
    """

    segment: np.ndarray
    reach: np.ndarray
    height: np.ndarray
    segments: int
    bins: int
    bin_m: float


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
def _prototypes(returns: PolarReturns) -> tuple[np.ndarray, np.ndarray]:
    """Return range and height of the lowest point of each bin, (S, B); inf where there is none.

    Of equally low points the nearest counts.
    """
    shape = (returns.segments, returns.bins)
    ranges, heights = np.full(shape, np.inf), np.full(shape, np.inf)
    for row in range(len(returns.reach)):
        r, z = returns.reach[row], returns.height[row]
        s, b = returns.segment[row], min(int(r / returns.bin_m), returns.bins - 1)
        if z < heights[s, b] or (z == heights[s, b] and r < ranges[s, b]):
            ranges[s, b], heights[s, b] = r, z
    return ranges, heights


@compiled()
def _heights_above_lines(
    returns: PolarReturns, ranges: np.ndarray, heights: np.ndarray, rule: PolarRule
) -> np.ndarray:
    """Return the height of each return above the ground line nearest to its bin, (N,) metres.

    ranges, heights: (S, B) metres, the prototypes.
    """
    slopes, offsets = np.empty((2, returns.segments, returns.bins))
    ends, lines = np.empty((returns.bins + 2, 2), np.int64), np.empty((returns.bins + 2, 2))
    for s in range(returns.segments):
        count = _segment_lines(ranges[s], heights[s], rule, ends, lines)
        current = 0
        for b in range(returns.bins):
            while current + 1 < count and ends[current + 1, 0] - b < b - ends[current, 1]:
                current += 1
            slopes[s, b], offsets[s, b] = lines[current]
    above = np.empty(len(returns.reach))
    for row in range(len(above)):
        r, s = returns.reach[row], returns.segment[row]
        b = min(int(r / returns.bin_m), returns.bins - 1)
        above[row] = returns.height[row] - slopes[s, b] * r - offsets[s, b]
    return above


@compiled()
def _segment_lines(
    ranges: np.ndarray, heights: np.ndarray, rule: PolarRule, ends: np.ndarray, lines: np.ndarray
) -> int:
    """Fill first and last bin, slope and offset of a segment's lines; return how many there are.

    Algorithm 1 of the paper. Each point of a line is in another bin, so their ranges differ.

    ranges, heights: (B,) metres, prototypes of the segment, inf for none. ends, lines: (B + 2, 2),
    filled in.
    """
    ends[0], lines[0] = 0, 0.0
    # under_sensor: 1 while the points of the line include the ground under the sensor, else 0.
    count, first, under_sensor = 1, 0, 1
    # How many points the line has, and the sums of r, z, r^2, rz and z^2 over them.
    size, sum_r, sum_z, sum_rr, sum_rz, sum_zz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for b in range(len(ranges)):
        r, z = ranges[b], heights[b]
        if z == np.inf:
            continue
        if size >= 2:
            n = size + 1
            mean_r, mean_z = (sum_r + r) / n, (sum_z + z) / n
            rr = (sum_rr + r * r) / n - mean_r * mean_r
            rz = (sum_rz + r * z) / n - mean_r * mean_z
            zz = (sum_zz + z * z) / n - mean_z * mean_z
            slope = rz / rr
            offset = mean_z - slope * mean_r
            residual = max(np.sqrt(max(zz - slope * rz, 0.0)), abs(z - slope * r - offset) / 2)
            # Line 6 of the algorithm.
            steep = abs(slope) > rule.slope
            high = abs(slope) <= rule.flat_slope and abs(offset) > rule.intercept_m
            if steep or high or residual > rule.residual_m:
                size, sum_r, sum_z, sum_rr, sum_rz, sum_zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                under_sensor = 0
                continue
            if n >= LEAST_PROTOTYPES + under_sensor:
                # A line that includes the ground under the sensor replaces the wheels' plane.
                count += n == LEAST_PROTOTYPES and not under_sensor
                ends[count - 1, 0], ends[count - 1, 1] = first, b
                lines[count - 1, 0], lines[count - 1, 1] = slope, offset
        elif abs(z - lines[count - 1, 0] * r - lines[count - 1, 1]) <= rule.resume_m:
            first = b if size == 0 else first
        else:
            continue
        size, sum_r, sum_z = size + 1, sum_r + r, sum_z + z
        sum_rr, sum_rz, sum_zz = sum_rr + r * r, sum_rz + r * z, sum_zz + z * z
    return count
