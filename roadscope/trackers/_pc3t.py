"""PC3T: constant acceleration, and the most confident predictions first (Wu 2021)."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.arguments import check_positive, check_shares
from roadscope.trackers._assignment import Pairs, assign_in_turn
from roadscope.trackers._gating import CandidatePairs, pairs_by_distance
from roadscope.trackers._motion import ConstantAcceleration, PositionFilter
from roadscope.trackers._tracklets import LifeCycle, Tracklets, TrackManager


class Pc3tTracker:
    """Each track, by falling confidence in its prediction, takes the cheapest free detection.

    From the paper: motion of constant acceleration; a confidence in each prediction that guides
    the association; costs that add several features up.

    Our reading: a prediction has the score of the track's last detection, less a share for every
    tick without one. Features are positions, boxes, headings and speeds, all in metres: headings
    times the length of the box, speeds times the period. Tentative tracks are dropped sooner, as
    in the authors' code. The authors also drop tracks of a low mean score afterwards, which is not
    online and left out. Gate and noise are ours.
    """

    def __init__(
        self,
        *,
        least_score: float = 0.5,
        new_score: float = 0.5,
        gate_m: float = 4.0,
        decay: float = 0.03,
        confirm_hits: int = 3,
        coast_frames: int = 12,
        new_coast_frames: int = 2,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        acceleration_walk: float = 3.0,
    ) -> None:
        """Set the tracker up; decay and frames as the authors published for KITTI.

        least_score: detections with a lower score are ignored; the authors' for PointRCNN.
        new_score: detections with at least this score start a track if they belong to none; the
            authors use 0.98 for PointRCNN online.
        gate_m: greatest distance of a detection from the expected position of a track.
        decay: share by which the confidence in a prediction falls with every missed tick.
        confirm_hits, shown_misses: see `LifeCycle`.
        coast_frames, new_coast_frames: ticks without a detection that a confirmed and a tentative
            track outlive.
        position_m, speed_m_s: see `PositionFilter`.
        acceleration_walk: see `ConstantAcceleration`.
        """
        check_shares(least_score=least_score, new_score=new_score, decay=decay)
        check_positive(gate_m=gate_m)
        self._least_score, self._new_score = least_score, new_score
        self._gate_m, self._decay = gate_m, decay
        self._manager = TrackManager(
            PositionFilter(position_m, speed_m_s, ConstantAcceleration(acceleration_walk)),
            LifeCycle(confirm_hits, coast_frames, new_coast_frames, shown_misses),
        )

    def reset(self) -> None:
        """Forget all tracks."""
        self._manager.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._manager.start_tick(detections, ego_pose)
        detections = tick.detections.select(tick.detections.scores >= self._least_score)
        tracks = self._manager.predicted_tracks(tick)
        pairs = self._assigned(tracks, detections, tick.period_s)
        return self._manager.finish_tick(tick, tracks, detections, pairs, new_score=self._new_score)

    def _assigned(self, tracks: Tracklets, detections: Detections, dt: float) -> Pairs:
        gates_m = np.full(len(tracks), self._gate_m)
        near = pairs_by_distance(tracks.positions, detections.centres[:, :2], gates_m)
        near = near.within_families(tracks.categories, detections.categories)
        i, j = near.rows, near.columns
        boxes = np.abs(tracks.sizes[i] - detections.sizes[j]).sum(axis=1)
        headings = np.abs(np.sin(tracks.yaws[i] - detections.yaws[j])) * tracks.sizes[i, 0]
        costs = near.costs + boxes + headings + _speed_costs(near, tracks, detections, dt)
        confidence = tracks.scores * (1 - self._decay) ** (tracks.misses - 1)
        return assign_in_turn(near.with_costs(costs), np.lexsort([tracks.ids, -confidence]))


def _speed_costs(
    pairs: CandidatePairs, tracks: Tracklets, detections: Detections, dt: float
) -> np.ndarray:
    """Return (P,) differences between the speed of a track and the speed a pair implies, times dt.

    The implied speed is that from the position of the track at the last tick to the detection.
    """
    states = tracks.beliefs.means[pairs.rows]
    before = states[:, :2] - dt * states[:, 2:4] + dt**2 / 2 * states[:, 4:6]
    moved_m = np.hypot(*(detections.centres[pairs.columns, :2] - before).T)
    costs: np.ndarray = np.abs(moved_m - dt * np.hypot(states[:, 2], states[:, 3]))
    return costs
