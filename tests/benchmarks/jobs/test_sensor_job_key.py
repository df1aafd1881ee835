"""A result's key of the boards with a camera changes with every file that decides it."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import roadscope

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


def keys(root: Path) -> list[str]:
    result = subprocess.run(
        [sys.executable, "-c", KEYS], cwd=root, capture_output=True, text=True, check=True
    )
    return result.stdout.split()


@pytest.mark.slow
def test_what_decides_a_result_is_in_its_key(tmp_path: Path) -> None:
    shutil.copytree(Path(roadscope.__file__).parent, tmp_path / "roadscope")
    before = keys(tmp_path)
    for file, changed in (
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
    ):
        path = tmp_path / "roadscope" / file
        path.write_text(path.read_text() + "\n# edited\n")
        after = keys(tmp_path)
        assert [a != b for a, b in zip(before, after, strict=True)] == changed, file
        before = after
    weights = tmp_path / "roadscope/detectors/camera/weights/network.safetensors"
    weights.write_bytes(weights.read_bytes() + b"\0")
    assert not set(before) & set(keys(tmp_path))
