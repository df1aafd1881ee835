from __future__ import annotations

import json
from itertools import count
from pathlib import Path

import pytest

from research import speed_peers
from research.speed_peers import BESIDE, measure_dbscan, measure_trackers_of_others
from roadscope.benchmarks.speed import COUNTS, LEAD_UPDATES, SpeedRow, SpeedStep, own_trackers
from roadscope.trackers import TRACKERS


@pytest.fixture
def one_is_slow(monkeypatch):
    """`gnn` stands for a tracker of others; its updates take 0.2 s, 0.1 s those of `greedy`."""
    monkeypatch.setattr(speed_peers, "BESIDE", {"gnn": "greedy"})
    ticks = (0.0, 0.2, 0.2, 0.3)
    clock = (0.3 * (k // 4) + ticks[k % 4] for k in count())
    monkeypatch.setattr(speed_peers, "process_time", lambda: next(clock))


def test_every_tracker_of_others_has_one_of_ours_beside() -> None:
    assert set(BESIDE) == set(TRACKERS) - set(own_trackers())
    assert set(BESIDE.values()) <= set(own_trackers())


@pytest.mark.parametrize("name", BESIDE)
def test_installed_peers_are_measured_and_others_are_reported(name: str) -> None:
    rows = measure_trackers_of_others([name], (5, 8), LEAD_UPDATES + 3)
    if missing := TRACKERS.missing(name):
        assert rows == [SpeedRow(f"tracker {name}", None, missing)]
        return
    assert [row.name for row in rows[::2]] == [f"tracker {name}, {n} targets" for n in (5, 8)]
    ours = BESIDE[name]
    assert [row.name for row in rows[1::2]] == [f"{ours} over {name}, {n} targets" for n in (5, 8)]
    assert all(row.value > 0 for row in rows)


def test_a_peer_that_is_not_installed_has_a_row_that_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(TRACKERS, "missing", lambda name: f"{name} is not installed: pip")
    rows = measure_trackers_of_others()
    assert [row.name for row in rows] == [f"tracker {name}" for name in BESIDE]
    assert all(row.value is None and "is not installed" in row.unit for row in rows)


def test_the_ratio_is_of_the_same_frames(one_is_slow) -> None:
    row, ratio = measure_trackers_of_others(["gnn"], (5,), LEAD_UPDATES + 3)
    assert row == SpeedRow("tracker gnn, 5 targets", pytest.approx(200), "ms")
    assert ratio == SpeedRow("greedy over gnn, 5 targets", pytest.approx(2), "times")


def test_a_peer_that_would_take_too_long_is_left_out_by_name(one_is_slow) -> None:
    """50 targets would take 100 times as long as 5, 20 s an update, 13 updates."""
    rows = measure_trackers_of_others(["gnn"], (50, 5, 100), LEAD_UPDATES + 3)
    assert [row.name for row in rows if "over" not in row.name] == [
        f"tracker gnn, {n} targets" for n in (5, 50, 100)
    ]
    assert [row.value is None for row in rows] == [False, False, True, True]
    assert rows[2].unit == "left out: an update would take about 20 s"
    assert rows[3].unit == "left out: an update would take about 80 s"


def test_all_sizes_are_those_of_ours() -> None:
    assert measure_trackers_of_others.__defaults__[1] == COUNTS == (10, 50, 200, 500)


def test_dbscan_beside_scikit_learn() -> None:
    ours, theirs, ratio, mismatched = measure_dbscan(1, points=300, rig="lux")
    assert (ours.name, ours.unit) == ("DBSCAN, 300 points", "ms")
    assert ratio.value == pytest.approx(theirs.value / ours.value)
    assert (mismatched.value, mismatched.unit) == (0, "of 300")


def test_dbscan_alone_without_scikit_learn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed_peers, "import_scikit_learn", lambda: None)
    row, missing = measure_dbscan(1, points=300, rig="lux")
    assert row.name == "DBSCAN, 300 points"
    assert missing.value is None


def test_the_command_measures_the_parts_that_are_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    step = SpeedStep("one step", lambda: [SpeedRow("cast", 2.5, "Mray/s")])
    monkeypatch.setattr(speed_peers, "PARTS", {"casting": lambda: [step], "metrics": lambda: []})
    speed_peers.main(["casting", "--out", str(tmp_path / "speed.json")])
    text = capsys.readouterr().out
    assert "1 of 1: one step" in text
    assert "Mray/s" in text
    assert json.loads((tmp_path / "speed.json").read_text())[0]["name"] == "cast"
    with pytest.raises(SystemExit):
        speed_peers.main(["radar"])
