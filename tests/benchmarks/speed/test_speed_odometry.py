from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from roadscope.benchmarks import Episode, drive
from roadscope.benchmarks.speed import (
    LEAD_SCANS,
    RIG,
    measure_odometries,
    own_odometries,
    timed_scans,
)
from roadscope.core import OdometryEstimate
from roadscope.odometry import StillOdometry


def test_rows_are_of_each_odometry() -> None:
    rows = measure_odometries(RIG, ["still", "dead-reckoning"], 1.4)
    named = {row.name: row.value for row in rows}
    for name in ("still", "dead-reckoning"):
        middle, most, worst = (
            named[f"odometry {name}, {RIG}{tail}"] for tail in ("", ", p90", ", slowest scan")
        )
        assert 0 < middle <= most <= worst


class Noted:
    """Stands still, notes its turns, and overwrites the scans that it gets."""

    turns: ClassVar[list[tuple[str, float]]] = []

    def __init__(self, *, name: str = "") -> None:
        self.name = name

    def reset(self, lidar_from_imu: object = None) -> None: ...

    def update(self, scan, imu=None) -> OdometryEstimate:  # type: ignore[no-untyped-def]
        Noted.turns.append((self.name, float(np.abs(scan.points).max())))
        scan.points[:] = 0
        return StillOdometry().update(scan)


def test_odometries_take_turns_on_scans_of_their_own() -> None:
    names = [f"{__name__}:Noted?name={name}" for name in "ab"]
    steps = list(drive(Episode("two-way", 17, RIG, 1.4)))
    Noted.turns.clear()
    times_ms = timed_scans(names, steps, None)
    assert [name for name, _ in Noted.turns] == ["a", "b"] * len(steps)
    assert all(largest > 1 for _, largest in Noted.turns)
    assert {name: len(values) for name, values in times_ms.items()} == dict.fromkeys(
        names, len(steps) - LEAD_SCANS
    )
    with pytest.raises(ValueError, match="more than 10 scans"):
        timed_scans(["still"], steps[:LEAD_SCANS], None)


def test_larger_lidars_are_for_those_that_need_no_other_package() -> None:
    assert "voxel-map" in own_odometries()
    assert not {"kiss-icp", "small-gicp", "genz-icp", "rko-lio"} & set(own_odometries())
