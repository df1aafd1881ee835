from __future__ import annotations

import pytest

from roadscope.benchmarks.speed import detectors, measure
from roadscope.benchmarks.speed.detectors import (
    FRAMES,
    LEAD,
    SCENES,
    driven_frames,
    measure_dbscan,
    measure_detectors,
    measure_stages,
    timed_frames,
)
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


def test_every_registered_detector_finds_something_while_it_is_timed() -> None:
    rows = measure_detectors("lux", 1, scenes=SCENES[:1])
    named = [row.name for row in rows if row.name.startswith("detector ")]
    assert named[::2] == [f"detector {name}, lux" for name in DETECTORS.names()]
    assert all(slowest == f"{name}, slowest frame" for name, slowest in pairs(named))
    fewest = next(row for row in rows if row.name == "fewest detections a frame, lux")
    assert fewest.value > 0.5


def pairs(rows: list[str]) -> list[tuple[str, str]]:
    return list(zip(rows[::2], rows[1::2], strict=True))


def test_who_is_too_slow_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(detectors.GOALS_MS, "lux", 1e-6)
    median, slowest, _, within, late = measure_detectors(
        "lux", 1, ["distance?distance_m=2"], SCENES[:1]
    )
    assert median.name == "detector distance?distance_m=2, lux"
    assert 0 < median.value <= slowest.value
    assert (within.value, within.unit) == (0, "of 1")
    assert late.name == "too slow, lux: distance?distance_m=2"
    monkeypatch.setitem(detectors.GOALS_MS, "lux", 1e6)
    *_, within = measure_detectors("lux", 1, ["distance"], SCENES[:1])
    assert within.value == 1


def test_frames_before_the_lead_are_not_timed() -> None:
    frames, _ = driven_frames("lux")
    assert len(frames) == FRAMES
    times_ms, found = timed_frames("long-range", [frames, frames], 2)
    assert times_ms.shape == (2, FRAMES - LEAD)
    assert found > 0


def test_dbscan_beside_scikit_learn() -> None:
    ours, theirs, ratio, mismatched = measure_dbscan(1, points=300, rig="lux")
    assert (ours.name, ours.unit) == ("DBSCAN, 300 points", "ms")
    assert ratio.value == pytest.approx(theirs.value / ours.value)
    assert (mismatched.value, mismatched.unit) == (0, "of 300")


def test_dbscan_alone_without_scikit_learn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detectors, "import_scikit_learn", lambda: None)
    (row,) = measure_dbscan(1, points=300, rig="lux")
    assert row.name == "DBSCAN, 300 points"


def test_where_the_goal_is_tight_detectors_run_three_times(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs = dict[str, int]()
    monkeypatch.setattr(measure, "measure_stages", lambda *_: [])
    monkeypatch.setattr(measure, "measure_dbscan", lambda _: [])
    monkeypatch.setattr(measure, "measure_detectors", lambda rig, n: runs.update({rig: n}) or [])
    measure.measure_speed(parts=["detectors"])
    assert runs == {"hdl64e": 1, "hdl32e": 1, "lux": 3}


def test_parts_of_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "RIGS", ("lux",))
    monkeypatch.setattr(measure, "measure_detectors", lambda rig, _: [])
    told: list[str] = []
    rows = measure.measure_speed(
        repeats=1, parts=["detectors"], progress=lambda name, *_: told.append(name)
    )
    assert told == ["stages, lux", "detectors, lux", "DBSCAN"]
    assert not any("cast" in row.name for row in rows)
    with pytest.raises(ValueError, match="no part 'radar'; known: casting, detectors, metrics"):
        measure.measure_speed(parts=["radar"])
