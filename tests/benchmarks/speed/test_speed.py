from __future__ import annotations

import json
from pathlib import Path

import pytest
from rich.console import Console

from roadscope.benchmarks import speed_table
from roadscope.benchmarks.speed import (
    PARTS,
    SpeedRow,
    SpeedStep,
    casting_steps,
    measure_speed,
    run_steps,
    write_speed,
)

ROWS = [SpeedRow("cast", 2.5, "Mray/s"), SpeedRow("tracker absent", None, "not installed")]


def test_casts_and_sweeps_are_measured() -> None:
    reported_steps: list[tuple[str, int, int]] = []
    steps = casting_steps(1, (3,), 3)
    rows = run_steps(steps, lambda *step: reported_steps.append(step))
    assert [row.name for row in rows] == [
        "cast, level, 3 bodies",
        "cast, tilted, 3 bodies",
        "whole sweep, level, 3 bodies",
        "whole sweep, tilted, 3 bodies",
    ]
    assert all(row.value > 0 for row in rows)
    assert reported_steps == [("3 bodies", 0, 2), ("whole sweeps", 1, 2)]


def test_parts_are_measured_in_the_order_in_which_they_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for part in PARTS:
        step = SpeedStep(part, lambda part=part: [SpeedRow(part, 1.0, "ms")])
        monkeypatch.setitem(PARTS, part, lambda step=step: [step])
    assert [row.name for row in measure_speed()] == list(PARTS)
    reported_names: list[str] = []
    rows = measure_speed(
        ["trackers", "casting"], progress=lambda name, *_: reported_names.append(name)
    )
    assert [row.name for row in rows] == reported_names == ["trackers", "casting"]
    with pytest.raises(ValueError, match="no part 'radar'; known: casting, detectors, trackers"):
        measure_speed(["radar"])


def test_file(tmp_path: Path) -> None:
    write_speed(ROWS, tmp_path / "speed.json")
    written = json.loads((tmp_path / "speed.json").read_text())
    assert written == [
        {"name": "cast", "value": 2.5, "unit": "Mray/s"},
        {"name": "tracker absent", "value": None, "unit": "not installed"},
    ]


def test_table() -> None:
    console = Console(width=90, record=True)
    console.print(speed_table(ROWS))
    lines = [" ".join(line.split()) for line in console.export_text().splitlines()]
    assert lines[0] == "measured value unit"
    assert "cast 2.5 Mray/s" in lines
    assert "tracker absent - not installed" in lines
