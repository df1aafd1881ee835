"""Overlap and distance seen from above, then seen from the ego: MCTrack (Wang 2024)."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.jit import compiled
from roadscope.core.pose import wrap_angle
from roadscope.trackers.assignment import Pairs, assign_optimally, left_over
from roadscope.trackers.gating import Candidates, candidates_by_overlap
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.management import TrackManager
from roadscope.trackers.motion import ConstantAcceleration
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.settings import check_shares
from roadscope.trackers.suppression import suppressed
from roadscope.trackers.tracklets import Tracklets, boxes_of

FLAT = np.array([1, 1, 0, 1, 1, 0, 1.0])
"""Of centre, length width height, yaw: what is seen from above."""
LEVEL = np.array([0, 0, 0, 0, 0, 1, 0.0])
CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


class McTracker:
    """Two views one after the other, motion of constant acceleration.

    From the paper: boxes thinned out and cut off by score; pairs first by the overlap of rotated
    boxes from above, generalised and less the distance of centres (Ro_GDIoU); what is left then
    in a second view, where wrong depths do no harm; place, size and heading apart.

    Our reading: the second view is the range image's, azimuth and elevation around the ego,
    since detections come without a camera; its overlap is IoU less the distance (DIoU). Sizes
    and headings are the last detection's, which the published noise comes to. Noise of places is
    ours, as the published is per frame and in units of its own.
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

        most_overlap: IoU in space beyond which the less sure of two detections is dropped.
        least_score: detections below are not looked at.
        least, least_again: what Ro_GDIoU of a pair must exceed, and DIoU in the second view; 1
            leaves that out, as the authors do on KITTI, where depths are a LiDAR's. Else -0.3.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`.
        position_m, speed_m_s: see `PlaceFilter`.
        acceleration_walk: m/s2 per root second, by which accelerations wander.
        """
        check_shares(most_overlap=most_overlap, least_score=least_score)
        for name, value in (("least", least), ("least_again", least_again)):
            if not -1 <= value <= 1:
                raise ValueError(f"{name} must lie in -1 to 1, got {value!r}")
        self._most_overlap, self._least_score = most_overlap, least_score
        self._least, self._least_again = least, least_again
        self._manager = TrackManager(
            PlaceFilter(position_m, speed_m_s, ConstantAcceleration(acceleration_walk)),
            LifeCycle(confirm_hits, coast_frames, 0, shown_misses),
        )

    def reset(self) -> None:
        """Forget all tracks."""
        self._manager.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._manager.arrived(detections, ego_pose)
        heard = tick.targets.select(tick.targets.scores >= self._least_score)
        targets = suppressed(heard, self._most_overlap)
        tracks = self._manager.expected(tick)
        eye = np.zeros(3) if ego_pose is None else ego_pose.translation
        pairs = self._associated(tracks, targets, eye)
        return self._manager.concluded(tick, tracks, targets, pairs, 0.0)

    def _associated(self, tracks: Tracklets, targets: Detections, eye: np.ndarray) -> Pairs:
        """Pair in the view from above, and the rest in that of the ego."""
        boxes, others = tracks.boxes, boxes_of(targets)
        kinds = tracks.categories, targets.categories
        near = overlaps_from_above(boxes, others, self._least).within_families(*kinds)
        rows, columns = assign_optimally(near, 1 - self._least)
        if self._least_again == 1:
            return rows, columns
        left, free = left_over(len(boxes), rows), left_over(len(others), columns)
        near = overlaps_from_ego(boxes[left], others[free], eye, self._least_again)
        near = near.within_families(kinds[0][left], kinds[1][free])
        i, j = assign_optimally(near, 1 - self._least_again)
        return np.concatenate([rows, left[i]]), np.concatenate([columns, free[j]])


def overlaps_from_above(boxes: np.ndarray, others: np.ndarray, least: float) -> Candidates:
    """Return pairs of (N, 7) and (M, 7) boxes whose Ro_GDIoU exceeds `least`; costs: 1 less it.

    IoU - (C - U) / C - c2 / d2 of rectangles: U the area of both, C that of their convex hull,
    c the distance of centres, d the greatest distance between corners. Both weights are 1, as on
    KITTI.
    """
    near = candidates_by_overlap(
        boxes * FLAT + LEVEL, others * FLAT + LEVEL, overlap="giou", least=max(least, -1 + 1e-9)
    )
    costs = near.costs + _distances(boxes, others, near.rows, near.columns)
    return near.costing(costs).where(costs < 1 - least)


@compiled()
def _distances(
    boxes: np.ndarray, others: np.ndarray, rows: np.ndarray, columns: np.ndarray
) -> np.ndarray:
    """Return (P,) c2 / d2 of pairs."""
    shares, corners = np.empty(len(rows)), np.empty((8, 2))
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
        shares[k] = (dx * dx + dy * dy) / d2
    return shares


def overlaps_from_ego(
    boxes: np.ndarray, others: np.ndarray, eye: np.ndarray, least: float
) -> Candidates:
    """Return pairs whose DIoU exceeds `least`, seen from (3,) the eye; costs: 1 less it.

    IoU - c2 / d2 of the rectangles of azimuth and elevation that boxes fill, d the diagonal of
    the rectangle around both.
    """
    (low, high), (lows, highs) = (_views(b, eye) for b in (boxes, others))
    mid, mids = (low + high) / 2, (lows + highs) / 2
    apart = mids[None] - mid[:, None]
    apart[..., 0] = wrap_angle(apart[..., 0])
    half, halves = ((high - low) / 2)[:, None], ((highs - lows) / 2)[None]
    top, bottom = np.minimum(half, apart + halves), np.maximum(-half, apart - halves)
    common = np.maximum(top - bottom, 0).prod(axis=-1)
    union = 4 * half.prod(axis=-1) + 4 * halves.prod(axis=-1) - common
    around = np.maximum(half, apart + halves) - np.minimum(-half, apart - halves)
    shares = common / union - (apart**2).sum(axis=-1) / (around**2).sum(axis=-1)
    rows, columns = np.nonzero(shares > least)
    return Candidates(shares.shape, rows, columns, 1 - shares[rows, columns])


def _views(boxes: np.ndarray, eye: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 2) least and greatest azimuth and elevation; azimuths may pass half a turn."""
    corners = _corners(boxes) - eye
    centres = boxes[:, :3] - eye
    ahead = np.arctan2(centres[:, 1], centres[:, 0])
    aside = np.arctan2(corners[..., 1], corners[..., 0]) - ahead[:, None]
    away = np.hypot(corners[..., 0], corners[..., 1])
    seen = np.stack(
        [ahead[:, None] + wrap_angle(aside), np.arctan2(corners[..., 2], away)], axis=-1
    )
    return seen.min(axis=1, initial=np.inf), seen.max(axis=1, initial=-np.inf)


def _corners(boxes: np.ndarray) -> np.ndarray:
    """Return (N, 8, 3) corners."""
    local = CORNERS * boxes[:, None, 3:6]
    c, s = np.cos(boxes[:, 6, None]), np.sin(boxes[:, 6, None])
    turned = [c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1]]
    corners: np.ndarray = np.stack([*turned, local[..., 2]], axis=-1) + boxes[:, None, :3]
    return corners
