"""Validators of what plug-ins answer, one for each kind.

Records check shapes, dtypes and values when they are made. These functions check the rest: that
an answer is a record of the right class, of the right moment and in a possible frame. The
harness and the contract kit use the same ones. They return the answer, or raise `AnswerError`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from roadscope.core.detections import Detections, ImageDetections
from roadscope.core.driving import DrivingCommand
from roadscope.core.fused import FusedDetections
from roadscope.core.odometry import OdometryEstimate
from roadscope.core.tracks import Tracks

R = TypeVar("R")

STAMP_TOLERANCE_S = 1e-6
FARTHEST_POSE_M = 1e6
"""A pose farther from the start along any axis is refused: no drive is that long."""
MOST_OBJECTS = 2000
"""Most objects in an answer; nuScenes allows 500. Matching them takes space for all pairs."""
MOST_MASSES = 16
"""Most columns of masses, one for each set of classes; chosen by hand."""
GREATEST_VALUE = 1e12
"""Lengths, speeds and covariances beyond it are refused: squares of values far larger overflow."""


class AnswerError(ValueError):
    """A plug-in's answer breaks the contract; the message says how."""


def same_stamp(one_s: float, other_s: float) -> bool:
    """Return whether two stamps, seconds, are of the same moment."""
    return abs(one_s - other_s) <= STAMP_TOLERANCE_S


def check_detections(answer: Any, *, stamps_s: Sequence[float]) -> Detections:
    """Return a LiDAR detector's answer to the last frame.

    stamps_s: stamps of all frames so far. A detector may answer an earlier frame.
    """
    detections = _of_class(answer, Detections, "detect")
    _check_count(detections, "detections")
    _check_values(detections, ("centres", "sizes", "yaws"))
    _check_frame(detections.frame, ("ego", "world"), "detections")
    if not any(same_stamp(detections.stamp_s, stamp_s) for stamp_s in reversed(stamps_s)):
        raise AnswerError(
            f"detections are stamped {detections.stamp_s:.6g} s, their frame is at "
            f"{stamps_s[-1]:.6g} s and no earlier frame has that stamp; return the stamp of the "
            "frame that is answered"
        )
    return detections


def check_image_detections(answer: Any, *, stamp_s: float) -> ImageDetections:
    """Return a camera detector's answer to the image at a stamp."""
    detections = _of_class(answer, ImageDetections, "detect")
    _check_count(detections, "detections")
    _check_values(detections, ("boxes",))
    _check_stamp(detections.stamp_s, stamp_s, "detections", "image")
    return detections


def check_tracks(answer: Any, *, stamp_s: float, posed: bool, method: str = "update") -> Tracks:
    """Return a tracker's answer to the detections at a stamp.

    stamp_s: of the detections, seconds.
    posed: whether the tracker got the ego's pose; only then may it answer in frame `world`.
    method: the tracker's method that answered, for error texts.
    """
    tracks = _of_class(answer, Tracks, method)
    _check_count(tracks, "tracks")
    _check_values(tracks, ("centres", "sizes", "yaws", "velocities", "covariances"))
    _check_stamp(tracks.stamp_s, stamp_s, "tracks", "frame")
    possible = ("ego", "world") if posed else ("ego",)
    _check_frame(tracks.frame, possible, "tracks", "" if posed else " without an ego pose")
    return tracks


def check_rescored(
    answer: Any, *, stamps_s: Sequence[float], posed: Sequence[bool]
) -> tuple[Tracks, ...]:
    """Return an offline tracker's answer to the history of an episode, one record a frame.

    posed: for each frame whether the tracker got the ego's pose.
    """
    if not isinstance(answer, Sequence) or isinstance(answer, str):
        raise AnswerError(f"rescored returned {type(answer).__name__}, not a sequence of Tracks")
    if len(answer) != len(stamps_s):
        raise AnswerError(
            f"rescored returned {len(answer)} records for {len(stamps_s)} frames; answer every "
            "frame, also those without tracks"
        )
    return tuple(
        check_tracks(tracks, stamp_s=stamp_s, posed=has_pose, method="rescored")
        for tracks, stamp_s, has_pose in zip(answer, stamps_s, posed, strict=True)
    )


def check_fused(answer: Any, *, stamp_s: float) -> FusedDetections:
    """Return a fusion's answer to the detections of one moment.

    stamp_s: of the LiDAR detections, or of the camera's if the LiDAR has none.
    """
    fused = _of_class(answer, FusedDetections, "fuse")
    _check_count(fused, "targets")
    _check_values(fused, ("centres", "sizes", "yaws", "distances_m", "image_boxes"))
    _check_stamp(fused.stamp_s, stamp_s, "targets", "scan (or image, if there is no scan)")
    return fused


def check_estimate(answer: Any, *, stamp_s: float, returns: int) -> OdometryEstimate:
    """Return an odometry's answer to a scan. returns: how many returns the scan has."""
    estimate = _of_class(answer, OdometryEstimate, "update")
    _check_stamp(estimate.stamp_s, stamp_s, "the estimate", "scan")
    if len(estimate.dynamic) != returns:
        raise AnswerError(f"dynamic has {len(estimate.dynamic)} values for {returns} returns")
    _check_values(estimate, ("covariance",))
    farthest_m = float(np.abs(estimate.start_from_lidar.translation).max())
    if not farthest_m <= FARTHEST_POSE_M:
        raise AnswerError(f"the pose is {farthest_m:.3g} m from the start")
    return estimate


def check_command(answer: Any, *, lanes: int) -> DrivingCommand:
    """Return a driver's answer to a scene with so many lanes."""
    command = _of_class(answer, DrivingCommand, "drive")
    if not 0 <= command.target_lane < lanes:
        raise AnswerError(f"target_lane {command.target_lane}; there are lanes 0 to {lanes - 1}")
    _check_values(command, ("acceleration_m_s2",))
    return command


def check_masses(masses: np.ndarray | None, columns: set[int]) -> None:
    """Raise `AnswerError` unless masses have as many columns as in earlier answers.

    columns: the numbers of columns of earlier answers; that of these masses is added.
    """
    if masses is None or not len(masses):
        return
    count = masses.shape[1]
    columns.add(count)
    if len(columns) > 1 or count > MOST_MASSES:
        raise AnswerError(
            f"masses of {' and '.join(map(str, sorted(columns)))} columns; give the same number in "
            f"every answer, at most {MOST_MASSES}"
        )


def _of_class(answer: Any, expected: type[R], method: str) -> R:
    if not isinstance(answer, expected):
        # The wire makes a tuple of a list.
        returned = "a list or tuple" if isinstance(answer, tuple) else type(answer).__name__
        raise AnswerError(f"{method} returned {returned}, not {expected.__name__}")
    return answer


def _check_stamp(stamp_s: float, expected_s: float, what: str, whose: str) -> None:
    if not same_stamp(stamp_s, expected_s):
        raise AnswerError(
            f"{what}: stamped {stamp_s:.6g} s, but their {whose} is at {expected_s:.6g} s"
        )


def _check_frame(frame: str, possible: Sequence[str], what: str, remark: str = "") -> None:
    if frame not in possible:
        raise AnswerError(f"{what} in frame '{frame}'{remark}; possible: {', '.join(possible)}")


def _check_count(
    answer: Detections | ImageDetections | Tracks | FusedDetections, what: str
) -> None:
    if len(answer) > MOST_OBJECTS:
        raise AnswerError(f"{len(answer)} {what} in an answer; at most {MOST_OBJECTS} are possible")


def _check_values(answer: object, names: Sequence[str]) -> None:
    for name in names:
        greatest = float(np.abs(getattr(answer, name)).max(initial=0.0))
        if greatest > GREATEST_VALUE:
            raise AnswerError(
                f"{type(answer).__name__}.{name}: a value of {greatest:.3g}, more than "
                f"{GREATEST_VALUE:g}"
            )
