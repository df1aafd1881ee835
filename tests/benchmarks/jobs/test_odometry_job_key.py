"""The key of an odometry's result changes with every file that decides it."""

from pathlib import Path

import pytest
from edited_keys import assert_changed, copied

KEYS = """
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.odometry_job import OdometryJob
episode = Episode("cold-start", 20000, "vlp16-imu", 1.0)
for spec in ("voxel-map", "oracle?odometry=voxel-map", "noisy-odometry"):
    print(OdometryJob(spec, spec, episode).key)
"""


@pytest.mark.slow
def test_what_decides_poses_and_scores_is_in_the_key(tmp_path: Path) -> None:
    edits = [
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
    ]
    with copied(KEYS, tmp_path) as copy:
        assert_changed(copy, edits)
