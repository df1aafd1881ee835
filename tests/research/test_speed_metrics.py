from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from research import speed_metrics as metrics
from research.speed_metrics import measure_metrics, simulated_sequence
from roadscope.benchmarks.speed import SpeedRow
from roadscope.metrics import amota

SMALL = {"frames": 6, "objects": 4, "set_frames": 3}


def test_ours_beside_theirs_on_the_same_sequence() -> None:
    rows = {row.name: row for row in measure_metrics(1, **SMALL)}
    for name in ("HOTA", "CLEAR", "identity", "AMOTA", "TrackEval's HOTA, CLEAR and identity"):
        assert rows[f"{name}, 6 frames, 4 objects"].value > 0
    assert rows["Stone Soup's GOSPA, 4 objects"].unit == "ms a frame"
    for name in ("HOTA, CLEAR and identity", "the same with the record"):
        assert rows[f"{name} over TrackEval's"].value > 0
    assert rows["GOSPA over Stone Soup's"].value > 0
    assert rows["largest difference to TrackEval's HOTA, MOTA, IDF1"].value < 1e-9
    assert rows["largest difference to Stone Soup's GOSPA"].value < 1e-9


def test_a_row_that_misses_its_goal_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "GOSPA over Stone Soup's"
    monkeypatch.setattr(metrics, "GOALS", {name: 100.0})
    row = SpeedRow(name, 99.9, "times of 100")
    assert metrics.compared(name, 99.9) == [row, replace(row, name=f"too slow: {name}")]
    assert metrics.compared(name, 100.0) == [replace(row, value=100.0)]
    assert metrics.compared("others", 0.1) == [SpeedRow("others", 0.1, "times")]


def test_goals_are_of_what_is_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metrics, "GOALS", dict.fromkeys(metrics.GOALS, 1e9))
    names = [row.name for row in measure_metrics(1, **SMALL)]
    assert {name for name in names if name.startswith("too slow: ")} == {
        f"too slow: {name}" for name in metrics.GOALS
    }


def test_averages_over_recall_count_many_thresholds() -> None:
    sequence = simulated_sequence(60)
    assert all(len(s) == len(t) for s, t in zip(sequence.scores, sequence.tracks, strict=True))
    least = amota(sequence.as_tracked()).least_scores
    assert len(np.unique(least[np.isfinite(least)])) > 20


def test_alone_without_the_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metrics, "import_trackeval", lambda: None)
    monkeypatch.setattr(metrics, "import_stone_soup", lambda: None)
    names = [row.name for row in measure_metrics(1, **SMALL)]
    assert "GOSPA, 4 objects" in names
    assert not any("TrackEval" in name or "Stone Soup" in name for name in names)


def test_the_sequence_is_the_same_each_time_and_holds_what_goes_wrong() -> None:
    one, other = simulated_sequence(60), simulated_sequence(60)
    assert all(map(np.array_equal, one.tracks, other.tracks))
    assert len({tuple(np.sort(ids)) for ids in one.track_ids}) > 10
    assert len(one.truths[0]) == 30
