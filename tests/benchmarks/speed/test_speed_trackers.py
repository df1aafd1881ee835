from __future__ import annotations

from time import process_time

import pytest

from roadscope.benchmarks.speed import (
    CROWD,
    LEAD_UPDATES,
    UPDATES,
    detected_crowd,
    detected_traffic,
    measure_trackers,
    own_trackers,
    timed_pass,
    timed_updates,
)
from roadscope.core import Detections, Tracks
from roadscope.trackers import TRACKERS, PositionFilter, chi_square_gate, pairs_by_likelihood


class Blind:
    """Follows nothing."""

    def reset(self): ...

    def update(self, detections, ego_pose):
        return Tracks.empty(detections.stamp_s)


SCENES = ("5 targets", "12 crowded targets")


def test_every_tracker_of_ours_has_its_rows() -> None:
    rows = measure_trackers(counts=(5,), frames=LEAD_UPDATES + 3)
    tails = dict.fromkeys(own_trackers(), ("", ", p90", ", p99"))
    tails["existence-offline"] = (", pass at the end",)
    assert [row.name for row in rows] == [
        f"tracker {name}, {scene}{tail}"
        for name in own_trackers()
        for scene in SCENES
        for tail in tails[name]
    ]
    assert {"nearest", "gnn", "jpda"} <= set(own_trackers()) < set(TRACKERS.names())
    online = [row for row in rows if "pass" not in row.name]
    assert all(row.value > 0 and row.unit.startswith("ms") for row in online)
    of_one = zip(online[::3], online[1::3], online[2::3], strict=True)
    assert all(a.value <= b.value <= c.value for a, b, c in of_one)


class Busy(Blind):
    """Takes 6 ms for an update, and 24 ms for the pass at the end."""

    offline = True

    def update(self, detections, ego_pose):
        work(0.006)
        return super().update(detections, ego_pose)

    def rescored(self, history):
        work(0.024)
        return history


def work(seconds: float) -> None:
    end = process_time() + seconds
    while process_time() < end:
        pass


def test_of_an_offline_tracker_the_pass_alone_is_timed() -> None:
    name, frames = f"{__name__}:Busy", LEAD_UPDATES + 2
    rows = measure_trackers([name], (5,), frames)
    assert [row.name for row in rows] == [
        f"tracker {name}, {scene}, pass at the end" for scene in SCENES
    ]
    for row in rows:
        assert row.unit == "ms a frame"
        # With the updates it would be 8 ms.
        assert 24 / frames <= row.value < 6
    with pytest.raises(ValueError, match="'existence' has no pass at the end"):
        timed_pass("existence", [])


def test_in_the_crowd_every_detection_may_be_of_every_track() -> None:
    """Even with covariances from before the prediction, and with a narrower gate than theirs."""
    episode = list(detected_crowd(LEAD_UPDATES + 4))
    assert len(timed_updates("jpda", episode)) == 4
    tracker, gate = TRACKERS.make("jpda"), chi_square_gate(0.95, 2)
    tracker.reset()
    tracks = Tracks.empty(0.0)
    for number, (detections, ego_pose) in enumerate(episode):
        if number >= LEAD_UPDATES:
            elapsed_s = detections.stamp_s - tracks.stamp_s
            expected = tracks.centres[:, :2] + elapsed_s * tracks.velocities
            covariances = tracks.covariances[:, :2, :2] + PositionFilter().R
            measured = detections.centres[:, :2]
            pairs = pairs_by_likelihood(expected, covariances, measured, gate)
            assert (pairs.shape, len(pairs)) == ((CROWD, CROWD), CROWD * CROWD)
        tracks = tracker.update(detections, ego_pose)


def test_updates_before_the_lead_are_not_timed() -> None:
    assert len(timed_updates("gnn", list(detected_traffic(5)))) == UPDATES - LEAD_UPDATES
    with pytest.raises(ValueError, match="follows nothing"):
        timed_updates(f"{__name__}:Blind", list(detected_traffic(5, LEAD_UPDATES + 1)))


def test_the_traffic_is_dense_and_seen_from_the_ego() -> None:
    episode = list(detected_traffic(200, 3))
    assert all(detections.frame == "ego" for detections, _ in episode)
    assert 180 < len(episode[0][0]) < 220
    again = list(detected_traffic(200, 3))
    assert [d for d, _ in again] == [d for d, _ in episode]
    assert isinstance(episode[0][0], Detections)
