from __future__ import annotations

import pytest

from research import speed_stages
from research.speed_stages import (
    CLUSTERED,
    CUT,
    LABELLED,
    MATCHED,
    PREDICTED,
    RIG,
    SCENARIO,
    SEED,
    ZHANG_2022,
    measure_corridor_stages,
    measure_detector_stages,
    measure_odometry_stages,
    missed_goals,
    odometry_stages,
)
from roadscope.benchmarks import Episode, drive
from roadscope.benchmarks.speed import SpeedRow
from roadscope.detectors.clustering import CLUSTERINGS
from roadscope.detectors.ground import GROUNDS
from roadscope.detectors.shape import SHAPES


def test_every_stage_of_detectors_has_a_row() -> None:
    rows = measure_detector_stages("lux", 1)
    names = [row.name.removesuffix(", lux") for row in rows]
    assert {f"ground {name}" for name in GROUNDS} <= set(names)
    assert {f"clustering {name}" for name in CLUSTERINGS} <= set(names)
    assert {f"shape {name}" for name in SHAPES} <= set(names)
    assert names[0] == "returns"
    assert rows[0].value > 500
    assert all(row.unit == "ms" and row.value > 0 for row in rows[1:])


def test_stages_add_up_to_clustering_and_labelling(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed_stages, "DURATION_S", 1.4)
    rows = [*measure_odometry_stages(RIG, 2), *measure_corridor_stages(2)]
    assert rows[-1] == ZHANG_2022
    named = {row.name: row.value for row in rows}
    for place in (RIG, "corridor"):
        both = named[f"clustering and labelling, {place}"]
        parts = (CLUSTERED, CUT, CUT, LABELLED)
        assert both == pytest.approx(sum(named[f"{part}, {place}"] for part in parts))
        assert {f"{stage}, {place}" for stage in ("deskew", PREDICTED)} <= set(named)


def test_features_are_matched_as_many_as_a_drive_gives() -> None:
    *_, before, now = drive(Episode(SCENARIO, SEED, RIG, 1.5))
    motion = (before.world_from_lidar.inverse() @ now.world_from_lidar).matrix
    ours, theirs, _ = odometry_stages(before.scan, now.scan, motion)[MATCHED].args
    assert min(len(ours.planes), len(theirs.planes)) > 500
    assert min(len(ours.edges), len(theirs.edges)) > 50


@pytest.mark.parametrize(
    ("name", "value", "late"),
    [
        ("detector distance, lux, slowest frame", 5.1, True),
        ("detector distance, lux", 5.1, False),
        ("detector distance, hdl64e, slowest frame", 99.0, False),
        ("tracker gnn, 200 targets, p90", 1.1, True),
        ("tracker gnn, 200 targets, p99", 1.1, False),
        ("tracker jpda, 200 targets", 1.1, True),
        ("tracker jpda, 50 targets", 1.9, False),
        ("odometry still, vlp16-imu", 8.1, True),
        ("odometry kiss-icp, vlp16-imu", 80.0, False),
        ("images plain colours, 1280 x 960", 59.0, True),
        ("images plain colours, 1280 x 960", 61.0, False),
    ],
)
def test_figures_that_miss_their_goal_are_named(name: str, value: float, late: bool) -> None:
    missed = missed_goals([SpeedRow(name, value, "ms")])
    assert [row.name for row in missed] == ([f"too slow: {name}"] if late else [])
    assert all(row.value == value for row in missed)
