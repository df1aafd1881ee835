"""The key of an odometry's result changes with every file that decides it."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import roadscope

KEYS = """
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.odometry_job import OdometryJob
episode = Episode("cold-start", 20000, "vlp16-imu", 1.0)
for spec in ("voxel-map", "oracle?odometry=voxel-map", "noisy-odometry"):
    print(OdometryJob(spec, spec, episode).key)
"""


def keys(root: Path) -> list[str]:
    result = subprocess.run(
        [sys.executable, "-c", KEYS], cwd=root, capture_output=True, text=True, check=True
    )
    return result.stdout.split()


@pytest.mark.slow
def test_what_decides_poses_and_scores_is_in_the_key(tmp_path: Path) -> None:
    shutil.copytree(Path(roadscope.__file__).parent, tmp_path / "roadscope")
    before = keys(tmp_path)
    assert len(set(before)) == 3
    for file, changed in (
        ("odometry/voxels/matching.py", [True, True, False]),
        ("detectors/ground/polar.py", [True, True, True]),
        ("envs/sensors/imu.py", [True, True, True]),
        ("envs/traffic/script_cold_start.py", [True, True, True]),
        ("benchmarks/drive.py", [True, True, True]),
        ("benchmarks/noisy_odometry.py", [True, True, True]),
        ("benchmarks/metrics/odometry/drift.py", [True, True, True]),
        ("benchmarks/jobs/odometry_job.py", [True, True, True]),
        ("trackers/nearest.py", [False, False, False]),
        ("benchmarks/boards/tables.py", [False, False, False]),
    ):
        path = tmp_path / "roadscope" / file
        path.write_text(path.read_text() + "\n# edited\n")
        after = keys(tmp_path)
        assert [a != b for a, b in zip(before, after, strict=True)] == changed, file
        before = after
