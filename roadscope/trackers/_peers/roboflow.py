"""SORT, ByteTrack and OC-SORT of Roboflow's `trackers`, on boxes in bird's-eye view.

Boxes are the smallest along the axes of the world that hold a detection. The noise of the filters
is fixed in pixels and frames. The size of a pixel changes neither gains nor pairs, only the
covariances. With one pixel for a metre, SORT and ByteTrack assume standard deviations of 0.3 m for
detections and 10 m/s for the velocity of new targets, and a velocity walk of 3 m/s per root second.

A new car moves by much of its length between two ticks, so overlaps are those of grown boxes
(`BIoU`): grown by an eighth on every side, two boxes of 4.5 m still overlap by 0.3 when they
are 3 m apart, which is 30 m/s at 10 Hz. Without this growth the limit is 24 m/s.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np

from roadscope.core import Detections, Requirement
from roadscope.core.arguments import check_counts, check_not_negative, check_positive, check_shares
from roadscope.trackers._peers.adapter import LibraryTrack, TrackerAdapter

THEIR_RATE_HZ = 30.0
"""Frame rate for which `lost_track_buffer` is given."""
CORNERS, CENTRE = "XYXYStateEstimator", "XCYCSRStateEstimator"
STATES = {
    CORNERS: np.kron(np.eye(2), np.hstack([np.eye(2), np.eye(2)]) / 2),
    CENTRE: np.eye(7)[[0, 1, 4, 5]],
}
"""Matrices that give x, y, vx, vy of their states."""


class _RoboflowTracker(TrackerAdapter):
    requires: ClassVar = Requirement("trackers", "pip install roadscope[peers]")

    def __init__(
        self, name: str, state: str, units: Units, shown_misses: int, **settings: Any
    ) -> None:
        super().__init__(lambda _: Roboflow(name, state, units, settings), shown_misses)


class RoboflowSortTracker(_RoboflowTracker):
    """Roboflow's `SORTTracker`: Kalman filter, overlap, optimal assignment."""

    def __init__(
        self,
        *,
        least_overlap: float = 0.3,
        buffer_ratio: float = 0.125,
        new_score: float = 0.25,
        confirm_hits: int = 3,
        coast_s: float = 1.0,
        shown_misses: int = 0,
        pixels_per_m: float = 1.0,
        period_s: float = 0.1,
    ) -> None:
        """Set the tracker up.

        least_overlap: `minimum_iou_threshold`.
        new_score: `track_activation_threshold`.
        confirm_hits: `minimum_consecutive_frames`.
        shown_misses: see `LifeCycle`.
        buffer_ratio, coast_s, pixels_per_m, period_s: see `Units`.
        """
        check_shares(new_score=new_score)
        units = Units(buffer_ratio, coast_s, pixels_per_m, period_s)
        super().__init__(
            "SORTTracker",
            CORNERS,
            units,
            shown_misses,
            track_activation_threshold=new_score,
            **_common(least_overlap, confirm_hits),
        )


class RoboflowByteTracker(_RoboflowTracker):
    """Roboflow's `ByteTrackTracker`: detections of high score first, then those of low score."""

    def __init__(
        self,
        *,
        high_score: float = 0.6,
        new_score: float = 0.7,
        least_overlap: float = 0.3,
        buffer_ratio: float = 0.125,
        confirm_hits: int = 2,
        coast_s: float = 1.0,
        shown_misses: int = 0,
        pixels_per_m: float = 1.0,
        period_s: float = 0.1,
    ) -> None:
        """Set the tracker up.

        high_score: `high_conf_det_threshold`.
        new_score: `track_activation_threshold`.
        least_overlap: `minimum_iou_threshold`.
        confirm_hits: `minimum_consecutive_frames`.
        shown_misses: see `LifeCycle`.
        buffer_ratio, coast_s, pixels_per_m, period_s: see `Units`.
        """
        check_shares(high_score=high_score, new_score=new_score)
        units = Units(buffer_ratio, coast_s, pixels_per_m, period_s)
        super().__init__(
            "ByteTrackTracker",
            CORNERS,
            units,
            shown_misses,
            high_conf_det_threshold=high_score,
            track_activation_threshold=new_score,
            **_common(least_overlap, confirm_hits),
        )


class RoboflowOcSortTracker(_RoboflowTracker):
    """Roboflow's `OCSORTTracker`: observations before estimates.

    Its filter assumes that detections are off by a whole pixel, so a pixel is smaller here.
    """

    def __init__(
        self,
        *,
        least_score: float = 0.3,
        least_overlap: float = 0.3,
        buffer_ratio: float = 0.125,
        momentum: float = 0.2,
        momentum_ticks: int = 3,
        confirm_hits: int = 3,
        coast_s: float = 1.0,
        shown_misses: int = 0,
        pixels_per_m: float = 3.0,
        period_s: float = 0.1,
    ) -> None:
        """Set the tracker up.

        least_score: `high_conf_det_threshold`; detections with a lower score are ignored.
        least_overlap: `minimum_iou_threshold`, above 0: it holds for recovery too, where boxes
            are those of the last detection.
        momentum, momentum_ticks: `direction_consistency_weight` and `delta_t`.
        confirm_hits: `minimum_consecutive_frames`.
        shown_misses: see `LifeCycle`.
        buffer_ratio, coast_s, pixels_per_m, period_s: see `Units`.
        """
        check_shares(least_score=least_score)
        check_positive(least_overlap=least_overlap)
        check_not_negative(momentum=momentum)
        check_counts(1, momentum_ticks=momentum_ticks)
        units = Units(buffer_ratio, coast_s, pixels_per_m, period_s)
        super().__init__(
            "OCSORTTracker",
            CENTRE,
            units,
            shown_misses,
            high_conf_det_threshold=least_score,
            direction_consistency_weight=momentum,
            delta_t=momentum_ticks,
            **_common(least_overlap, confirm_hits),
        )


def _common(least_overlap: float, confirm_hits: int) -> dict[str, Any]:
    check_shares(least_overlap=least_overlap)
    check_counts(1, confirm_hits=confirm_hits)
    return {"minimum_iou_threshold": least_overlap, "minimum_consecutive_frames": confirm_hits}


@dataclass(frozen=True, slots=True)
class Units:
    """Pixels, frames and overlaps of Roboflow's trackers.

    buffer_ratio: share of their size by which boxes grow on every side before they are compared.
    coast_s: seconds without a detection that a confirmed track outlives.
    pixels_per_m, period_s: the pixel and the frame in which the noise of the filters counts; time
        steps are the true ones.
    """

    buffer_ratio: float
    coast_s: float
    pixels_per_m: float
    period_s: float

    def __post_init__(self) -> None:
        check_not_negative(buffer_ratio=self.buffer_ratio, coast_s=self.coast_s)
        check_positive(pixels_per_m=self.pixels_per_m, period_s=self.period_s)

    @property
    def in_metres(self) -> np.ndarray:
        """(4,) factors from pixels and frames to metres and seconds, of x, y, vx, vy."""
        pixel_m, rate_hz = 1 / self.pixels_per_m, 1 / self.period_s
        return pixel_m * np.array([1, 1, rate_hz, rate_hz])


class Roboflow:
    """A tracker of Roboflow as a `LibraryTracker`."""

    def __init__(self, name: str, state: str, units: Units, settings: dict[str, Any]) -> None:
        import trackers

        self._units, self._planar = units, STATES[state]
        self._tracker = getattr(trackers, name)(
            frame_rate=1 / units.period_s,
            lost_track_buffer=round(units.coast_s * THEIR_RATE_HZ),
            state_estimator_class=_remembering(state),
            iou=trackers.BIoU(units.buffer_ratio),
            **settings,
        )
        self._now_s = 0.0
        self._next_number = 0

    def follow(self, detections: Detections, period_s: float) -> list[LibraryTrack]:
        """Return all tracks after the detections of a tick."""
        import supervision

        self._now_s += period_s
        boxes = upright_boxes(detections) * self._units.pixels_per_m
        own = supervision.Detections(
            boxes, confidence=detections.scores, data={"row": np.arange(len(boxes))}
        )
        answer = self._tracker.update(own, timestamp=self._now_s)
        has_id = answer.tracker_id >= 0
        reported = set(answer.data["row"][has_id].tolist()) if has_id.any() else set()
        rows = defaultdict(list)
        for row, box in enumerate(boxes):
            rows[box.tobytes()].append(row)
        return [self._track(track, rows, reported) for track in self._tracker.tracks]

    def _track(self, track: Any, rows: dict[bytes, list[int]], reported: set[int]) -> LibraryTrack:
        """Return a track of theirs as a `LibraryTrack`.

        rows: the rows of the detections that have a box, by the bytes of the box.
        reported: rows of the detections whose tracks have an id.
        """
        state = track.state_estimator
        if state.number is None:
            state.number = self._next_number
            self._next_number += 1
        row = rows[state.new_box.tobytes()].pop(0) if state.new_box is not None else -1
        state.new_box = None
        confirmed = row in reported if row >= 0 else track.tracker_id >= 0
        M = self._units.in_metres[:, None] * self._planar
        P = M @ state.kf.state_covariance @ M.T
        mean = M @ state.kf.state[:, 0]
        return LibraryTrack(state.number, mean, (P + P.T) / 2, row, confirmed)


def upright_boxes(detections: Detections) -> np.ndarray:
    """Return (N, 4) least x, least y, greatest x, greatest y in bird's-eye view."""
    turned = np.abs(np.stack([np.cos(detections.yaws), np.sin(detections.yaws)], axis=-1))
    length, width = detections.sizes[:, :1], detections.sizes[:, 1:2]
    half = (length * turned + width * turned[:, ::-1]) / 2
    positions = detections.centres[:, :2]
    return np.hstack([positions - half, positions + half])


@cache
def _remembering(state: str) -> type[Any]:
    """Return their class of that name with two more attributes.

    number: of the track, None until it is first reported. new_box: of the last update, or None.
    """
    from trackers.utils import state_representations

    base: type[Any] = getattr(state_representations, state)

    class Remembering(base):  # type: ignore[misc]
        number: int | None = None

        def __init__(self, bbox: np.ndarray) -> None:
            super().__init__(bbox)
            self.new_box: np.ndarray | None = bbox

        def update(self, bbox: np.ndarray | None) -> None:
            super().update(bbox)
            self.new_box = bbox

    return Remembering
