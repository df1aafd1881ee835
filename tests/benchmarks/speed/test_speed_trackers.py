from __future__ import annotations

import pytest

from roadscope.benchmarks.speed import measure, trackers
from roadscope.benchmarks.speed.trackers import (
    FRAMES,
    LEAD,
    measure_trackers,
    own_trackers,
    seen_traffic,
    timed_updates,
)
from roadscope.core import Detections, Tracks
from roadscope.trackers import TRACKERS


class Blind:
    """Follows nothing."""

    def reset(self): ...

    def update(self, detections, ego_pose):
        return Tracks.empty(detections.stamp_s)


def test_every_tracker_of_ours_has_its_rows() -> None:
    rows = measure_trackers(counts=(5,), frames=LEAD + 3)
    tails = dict.fromkeys(own_trackers(), ("", ", p99"))
    tails["existence-offline"] = (", pass at the end",)
    assert [row.name for row in rows] == [
        f"tracker {name}, 5 targets{tail}" for name in own_trackers() for tail in tails[name]
    ]
    assert {"nearest", "gnn", "jpda"} <= set(own_trackers()) < set(TRACKERS.names())
    online = [row for row in rows if "pass" not in row.name]
    assert all(row.value > 0 and row.unit == "ms" for row in online)
    assert all(a.value <= b.value for a, b in zip(online[::2], online[1::2], strict=True))


def test_of_an_offline_tracker_the_pass_alone_is_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trackers, "process_time", iter((1.0, 1.6)).__next__)
    (row,) = measure_trackers(["existence-offline"], (5,), LEAD + 2)
    assert row.name == "tracker existence-offline, 5 targets, pass at the end"
    assert (row.value, row.unit) == (pytest.approx(600 / (LEAD + 2)), "ms a frame")
    with pytest.raises(ValueError, match="'existence' has no pass at the end"):
        trackers.timed_pass("existence", [])


def test_who_misses_the_goal_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trackers, "GOALS_MS", {4: 1e-9, 6: 1e9})
    rows = measure_trackers(["gnn"], (4, 6), LEAD + 3)
    assert [row.unit for row in rows[:4:2]] == ["ms of 1e-09", "ms of 1e+09"]
    assert [row.name for row in rows[4:]] == ["too slow, 4 targets: gnn"]


def test_updates_before_the_lead_are_not_timed() -> None:
    assert len(timed_updates("gnn", list(seen_traffic(5)))) == FRAMES - LEAD
    with pytest.raises(ValueError, match="follows nothing"):
        timed_updates(f"{__name__}:Blind", list(seen_traffic(5, LEAD + 1)))


def test_the_traffic_is_dense_and_seen_from_the_ego() -> None:
    episode = list(seen_traffic(200, 3))
    assert all(detections.frame == "ego" for detections, _ in episode)
    assert 180 < len(episode[0][0]) < 220
    again = list(seen_traffic(200, 3))
    assert [d for d, _ in again] == [d for d, _ in episode]
    assert isinstance(episode[0][0], Detections)


def test_part_of_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "measure_trackers", lambda: [])
    told: list[str] = []
    measure.measure_speed(parts=["trackers"], progress=lambda name, *_: told.append(name))
    assert told == ["trackers"]
