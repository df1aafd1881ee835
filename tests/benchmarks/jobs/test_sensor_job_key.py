"""A result's key of the boards with a camera changes with every file that decides it."""

from pathlib import Path

import pytest
from edited_keys import assert_changed, copied

KEYS = """
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.camera_job import CameraJob
from roadscope.benchmarks.jobs.fused import FusedSpec
from roadscope.benchmarks.jobs.fusion_job import FusionJob
from roadscope.benchmarks.jobs.job import Job
episode = Episode("street", 20000, "wide", 1.0)
print(CameraJob("entry", "network", episode, 0.5).key)
print(FusionJob("entry", FusedSpec(fusion="union"), episode, Eligibility(), 0.4).key)
print(Job("tracking", "entry", "fused?fusion=union", "nearest", episode, Eligibility()).key)
"""


@pytest.mark.slow
def test_what_decides_a_result_is_in_its_key(tmp_path: Path) -> None:
    edits = [
        ("envs/imaging/light.py", [True, True, True]),
        ("detectors/camera/decode.py", [True, True, True]),
        ("benchmarks/images.py", [True, True, True]),
        ("benchmarks/jobs/look.py", [True, True, True]),
        ("benchmarks/metrics/image_detection.py", [True, True, True]),
        ("fusion/overlap.py", [False, True, True]),
        ("fusion/weights.toml", [False, True, True]),
        ("benchmarks/targets.py", [False, True, True]),
        ("benchmarks/jobs/fusion_job.py", [False, True, False]),
        ("trackers/nearest.py", [False, False, True]),
        ("benchmarks/boards/tables.py", [False, False, False]),
    ]
    with copied(KEYS, tmp_path) as copy:
        before = assert_changed(copy, edits)
        weights = tmp_path / "roadscope/detectors/camera/weights/network.safetensors"
        weights.write_bytes(weights.read_bytes() + b"\0")
        assert not set(before) & set(copy.keys())
