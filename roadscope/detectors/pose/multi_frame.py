"""Pose from frames in a row, tied by their motion (Zhang 2017, section 3)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from math import isfinite
from typing import Unpack

import numpy as np

from roadscope.detectors.pose.estimate import (
    VehiclePose,
    check_spread,
    settled_origin,
    settled_points,
)
from roadscope.detectors.pose.matched_filter import Reading, settled_reading
from roadscope.detectors.pose.rotating_pair import Frames, best_pair


def fit_multi(
    frames: Sequence[np.ndarray],
    origins: Sequence[np.ndarray],
    stamps_s: Sequence[float] | np.ndarray,
    *,
    length_m: float,
    width_m: float,
    at: int | None = None,
    tied: bool = True,
    **reading: Unpack[Reading],
) -> VehiclePose:
    """Return the rectangle of known size in one of F frames, fitted to all (Zhang 2017, eq. 10-12).

    frames: F arrays (N, 2) of one vehicle's returns in metres, one fixed frame for all, at least
    one return in each. origins: F (2,) places of the sensor in it. stamps_s: F stamps, rising.
    at: index of the frame whose pose is returned, the middle one if left out; -1, the newest, is
    the causal use. The rest as in `fit_single`. yaw points the way the body moved, or away from
    the sensor where it hardly did.

    All frames share heading and place across it; along it they are moved by v * ds with one v
    that is searched. Not tied, each frame has its own shift, which is the weaker assumption of
    figure 4: then the velocity is the slope of the shifts.
    """
    stamps = _settled_stamps(stamps_s, len(frames), len(origins))
    frame, places = _settled_frame(at, len(frames)), np.array(origins, np.float64)
    if places.shape != (len(frames), 2) or not np.isfinite(places).all():
        places = np.array([settled_origin(o) for o in origins])
    settings, plan = settled_reading(length_m, width_m, **reading)
    if not all(len(points) for points in frames):
        raise ValueError("a pose needs at least 1 point in each frame, got none in one")
    points, starts = settled_points(np.concatenate(frames)), [0, *accumulate(map(len, frames))]
    for first, last in pairwise(starts):
        check_spread(points[first:last])
    seen = Frames(points, np.array(starts), places, stamps, frame)
    x, y, yaw, score = best_pair(seen, settings, plan._replace(tied=tied))
    return VehiclePose(x, y, yaw, length_m, width_m, score=score)


def _settled_stamps(
    stamps_s: Sequence[float] | np.ndarray, frames: int, origins: int
) -> np.ndarray:
    stamps = np.asarray(stamps_s, np.float64)
    if not frames:
        raise ValueError("a multi-frame fit needs at least 1 frame, got none")
    if stamps.shape != (frames,) or origins != frames:
        raise ValueError(
            f"frames, origins and stamps must be as many, got {frames}, {origins}, {stamps.shape}"
        )
    if not all(map(isfinite, stamps)) or not all(a < b for a, b in pairwise(stamps)):
        raise ValueError(f"stamps must be finite and rising, got {stamps}")
    return stamps


def _settled_frame(at: int | None, frames: int) -> int:
    if at is None:
        return frames // 2
    if not -frames <= at < frames:
        raise ValueError(f"at must name one of {frames} frames, got {at}")
    return at % frames
