"""What Roboflow's trackers are given for boxes in an image, and what they know of tracks.

Boxes are the smallest along the world's axes that hold a detection. The filters' noise is fixed in
pixels and frames. What a pixel is changes no gain and no pair, only the covariances: at 1 for a
metre, SORT's and ByteTrack's say that detections are off by 0.3 m, that new targets do 10 m/s more
or less and that velocities wander by 3 m/s in a root second.
A car that is new moves by much of its length between two ticks, so overlaps may be those of grown
boxes, `BIoU`: grown by an eighth on every side, two boxes of 4.5 m still overlap by 0.3 when they
are 3 m apart, which is 30 m/s at 10 Hz. Without, it ends at 24 m/s.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from roadscope.core import Detections
from roadscope.trackers.peers.adapter import Told
from roadscope.trackers.settings import check_not_negative, check_positive

THEIR_RATE_HZ = 30.0
"""At which `lost_track_buffer` counts frames."""
CORNERS, CENTRE = "XYXYStateEstimator", "XCYCSRStateEstimator"
STATES = {
    CORNERS: np.kron(np.eye(2), np.hstack([np.eye(2), np.eye(2)]) / 2),
    CENTRE: np.eye(7)[[0, 1, 4, 5]],
}
"""What makes x, y, vx, vy of their states."""


@dataclass(frozen=True, slots=True)
class Units:
    """What pixels, frames and overlaps are.

    buffer_ratio: by which part of their size boxes grow on every side before they are compared.
    coast_s: seconds without a detection that a confirmed track outlives.
    pixels_per_m, period_s: what a pixel and a frame of the filters' noise are; steps are as long
        as they are.
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
        """(4,) by which x, y, vx, vy in pixels and frames are multiplied."""
        pixel_m, rate_hz = 1 / self.pixels_per_m, 1 / self.period_s
        return pixel_m * np.array([1, 1, rate_hz, rate_hz])


class Roboflow:
    """A tracker of theirs as a library of `Adapter`."""

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
        self._born = 0

    def follow(self, targets: Detections, period_s: float) -> Told:
        """Take the detections of a tick, so long after the last one."""
        import supervision

        self._now_s += period_s
        boxes = upright_boxes(targets) * self._units.pixels_per_m
        given = supervision.Detections(
            boxes, confidence=targets.scores, data={"row": np.arange(len(boxes))}
        )
        answer = self._tracker.update(given, timestamp=self._now_s)
        named = answer.tracker_id >= 0
        answered = set(answer.data["row"][named].tolist()) if named.any() else set()
        rows = defaultdict(list)
        for row, box in enumerate(boxes):
            rows[box.tobytes()].append(row)
        return Told.of([self._told(track, rows, answered) for track in self._tracker.tracks])

    def _told(
        self, track: Any, rows: dict[bytes, list[int]], answered: set[int]
    ) -> tuple[int, np.ndarray, np.ndarray, int, bool]:
        state = track.state_estimator
        if state.number is None:
            state.number = self._born
            self._born += 1
        row = rows[state.taken.tobytes()].pop(0) if state.taken is not None else -1
        state.taken = None
        confirmed = row in answered if row >= 0 else track.tracker_id >= 0
        M = self._units.in_metres[:, None] * self._planar
        P = M @ state.kf.state_covariance @ M.T
        return state.number, M @ state.kf.state[:, 0], (P + P.T) / 2, row, confirmed


def upright_boxes(detections: Detections) -> np.ndarray:
    """Return (N, 4) least x, least y, greatest x, greatest y, seen from above."""
    turned = np.abs(np.stack([np.cos(detections.yaws), np.sin(detections.yaws)], axis=-1))
    length, width = detections.sizes[:, :1], detections.sizes[:, 1:2]
    half = (length * turned + width * turned[:, ::-1]) / 2
    places = detections.centres[:, :2]
    return np.hstack([places - half, places + half])


@cache
def _remembering(state: str) -> type[Any]:
    """Return their state of that name, which remembers the box it was given last."""
    from trackers.utils import state_representations

    base: type[Any] = getattr(state_representations, state)

    class Remembering(base):  # type: ignore[misc]
        number: int | None = None

        def __init__(self, bbox: np.ndarray) -> None:
            super().__init__(bbox)
            self.taken: np.ndarray | None = bbox

        def update(self, bbox: np.ndarray | None) -> None:
            super().update(bbox)
            self.taken = bbox

    return Remembering
