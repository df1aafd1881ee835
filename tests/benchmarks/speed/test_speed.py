from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from roadscope.benchmarks.speed import measure
from roadscope.benchmarks.speed.casting import TILTS, agreement, import_open3d
from roadscope.benchmarks.speed.measure import measure_speed, write_speed
from roadscope.benchmarks.speed.rows import SpeedRow
from roadscope.envs.raycast.cast import NOTHING, Hits


def test_rows_without_open3d(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "import_open3d", lambda: None)
    told: list[tuple[str, int, int]] = []
    rows = measure_speed(
        (3,), compared=3, repeats=1, progress=lambda *step: told.append(step), parts=["casting"]
    )
    assert [row.name for row in rows] == [
        "open3d installed",
        "cast, level, 3 bodies",
        "cast, tilted, 3 bodies",
        "whole sweep, level, 3 bodies",
        "whole sweep, tilted, 3 bodies",
    ]
    assert rows[0].value == 0
    assert all(row.value > 0 for row in rows[1:])
    assert told == [("3 bodies", 0, 2), ("whole sweeps", 1, 2)]


def test_rows_with_open3d() -> None:
    if import_open3d() is None:
        pytest.skip("Open3D cannot be imported")
    rows = {row.name: row for row in measure_speed((), compared=5, repeats=1, parts=["casting"])}
    assert rows["open3d installed"].value == 1
    for tilt in TILTS:
        name = f"{tilt}, 5 bodies"
        ratio = rows[f"cast beside Open3D, {name}"].value / rows[f"Open3D cast, {name}"].value
        assert rows[f"cast over Open3D cast, {name}"].value == pytest.approx(ratio)
        assert rows[f"median range difference, {name}"].value < 1e-5
        assert rows[f"mismatched rays, {name}"].value <= 10


def test_agreement_counts_other_owners_and_other_ranges() -> None:
    ones = np.ones((1, 5), np.float32)
    ours = Hits(ones * 10, np.array([[0, 1, -1, -2, NOTHING]], np.int32), ones, ones)
    ranges = np.array([[10.0, 10.5, 10, 10.001, 0]])
    rows = agreement("here", ours, ranges, np.array([[0, 1, 4, -2, NOTHING]]))
    assert rows[-1] == SpeedRow("mismatched rays, here", 2.0, "of 5")
    assert rows[0].value == pytest.approx(0.0005)


def test_file(tmp_path: Path) -> None:
    write_speed([SpeedRow("cast", 2.5, "Mray/s")], tmp_path / "speed.json")
    written = json.loads((tmp_path / "speed.json").read_text())
    assert written == [{"name": "cast", "value": 2.5, "unit": "Mray/s"}]
