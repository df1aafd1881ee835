from __future__ import annotations

import json
from itertools import count
from pathlib import Path

import pytest
from rich.console import Console

from roadscope.benchmarks.speed import tracker_peers
from roadscope.benchmarks.speed.measure import write_speed
from roadscope.benchmarks.speed.rows import SpeedRow
from roadscope.benchmarks.speed.tracker_peers import BESIDE, measure_peers
from roadscope.benchmarks.speed.trackers import COUNTS, LEAD, own_trackers
from roadscope.benchmarks.tables import speed_table
from roadscope.trackers import TRACKERS

ROWS = [
    SpeedRow("tracker slow, 5 targets", 12.0, "ms", 24.0, "gnn"),
    SpeedRow("tracker slow, 50 targets", 600.0, "ms", 1203.4, "gnn"),
    SpeedRow("tracker gnn, 5 targets", 0.5, "ms"),
    SpeedRow("tracker absent", None, "absent is not installed: pip install absent"),
]


@pytest.fixture
def one_is_slow(monkeypatch):
    """`gnn` stands for a tracker of others; its updates take 0.2 s, 0.1 s those of `greedy`."""
    monkeypatch.setattr(tracker_peers, "BESIDE", {"gnn": "greedy"})
    ticks = (0.0, 0.2, 0.2, 0.3)
    clock = (0.3 * (k // 4) + ticks[k % 4] for k in count())
    monkeypatch.setattr(tracker_peers, "process_time", lambda: next(clock))


def test_every_tracker_of_others_has_one_of_ours_beside() -> None:
    assert set(BESIDE) == set(TRACKERS) - set(own_trackers())
    assert set(BESIDE.values()) <= set(own_trackers())


@pytest.mark.parametrize("name", BESIDE)
def test_who_is_installed_is_measured_and_others_are_told(name: str) -> None:
    rows = measure_peers([name], (5, 8), LEAD + 3)
    if missing := TRACKERS.missing(name):
        assert rows == [SpeedRow(f"tracker {name}", None, missing)]
        return
    assert [row.name for row in rows] == [f"tracker {name}, {n} targets" for n in (5, 8)]
    assert all(row.value > 0 and row.ratio > 0 and row.beside == BESIDE[name] for row in rows)


def test_who_is_not_installed_has_a_row_that_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TRACKERS, "missing", lambda name: f"{name} is not installed: pip")
    rows = measure_peers()
    assert [row.name for row in rows] == [f"tracker {name}" for name in BESIDE]
    assert all(row.value is None and "is not installed" in row.unit for row in rows)


def test_the_ratio_is_of_the_same_frames(one_is_slow) -> None:
    (row,) = measure_peers(["gnn"], (5,), LEAD + 3)
    assert row == SpeedRow("tracker gnn, 5 targets", pytest.approx(200), "ms",
                           pytest.approx(2), "greedy")  # fmt: skip


def test_who_would_take_too_long_is_left_out_by_name(one_is_slow) -> None:
    """50 targets would take 100 times as long as 5, 20 s an update, 13 updates."""
    rows = measure_peers(["gnn"], (50, 5, 100), LEAD + 3)
    assert [row.name for row in rows] == [f"tracker gnn, {n} targets" for n in (5, 50, 100)]
    assert [row.value is None for row in rows] == [False, True, True]
    assert rows[1].unit == "left out: an update would take about 20 s"
    assert rows[2].unit == "left out: an update would take about 80 s"


def test_all_sizes_are_those_of_ours() -> None:
    assert measure_peers.__defaults__[1] == COUNTS == (10, 50, 200, 500)


def test_the_table_has_a_column_of_ratios_where_there_are_any(tmp_path: Path) -> None:
    console = Console(width=90, record=True)
    console.print(speed_table(ROWS))
    lines = [" ".join(line.split()) for line in console.export_text().splitlines()]
    assert lines[0] == "measured value unit ratio"
    assert "tracker slow, 5 targets 12 ms 24 x gnn" in lines
    assert "tracker slow, 50 targets 600 ms 1203 x gnn" in lines
    assert any(line.startswith("tracker absent -") for line in lines)
    console.print(speed_table(ROWS[2:]))
    assert "ratio" not in console.export_text()
    write_speed(ROWS, tmp_path / "speed.json")
    written = json.loads((tmp_path / "speed.json").read_text())
    assert [row.get("ratio") for row in written] == [24.0, 1203.4, None, None]
    assert written[3]["value"] is None
