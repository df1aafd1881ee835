"""Exports of our own suites are KITTI's tracking data: every board of objects takes them."""

import pytest

from roadscope import leaderboard
from roadscope.benchmarks import export_suite, kitti_suite, parse_suite, plan_export

MINI = """
name = "mini"
version = 1
summary = "half a second of a street"
rig = "wide"
duration_s = 0.45
scenarios = ["street"]
split = "validation"
seeds = 1
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("export")
    return export_suite(plan_export(parse_suite(MINI, "mini"), place / "mini", detections=[]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("board", "metric"), [("detection", "ap_3d_hard"), ("camera", "ap_2d_hard")]
)
def test_the_labels_of_an_export_are_found_where_the_labels_are(folder, board, metric):
    suite = kitti_suite(folder, [board], lidar_height_m=1.9)
    boards = list(suite.boards)
    for name in boards:
        suite = suite.with_settings(
            name, entries=("cluster" if board == "detection" else "colour-blobs",)
        )
    results = leaderboard(suite, boards=[board])
    assert not results.failures
    assert set(results.boards()) == set(boards)
    marks = [results.row(name, "oracle", metric) for name in boards]
    assert max(mark.samples for mark in marks) >= 10
    for mark in marks:
        assert not mark.samples or mark.value >= (min(mark.samples, 41) - 2) / 40
