"""A plug-in of a perception stack that fails in the closed loop costs the drives with it."""

from pathlib import Path

import pytest

from roadscope.benchmarks.isolation import Limits
from tests.torture.acts import ACTS, FAILING, HARMLESS
from tests.torture.boards import (
    HANG_LIMITS,
    LIMITS,
    ONE_EPISODE,
    TortureRun,
    Workshop,
    left_running,
    workshop,
)

OWN = "distance + nearest"
STACKS = {
    "detection": "{} + nearest",
    "camera": "fused?lidar=distance&camera={}&fusion=union + nearest",
    "tracking": "distance + {}",
    "fusion": "fused?lidar=distance&camera=colour-blobs&fusion={} + nearest",
    "odometry": "distance + nearest?ego={}",
}
"""By the board of a plug-in a stack with it."""
SUITE = ONE_EPISODE.replace("duration_s = 1.5", "duration_s = 0.5")
QUICK = ("honest", "written_later", "exit_0", "load.exit_0", "forged_bytes", "varying_masses")
HANGING = ("hang",)


def driven(place: Workshop, stacks: list[str], *, jobs: int, limits: Limits = LIMITS) -> TortureRun:
    """Drive with stacks, and with the truth and with nothing."""
    named = ", ".join(f'"{stack}"' for stack in stacks)
    place.suite.write_text(SUITE.replace('stacks = ["truth"]', f"stacks = [{named}]"))
    return place.run([], jobs=jobs, boards=["driving"], limits=limits)


@pytest.fixture(scope="module")
def own_drives(tmp_path_factory: pytest.TempPathFactory) -> TortureRun:
    return driven(workshop(tmp_path_factory.mktemp("own") / "run"), [OWN], jobs=1)


@pytest.mark.parametrize(
    ("names", "limits"), [(QUICK, LIMITS), (HANGING, HANG_LIMITS)], ids=["quick", "hanging"]
)
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_stage_that_fails_in_a_stack_loses_the_drives_with_it(
    tmp_path: Path, own_drives: TortureRun, names: tuple[str, ...], limits: Limits, jobs: int
) -> None:
    place = workshop(tmp_path / "run")
    acts = [act for act in ACTS if act.name in names]
    cases = [(board, act) for board in STACKS for act in acts if board in act.boards]
    stacks = {
        (board, act): STACKS[board].format(place.spec(board, act.name)) for board, act in cases
    }
    run = driven(place, [OWN, *stacks.values()], jobs=jobs, limits=limits)
    assert run.values() == own_drives.values()
    scores = {key: run.values(hostile=True)[drive_on(stack)] for key, stack in stacks.items()}
    for (board, act), values in scores.items():
        if act in FAILING:
            entry, reason = place.spec(board, act.name), values["reason"]
            assert reason.startswith(entry)
            assert act.says in reason.removeprefix(entry).lower()
        else:
            assert values == scores[board, HARMLESS[0]]
            assert values["reason"] is None
    assert run.warned == []
    assert left_running(place.plugins) == []


def drive_on(stack: str) -> str:
    """Return the place of a drive in the values of a run."""
    return f"driving idm on {stack} motorway {stack}"
