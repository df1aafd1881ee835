"""SORT, ByteTrack and OC-SORT of Roboflow's `trackers`, on boxes seen from above."""

from __future__ import annotations

from typing import Any, ClassVar

from roadscope.core import Detections, Pose, Requirement, Tracks
from roadscope.trackers.peers.adapter import Adapter
from roadscope.trackers.peers.roboflow_library import CENTRE, CORNERS, Roboflow, Units
from roadscope.trackers.settings import (
    check_counts,
    check_not_negative,
    check_positive,
    check_shares,
)

ROBOFLOW = Requirement("trackers", "pip install roadscope[peers]")


class RoboflowSortTracker:
    """Roboflow's `SORTTracker`: Kalman filter, overlap, optimal assignment."""

    requires: ClassVar = ROBOFLOW

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
        shown_misses: see `Adapter`.
        buffer_ratio, coast_s, pixels_per_m, period_s: see `Units`.
        """
        check_shares(new_score=new_score)
        units = Units(buffer_ratio, coast_s, pixels_per_m, period_s)
        self._adapter = _adapter(
            "SORTTracker", CORNERS, units, shown_misses,
            track_activation_threshold=new_score, **_common(least_overlap, confirm_hits),
        )  # fmt: skip

    def reset(self) -> None:
        """Forget all tracks."""
        self._adapter.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        return self._adapter.update(detections, ego_pose)


class RoboflowByteTracker:
    """Roboflow's `ByteTrackTracker`: sure detections first, then unsure ones."""

    requires: ClassVar = ROBOFLOW

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
        shown_misses: see `Adapter`.
        buffer_ratio, coast_s, pixels_per_m, period_s: see `Units`.
        """
        check_shares(high_score=high_score, new_score=new_score)
        units = Units(buffer_ratio, coast_s, pixels_per_m, period_s)
        self._adapter = _adapter(
            "ByteTrackTracker", CORNERS, units, shown_misses,
            high_conf_det_threshold=high_score, track_activation_threshold=new_score,
            **_common(least_overlap, confirm_hits),
        )  # fmt: skip

    def reset(self) -> None:
        """Forget all tracks."""
        self._adapter.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        return self._adapter.update(detections, ego_pose)


class RoboflowOcSortTracker:
    """Roboflow's `OCSORTTracker`: observations before estimates.

    Its filter says that detections are off by a whole pixel, so a pixel is smaller here.
    """

    requires: ClassVar = ROBOFLOW

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

        least_score: `high_conf_det_threshold`; detections below are not looked at.
        least_overlap: `minimum_iou_threshold`, above 0: it holds for recovery too, where boxes
            are as they were seen.
        momentum, momentum_ticks: `direction_consistency_weight` and `delta_t`.
        confirm_hits: `minimum_consecutive_frames`.
        shown_misses: see `Adapter`.
        buffer_ratio, coast_s, pixels_per_m, period_s: see `Units`.
        """
        check_shares(least_score=least_score)
        check_positive(least_overlap=least_overlap)
        check_not_negative(momentum=momentum)
        check_counts(1, momentum_ticks=momentum_ticks)
        units = Units(buffer_ratio, coast_s, pixels_per_m, period_s)
        self._adapter = _adapter(
            "OCSORTTracker", CENTRE, units, shown_misses, high_conf_det_threshold=least_score,
            direction_consistency_weight=momentum, delta_t=momentum_ticks,
            **_common(least_overlap, confirm_hits),
        )  # fmt: skip

    def reset(self) -> None:
        """Forget all tracks."""
        self._adapter.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        return self._adapter.update(detections, ego_pose)


def _common(least_overlap: float, confirm_hits: int) -> dict[str, Any]:
    check_shares(least_overlap=least_overlap)
    check_counts(1, confirm_hits=confirm_hits)
    return {"minimum_iou_threshold": least_overlap, "minimum_consecutive_frames": confirm_hits}


def _adapter(name: str, state: str, units: Units, shown_misses: int, **settings: Any) -> Adapter:
    return Adapter(lambda _: Roboflow(name, state, units, settings), shown_misses)
