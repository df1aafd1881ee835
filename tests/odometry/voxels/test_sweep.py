"""Which returns of a scan are matched."""

from dataclasses import replace

import numpy as np
import pytest
from toy_drive import ToyDrive, emptied

from roadscope.odometry.voxels import ENOUGH, ThinnedScan


@pytest.fixture(scope="module")
def scan():
    return ToyDrive(0.0, 0.0).scan(0)


def shrunk(scan, factor):
    return replace(scan, points=(factor * scan.points).astype(np.float32))


def test_on_a_road_one_return_of_each_cube_is_matched(scan):
    sweep = ThinnedScan.of(scan, 0.3, 0.8)
    assert ENOUGH <= len(sweep.matched_rows) < len(sweep.rows)
    assert not sweep.close
    cubes = np.floor(scan.points[sweep.rows[sweep.matched_rows]] / 0.8)
    assert len(np.unique(cubes, axis=0)) == len(sweep.matched_rows)


def test_in_a_room_more_of_the_selected_returns_are_matched(scan):
    small_scan = shrunk(scan, 0.1)
    sweep = ThinnedScan.of(small_scan, 0.3, 0.8)
    coarse = len(np.unique(np.floor(small_scan.points[sweep.rows] / 0.8), axis=0))
    assert coarse < len(sweep.matched_rows) <= len(sweep.rows)
    assert sweep.close
    assert len(np.unique(sweep.matched_rows)) == len(sweep.matched_rows)


def test_a_sensor_with_few_beams_is_not_in_a_room(scan):
    sweep = ThinnedScan.of(scan.select(np.arange(len(scan)) % 16 == 0), 0.3, 0.8)
    assert len(sweep.matched_rows) < ENOUGH
    assert not sweep.close


def test_few_returns_stay_few(scan):
    poor = scan.select(np.arange(len(scan)) % 400 == 0)
    assert len(ThinnedScan.of(poor, 0.3, 0.8).matched_rows) <= len(poor)
    assert not len(ThinnedScan.of(emptied(scan), 0.3, 0.8).matched_rows)
