"""MCTrack: overlap and distance in bird's-eye view, then in a second view (Wang 2024)."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.arguments import check_shares
from roadscope.core.jit import compiled
from roadscope.core.pose import wrap_angle
from roadscope.trackers._assignment import Pairs, assign_optimally, unassigned
from roadscope.trackers._gating import CandidatePairs, boxes_of, pairs_by_overlap, suppressed
from roadscope.trackers._motion import ConstantAcceleration, PositionFilter
from roadscope.trackers._tracklets import LifeCycle, Tracklets, TrackManager

FLAT = np.array([1, 1, 0, 1, 1, 0, 1.0])
"""Factors that set z and height of a box (centre x y z, length width height, yaw) to 0."""
UNIT_HEIGHT = np.array([0, 0, 0, 0, 0, 1, 0.0])
"""Added to such boxes: with equal z and height the overlap in space is that in bird's-eye view."""
CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
"""(8, 3) corners of a box of size 1 around the origin."""


class McTracker:
    """Two assignments one after the other, with a motion model of constant acceleration.

    From the paper: boxes are suppressed and cut off by score. Pairs are assigned by the generalised
    IoU of rotated boxes in bird's-eye view, minus a term for the distance of centres (Ro_GDIoU).
    What is left is assigned in a second view, in which errors of depth have little effect.
    Position, size and heading are filtered separately.

    Our reading: the second view is that of the range image, azimuth and elevation around the ego,
    because there is no camera; its overlap is IoU minus a term for the distance (DIoU).
    Sizes and headings are those of the last detection: with the published noise the filter's are
    nearly the same.
    The noise of positions is ours, as the published one is per frame and in units of its own.
    """

    def __init__(
        self,
        *,
        most_overlap: float = 0.08,
        least_score: float = 0.435,
        least: float = -0.4,
        least_again: float = 1.0,
        confirm_hits: int = 2,
        coast_frames: int = 16,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        acceleration_walk: float = 3.0,
    ) -> None:
        """Set the tracker up; scores, overlaps and frames as the authors published for KITTI.

        most_overlap: IoU in space above which the detection of lower score is suppressed.
        least_score: detections with a lower score are ignored.
        least: a pair must have a higher Ro_GDIoU.
        least_again: a pair of the second view must have a higher DIoU. With 1 there is no second
            view, as in the authors' settings for KITTI, where depths come from a LiDAR; elsewhere
            they use -0.3.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`.
        position_m, speed_m_s: see `PositionFilter`.
        acceleration_walk: see `ConstantAcceleration`.
        """
        check_shares(most_overlap=most_overlap, least_score=least_score)
        for name, value in (("least", least), ("least_again", least_again)):
            if not -1 <= value <= 1:
                raise ValueError(f"{name} must lie in -1 to 1, got {value!r}")
        self._most_overlap, self._least_score = most_overlap, least_score
        self._least, self._least_again = least, least_again
        self._manager = TrackManager(
            PositionFilter(position_m, speed_m_s, ConstantAcceleration(acceleration_walk)),
            LifeCycle(confirm_hits, coast_frames, 0, shown_misses),
        )

    def reset(self) -> None:
        """Forget all tracks."""
        self._manager.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._manager.start_tick(detections, ego_pose)
        detections = tick.detections.select(tick.detections.scores >= self._least_score)
        detections = suppressed(detections, self._most_overlap)
        tracks = self._manager.predicted_tracks(tick)
        pairs = self._assigned(tracks, detections, tick.sensor_position)
        return self._manager.finish_tick(tick, tracks, detections, pairs)

    def _assigned(self, tracks: Tracklets, detections: Detections, origin: np.ndarray) -> Pairs:
        """Return pairs assigned in bird's-eye view, and of what is left those of the ego's view."""
        boxes, others = tracks.boxes, boxes_of(detections)
        near = birds_eye_pairs(boxes, others, self._least)
        near = near.within_families(tracks.categories, detections.categories)
        rows, columns = assign_optimally(near, 1 - self._least)
        if self._least_again == 1:
            return rows, columns
        missed, free = unassigned(len(boxes), rows), unassigned(len(others), columns)
        near = ego_view_pairs(boxes[missed], others[free], origin, self._least_again)
        near = near.within_families(tracks.categories[missed], detections.categories[free])
        i, j = assign_optimally(near, 1 - self._least_again)
        return np.concatenate([rows, missed[i]]), np.concatenate([columns, free[j]])


def birds_eye_pairs(boxes: np.ndarray, others: np.ndarray, least: float) -> CandidatePairs:
    """Return pairs of (N, 7) and (M, 7) boxes with a higher Ro_GDIoU; costs: 1 minus it.

    Ro_GDIoU = IoU - (C - U) / C - c^2 / d^2 of rectangles: U is the area of their union, C that of
    their convex hull, c the distance of centres, d the greatest distance between corners. Both
    weights of the paper are 1, as on KITTI.
    """
    near = pairs_by_overlap(
        boxes * FLAT + UNIT_HEIGHT,
        others * FLAT + UNIT_HEIGHT,
        overlap="giou",
        least=max(least, -1 + 1e-9),
    )
    costs = near.costs + _relative_distances(boxes, others, near.rows, near.columns)
    return near.with_costs(costs).where(costs < 1 - least)


@compiled()
def _relative_distances(
    boxes: np.ndarray, others: np.ndarray, rows: np.ndarray, columns: np.ndarray
) -> np.ndarray:
    """Return (P,) c^2 / d^2 of pairs, as in `birds_eye_pairs`."""
    ratios, corners = np.empty(len(rows)), np.empty((8, 2))
    for k in range(len(rows)):
        for n in range(8):
            box = boxes[rows[k]] if n < 4 else others[columns[k]]
            if n % 4 == 0:
                c, s = np.cos(box[6]), np.sin(box[6])
            along = box[3] / 2 if n % 2 == 0 else -box[3] / 2
            across = box[4] / 2 if n % 4 < 2 else -box[4] / 2
            corners[n, 0] = box[0] + c * along - s * across
            corners[n, 1] = box[1] + s * along + c * across
        d2 = 0.0
        for n in range(8):
            for m in range(n):
                dx, dy = corners[n, 0] - corners[m, 0], corners[n, 1] - corners[m, 1]
                d2 = max(d2, dx * dx + dy * dy)
        dx = boxes[rows[k], 0] - others[columns[k], 0]
        dy = boxes[rows[k], 1] - others[columns[k], 1]
        ratios[k] = (dx * dx + dy * dy) / d2
    return ratios


def ego_view_pairs(
    boxes: np.ndarray, others: np.ndarray, origin: np.ndarray, least: float
) -> CandidatePairs:
    """Return pairs of (N, 7) and (M, 7) boxes with a higher DIoU for a sensor; costs: 1 - DIoU.

    origin: (3,) metres, the sensor.

    DIoU = IoU - c^2 / d^2 of the rectangles of azimuth and elevation around boxes: c is the
    distance of their centres, d the diagonal of the rectangle around both.
    """
    (low, high), (other_low, other_high) = (_view_limits(each, origin) for each in (boxes, others))
    offsets = ((other_low + other_high) / 2)[None] - ((low + high) / 2)[:, None]
    offsets[..., 0] = wrap_angle(offsets[..., 0])
    half, other_half = ((high - low) / 2)[:, None], ((other_high - other_low) / 2)[None]
    top = np.minimum(half, offsets + other_half)
    bottom = np.maximum(-half, offsets - other_half)
    common = np.maximum(top - bottom, 0).prod(axis=-1)
    union = 4 * half.prod(axis=-1) + 4 * other_half.prod(axis=-1) - common
    around = np.maximum(half, offsets + other_half) - np.minimum(-half, offsets - other_half)
    diou = common / union - (offsets**2).sum(axis=-1) / (around**2).sum(axis=-1)
    rows, columns = np.nonzero(diou > least)
    return CandidatePairs(diou.shape, rows, columns, 1 - diou[rows, columns])


def _view_limits(boxes: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the greatest azimuth and elevation of boxes, (N, 2) radians each.

    Azimuths may lie beyond -pi and pi, so that the two limits of a box are never a turn apart.
    """
    corners = _corners(boxes) - origin
    centres = boxes[:, :3] - origin
    azimuth = np.arctan2(centres[:, 1], centres[:, 0])
    relative = np.arctan2(corners[..., 1], corners[..., 0]) - azimuth[:, None]
    range_m = np.hypot(corners[..., 0], corners[..., 1])
    angles = np.stack(
        [azimuth[:, None] + wrap_angle(relative), np.arctan2(corners[..., 2], range_m)], axis=-1
    )
    return angles.min(axis=1, initial=np.inf), angles.max(axis=1, initial=-np.inf)


def _corners(boxes: np.ndarray) -> np.ndarray:
    """Return the (N, 8, 3) corners of (N, 7) boxes."""
    local = CORNERS * boxes[:, None, 3:6]
    c, s = np.cos(boxes[:, 6, None]), np.sin(boxes[:, 6, None])
    turned = [c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1]]
    corners: np.ndarray = np.stack([*turned, local[..., 2]], axis=-1) + boxes[:, None, :3]
    return corners
