from __future__ import annotations

import pytest

from roadscope.benchmarks import speed, speed_detectors
from roadscope.benchmarks.speed_detectors import measure_dbscan, measure_detectors, measure_stages
from roadscope.detectors import DETECTORS
from roadscope.detectors.clustering import CLUSTERINGS
from roadscope.detectors.ground import GROUNDS
from roadscope.detectors.shape import SHAPES


def test_every_stage_has_a_row() -> None:
    rows = measure_stages("lux", 1)
    names = [row.name.removesuffix(", lux") for row in rows]
    assert {f"ground {name}" for name in GROUNDS} <= set(names)
    assert {f"clustering {name}" for name in CLUSTERINGS} <= set(names)
    assert {f"shape {name}" for name in SHAPES} <= set(names)
    assert names[0] == "returns"
    assert rows[0].value > 500
    assert all(row.unit == "ms of 80" and row.value > 0 for row in rows[1:])


def test_every_registered_detector_has_a_row_and_the_slowest_its_share() -> None:
    *rows, slowest = measure_detectors("lux", 1)
    assert [row.name for row in rows] == [f"detector {name}, lux" for name in DETECTORS.names()]
    assert slowest.value == pytest.approx(max(row.value for row in rows) / 80 * 100)
    assert slowest.unit == "% of 80 ms"


def test_only_named_detectors() -> None:
    rows = measure_detectors("lux", 1, ["distance?distance_m=2"])
    assert [row.name for row in rows[:-1]] == ["detector distance?distance_m=2, lux"]


def test_dbscan_beside_scikit_learn() -> None:
    ours, theirs, ratio, mismatched = measure_dbscan(1, points=300, rig="lux")
    assert (ours.name, ours.unit) == ("DBSCAN, 300 points", "ms")
    assert ratio.value == pytest.approx(theirs.value / ours.value)
    assert (mismatched.value, mismatched.unit) == (0, "of 300")


def test_dbscan_alone_without_scikit_learn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed_detectors, "import_scikit_learn", lambda: None)
    (row,) = measure_dbscan(1, points=300, rig="lux")
    assert row.name == "DBSCAN, 300 points"


def test_parts_of_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "RIGS", ("lux",))
    told: list[str] = []
    rows = speed.measure_speed(
        repeats=1, parts=["detectors"], progress=lambda name, *_: told.append(name)
    )
    assert told == ["stages, lux", "detectors, lux", "DBSCAN"]
    assert not any("cast" in row.name for row in rows)
    with pytest.raises(ValueError, match="no part 'radar'; known: casting, detectors"):
        speed.measure_speed(parts=["radar"])
