from __future__ import annotations

from itertools import count

import numpy as np
import pytest

from roadscope.benchmarks.drive import drive
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.speed import odometry
from roadscope.benchmarks.speed.odometry import (
    LEAD,
    PAPER_MS,
    RIG,
    measure_odometries,
    measure_stages,
    own_odometries,
    timed_updates,
)
from roadscope.core import OdometryEstimate
from roadscope.odometry.still import StillOdometry


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(odometry, "DURATION_S", 1.4)


def test_rows_are_of_each_odometry_and_of_the_paper() -> None:
    rows = measure_odometries(RIG, ["still", "dead-reckoning"])
    named = {row.name: row.value for row in rows}
    assert named["Zhang 2022 as printed, VLP-16"] == PAPER_MS
    for name in ("still", "dead-reckoning"):
        middle, most, worst = (
            named[f"odometry {name}, {RIG}{tail}"] for tail in ("", ", p90", ", slowest scan")
        )
        assert 0 < middle <= most <= worst


def test_who_misses_the_goal_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(odometry, "process_time", count(step=0.009).__next__)
    rows = {row.name: row for row in measure_odometries(RIG, ["still"])}
    late = rows[f"too slow, {RIG}: still"]
    assert (late.value, late.unit) == (pytest.approx(9.0), "ms of 8")


def test_odometries_take_turns_on_scans_of_their_own() -> None:
    order: list[tuple[str, float, float]] = []

    class Noted:
        def __init__(self, name: str) -> None:
            self.name = name

        def reset(self, lidar_from_imu: object = None) -> None: ...

        def update(self, scan, imu=None) -> OdometryEstimate:  # type: ignore[no-untyped-def]
            order.append((self.name, scan.stamp_s, float(np.abs(scan.points).max())))
            scan.points[:] = 0
            return StillOdometry().update(scan)

    steps = list(drive(Episode("two-way", 17, RIG, 1.4)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(odometry.ODOMETRIES, "make", Noted)
        times_ms = timed_updates(["a", "b"], steps, None)
    assert [name for name, _, _ in order] == ["a", "b"] * len(steps)
    assert all(largest > 1 for _, _, largest in order)
    assert {name: len(values) for name, values in times_ms.items()} == dict.fromkeys(
        "ab", len(steps) - LEAD
    )
    with pytest.raises(ValueError, match="more than 10 scans"):
        timed_updates(["still"], steps[:LEAD], None)


def test_stages_add_up_to_clustering_and_labelling() -> None:
    named = {row.name: row.value for row in measure_stages(RIG, 2)}
    parts = (odometry.CLUSTERED, odometry.CUT, odometry.CUT, odometry.LABELLED)
    for place in (RIG, "corridor"):
        both = named[f"clustering and labelling, {place}"]
        assert both == pytest.approx(sum(named[f"{part}, {place}"] for part in parts))
        assert {f"{stage}, {place}" for stage in ("deskew", odometry.PREDICTED)} <= set(named)


def test_features_are_matched_as_many_as_a_drive_gives() -> None:
    *_, before, now = drive(Episode(odometry.SCENARIO, odometry.SEED, RIG, 1.5))
    motion = (before.world_from_lidar.inverse() @ now.world_from_lidar).matrix
    ours, theirs, _ = odometry.stages(before.scan, now.scan, motion)[odometry.MATCHED].args
    assert min(len(ours.planes), len(theirs.planes)) > 500
    assert min(len(ours.edges), len(theirs.edges)) > 50


def test_larger_lidars_are_for_those_that_need_no_other_package() -> None:
    assert "voxel-map" in own_odometries()
    assert not {"kiss-icp", "small-gicp", "genz-icp", "rko-lio"} & set(own_odometries())
