"""A result's key changes with every file that decides it."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import roadscope

KEYS = """
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.job import Job
episode = Episode("two-way", 20000, "lux", 1.0)
for board, detector, tracker in (("detection", "pag", None), ("tracking", "pag", "nearest")):
    print(Job(board, "entry", detector, tracker, episode, Eligibility()).key)
"""


def keys(root: Path) -> list[str]:
    result = subprocess.run(
        [sys.executable, "-c", KEYS], cwd=root, capture_output=True, text=True, check=True
    )
    return result.stdout.split()


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[list[str]]]:
    """A copy of the package, and the keys that it gave, the last at the end."""
    root = tmp_path_factory.mktemp("copy")
    shutil.copytree(Path(roadscope.__file__).parent, root / "roadscope")
    return root, [keys(root)]


@pytest.mark.parametrize(
    ("file", "changed"),
    [
        ("core/pose.py", [True, True]),
        ("envs/raycast/kernels.py", [True, True]),
        ("envs/traffic/driving.py", [True, True]),
        ("detectors/clustering/pag.py", [True, True]),
        ("trackers/nearest.py", [False, True]),
        ("trackers/learned/unknown.toml", [False, True]),
        ("benchmarks/eligibility.py", [True, True]),
        ("benchmarks/episode.py", [True, True]),
        ("benchmarks/parked.py", [True, True]),
        ("benchmarks/jobs/stack.py", [True, True]),
        ("benchmarks/jobs/job.py", [True, True]),
        ("benchmarks/metrics/tracking/clear.py", [True, True]),
        ("benchmarks/boards/tables.py", [False, False]),
    ],
)
def test_what_decides_a_result_is_in_its_key(
    copy: tuple[Path, list[list[str]]], file: str, changed: list[bool]
) -> None:
    root, given = copy
    path = root / "roadscope" / file
    path.write_text(path.read_text() + "# edited\n")
    given.append(keys(root))
    assert [a != b for a, b in zip(*given[-2:], strict=True)] == changed
