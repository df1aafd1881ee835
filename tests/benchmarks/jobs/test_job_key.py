"""A result's key changes with every file that decides it."""

from collections.abc import Iterator

import pytest
from edited_keys import Copy, copied

KEYS = """
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.job import Job
episode = Episode("two-way", 20000, "lux", 1.0)
for board, detector, tracker in (("detection", "pag", None), ("tracking", "pag", "nearest")):
    print(Job(board, "entry", detector, tracker, episode, Eligibility()).key)
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Copy, list[list[str]]]]:
    """A copy of the package, and the keys that it gave, the last at the end."""
    with copied(KEYS, tmp_path_factory.mktemp("copy")) as made:
        yield made, [made.keys()]


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
    copy: tuple[Copy, list[list[str]]], file: str, changed: list[bool]
) -> None:
    made, given = copy
    made.edit(file)
    given.append(made.keys())
    assert [a != b for a, b in zip(*given[-2:], strict=True)] == changed
