from __future__ import annotations

import numpy as np
import pytest

from research import speed_casting
from research.speed_casting import agreement, beside_open3d, import_open3d
from roadscope.benchmarks.speed import TILTS, SpeedRow
from roadscope.envs.raycast import NOTHING, Hits


def test_without_open3d_a_row_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed_casting, "import_open3d", lambda: None)
    (row,) = beside_open3d("level", TILTS["level"], 3, repeats=1)
    assert row.value is None
    assert "not installed" in row.unit


@pytest.mark.parametrize("tilt", TILTS)
def test_beside_open3d(tilt: str) -> None:
    if import_open3d() is None:
        pytest.skip("Open3D cannot be imported")
    rows = {row.name: row for row in beside_open3d(tilt, TILTS[tilt], 5, repeats=1)}
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
