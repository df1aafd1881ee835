"""Places in a replay as small whole numbers: poses, lanes, and what to look at.

Planar poses are (N, 3): x, y, metres, and yaw, radians.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from roadscope.benchmarks.cache import read_kept
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.nodes.traffic import TrafficNode
from roadscope.core import RecordError

VIEW_M = 12.0
"""Margin of a view around what went wrong; chosen by hand."""
LANE_TOLERANCE_M = 0.15
"""Points of a lane that are nearer than this to its simplified line are left out."""
DECIMETRES, CENTIRADIANS = 10.0, 100.0


class LaneStrip(msgspec.Struct, frozen=True, array_like=True):
    """A lane: width, decimetres, and x, y of its points, the first one, then differences."""

    width: int
    points: list[int]


def planar(poses: np.ndarray) -> np.ndarray:
    """Return (N, 4, 4) poses as planar ones."""
    return np.column_stack([poses[:, :2, 3], np.arctan2(poses[:, 1, 0], poses[:, 0, 0])])


def moved_into(poses: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return planar poses in the frame of another one."""
    cos, sin = np.cos(origin[2]), np.sin(origin[2])
    x, y = (poses[:, :2] - origin[:2]).T
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, poses[:, 2] - origin[2]])


def focus_on(points: np.ndarray) -> tuple[int, int, int, int]:
    """Return the centre, half length and half width of a view of (N, 2) points."""
    low, high = points.min(axis=0) - VIEW_M, points.max(axis=0) + VIEW_M
    x, y, length, width = np.rint(np.append(low + high, high - low) / 2 * DECIMETRES).astype(int)
    return int(x), int(y), int(length), int(width)


def motion_of(poses: np.ndarray) -> list[int]:
    """Return planar poses as whole numbers: the first, then differences."""
    unwrapped = np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])])
    scaled = np.rint(unwrapped * (DECIMETRES, DECIMETRES, CENTIRADIANS)).astype(int)
    return _differences(scaled)


def _differences(rows: np.ndarray) -> list[int]:
    return [int(value) for value in np.diff(rows, axis=0, prepend=0 * rows[:1]).ravel()]


def lanes_of(episode: Episode) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the lanes of an episode's road; none if its traffic is not kept."""
    node = TrafficNode.of(episode)
    try:
        return read_kept(node.path, node.record.load).road.lanes()
    except (OSError, RecordError):
        return []


def near_lanes(
    lanes: Sequence[tuple[np.ndarray, np.ndarray]],
    origin: np.ndarray,
    egos: np.ndarray,
    reach_m: float,
) -> list[LaneStrip]:
    """Return the parts of lanes that come near the ego, with no more points than bends need."""
    shown = []
    for points, widths in lanes:
        close = np.zeros(len(points), bool)
        for ego in egos[:: max(1, len(egos) // 8)]:
            close |= np.linalg.norm(points - ego[:2], axis=1) <= 1.5 * reach_m
        rows = np.flatnonzero(close)
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            if len(part) > 1:
                poses = np.column_stack([points[part], np.zeros(len(part))])
                line = _simplified(moved_into(poses, origin)[:, :2])
                width = round(float(np.median(widths[part])) * DECIMETRES)
                shown.append(LaneStrip(width, _differences(np.rint(line * DECIMETRES).astype(int))))
    return shown


def _simplified(line: np.ndarray) -> np.ndarray:
    """Return a line with no more points than bends need (Douglas and Peucker 1973)."""
    chord = line[-1] - line[0]
    offsets = line - line[0]
    length = float(np.hypot(*chord))
    if length > 0:
        distances = np.abs(chord[0] * offsets[:, 1] - chord[1] * offsets[:, 0]) / length
    else:
        distances = np.hypot(*offsets.T)
    farthest = int(np.argmax(distances))
    if distances[farthest] <= LANE_TOLERANCE_M:
        return line[[0, -1]]
    before, after = _simplified(line[: farthest + 1]), _simplified(line[farthest:])
    return np.vstack([before[:-1], after])
