"""A result's key changes with every file that decides it, and with no other."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from edited_keys import Copy, assert_changed, copied

HEAD = """
from roadscope.benchmarks.boards import BOARDS
from roadscope.benchmarks.boards.board import JobOptions
from roadscope.benchmarks.suite_files import parse_suite
from roadscope.core import Spec
"""
KEYS = """
SUITE = '''
name = "keys"
version = 1
rig = "{rig}"
scenarios = ["{scenario}"]
seeds = 1
duration_s = 1.0
[tracking]
detectors = ["{detector}"]
[fusion]
lidar = ["cluster-boxes"]
camera = ["network"]
'''
for name, entry in {entries}:
    board = BOARDS[name]
    jobs = board.jobs(
        parse_suite(SUITE, ""),
        [board.check_entry(Spec.parse(entry))],
        JobOptions(marks=False),
    )
    print(*(job.key for job in jobs))
"""


def keys_of(rig: str, scenario: str, detector: str, *entries: tuple[str, str]) -> str:
    """Return a program that prints the keys of entries, each a board and a spec."""
    return HEAD + KEYS.format(rig=rig, scenario=scenario, detector=detector, entries=entries)


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Copy, list[list[str]]]]:
    """A copy of the package, and the keys that it gave, the last at the end."""
    code = keys_of("lux", "two-way", "pag", ("detection", "pag"), ("tracking", "nearest"))
    with copied(code, tmp_path_factory.mktemp("copy")) as made:
        yield made, [made.keys()]


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("file", "changed"),
    [
        ("core/pose.py", [True, True]),
        ("envs/raycast/kernels.py", [True, True]),
        ("envs/traffic/driving.py", [True, True]),
        ("detectors/clustering/pag.py", [True, True]),
        ("trackers/_nearest.py", [False, True]),
        ("trackers/learned/unknown.toml", [False, False]),
        ("benchmarks/eligibility.py", [True, True]),
        ("benchmarks/episode.py", [True, True]),
        ("benchmarks/parked.py", [True, True]),
        ("benchmarks/loop.py", [True, True]),
        ("benchmarks/nodes/detections.py", [True, True]),
        ("benchmarks/nodes/tracks.py", [False, True]),
        ("benchmarks/metrics/tracking/clear.py", [False, True]),
        ("benchmarks/metrics/detection.py", [True, True]),
        ("benchmarks/report/tables.py", [False, False]),
        ("benchmarks/results/rows.py", [False, False]),
        ("benchmarks/run.py", [False, False]),
    ],
)
def test_what_decides_a_result_is_in_its_key(
    copy: tuple[Copy, list[list[str]]], file: str, changed: list[bool]
) -> None:
    made, keys_of_copies = copy
    made.edit(file)
    keys_of_copies.append(made.keys())
    assert len(keys_of_copies[-1]) == 2
    assert [a != b for a, b in zip(*keys_of_copies[-2:], strict=True)] == changed


@pytest.mark.slow
def test_what_decides_poses_and_scores_is_in_the_key(tmp_path: Path) -> None:
    edits = [
        ("odometry/voxels/matching.py", [True, True, False]),
        ("detectors/ground/polar.py", [False, False, False]),
        ("detectors/sorting.py", [True, True, False]),
        ("envs/sensors/imu.py", [True, True, True]),
        ("envs/traffic/scripts.py", [True, True, True]),
        ("benchmarks/drive_steps.py", [True, True, True]),
        ("benchmarks/noisy_odometry.py", [True, True, True]),
        ("benchmarks/metrics/odometry.py", [True, True, True]),
        ("benchmarks/nodes/poses.py", [True, True, True]),
        ("trackers/_nearest.py", [False, False, False]),
        ("benchmarks/report/tables.py", [False, False, False]),
    ]
    specs = ("voxel-map", "oracle?odometry=voxel-map", "noisy-odometry")
    entries = [("odometry", spec) for spec in specs]
    with copied(keys_of("vlp16-imu", "cold-start", "pag", *entries), tmp_path) as copy:
        assert_changed(copy, edits)


@pytest.mark.slow
def test_what_decides_a_result_with_a_camera_is_in_its_key(tmp_path: Path) -> None:
    edits = [
        ("envs/imaging/light.py", [True, True, True]),
        ("detectors/camera/decoding.py", [True, True, True]),
        ("benchmarks/images.py", [True, True, True]),
        ("benchmarks/nodes/images.py", [True, True, True]),
        ("fusion/overlap.py", [True, True, True]),
        ("benchmarks/boards/fusion.py", [False, True, False]),
        ("trackers/_nearest.py", [False, False, True]),
        ("benchmarks/report/tables.py", [False, False, False]),
    ]
    entries = (("camera", "network"), ("fusion", "union"), ("tracking", "nearest"))
    code = keys_of("wide", "street", "fused?fusion=union", *entries)
    with copied(code, tmp_path) as copy:
        before = assert_changed(copy, edits)
        weights = tmp_path / "roadscope/detectors/camera/weights/network.safetensors"
        weights.write_bytes(weights.read_bytes() + b"\0")
        assert not set(before) & set(copy.keys())
