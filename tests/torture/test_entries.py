"""What hostile entries do costs them their own row, on all boards, with one worker and with two."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.torture.acts import FAILING, HARMLESS, TOLERATED, Act, pairs
from tests.torture.boards import MOST_MESSAGE, Run, Workshop, left_running, workshop

MOST_S = {True: 240.0, False: 1800.0}
"""What the quick set and the whole one may take on a loaded machine."""


@dataclass(frozen=True)
class Tortured:
    """A run with many hostile entries at once."""

    place: Workshop
    run: Run
    left: list[str]
    took_s: float
    quick: bool

    def spec(self, board: str, act: Act) -> str:
        return self.place.spec(board, act.name)


def tortured(folder: Path, honest: tuple[Workshop, Run], *, jobs: int, quick: bool) -> Tortured:
    """Run the suite with all hostile entries."""
    place = workshop(folder / "run", honest[0].cache)
    start = time.monotonic()
    acts = pairs((*FAILING, *HARMLESS, *TOLERATED), quick=quick)
    entries = [place.spec(board, act.name) for board, act in acts]
    run = place.run(entries, jobs=jobs)
    return Tortured(place, run, left_running(place.plugins), time.monotonic() - start, quick)


RUNS = (
    pytest.param((1, True), id="quick-1"),
    pytest.param((2, True), id="quick-2"),
    pytest.param((1, False), id="all-1", marks=pytest.mark.slow),
    pytest.param((2, False), id="all-2", marks=pytest.mark.slow),
)
"""Workers, and whether it is the quick set alone."""


@pytest.fixture(scope="module")
def runs() -> dict[tuple[int, bool], Tortured]:
    """Hold the runs that were done: each serves all tests."""
    return {}


@pytest.fixture
def torture(
    request: pytest.FixtureRequest,
    runs: dict[tuple[int, bool], Tortured],
    tmp_path_factory: pytest.TempPathFactory,
    honest_run: tuple[Workshop, Run],
) -> Tortured:
    jobs, quick = request.param
    if (jobs, quick) not in runs:
        folder = tmp_path_factory.mktemp("torture")
        runs[jobs, quick] = tortured(folder, honest_run, jobs=jobs, quick=quick)
    return runs[jobs, quick]


in_each_run = pytest.mark.parametrize("torture", RUNS, indirect=True)


def named(acts: Sequence[Act]) -> pytest.MarkDecorator:
    """Run a test for each board, act and run in which the act is done."""
    cases = [
        pytest.param(*run.values, board, act, id=f"{run.id}-{board}-{act.name}", marks=run.marks)
        for run in RUNS
        for board, act in pairs(acts, quick=run.values[0][1])
    ]
    return pytest.mark.parametrize(("torture", "board", "act"), cases, indirect=["torture"])


@named(FAILING)
def test_a_failure_is_one_row_that_says_what_happened(
    torture: Tortured, board: str, act: Act
) -> None:
    entry = torture.spec(board, act)
    results = torture.run.results
    reasons = torture.run.reasons(entry)
    assert len(reasons) == 2
    for reason in reasons:
        assert reason is not None
        assert reason.startswith(entry)
        assert act.says in reason.removeprefix(entry).lower()
        assert len(reason) <= MOST_MESSAGE
        assert reason.isprintable()
    standings = [s for s in results.standings if (s.board, s.entry) == (board, entry)]
    assert [(s.rank, s.reason) for s in standings] == [(None, reasons[0])]
    row = results.row(board, entry, "failed_episodes")
    assert row is not None
    assert row.value == 2
    assert entry in results.failed_entries


@named(HARMLESS)
def test_what_must_not_help_changes_nothing(torture: Tortured, board: str, act: Act) -> None:
    honest = torture.spec(board, HARMLESS[0])
    values = torture.run.values(hostile=True)
    for place, scores in values.items():
        if place.startswith(f"{board} {torture.spec(board, act)} "):
            assert scores["reason"] is None
            assert scores == values[place.replace(torture.spec(board, act), honest)]


@named(TOLERATED)
def test_odd_answers_are_scored(torture: Tortured, board: str, act: Act) -> None:
    assert torture.run.reasons(torture.spec(board, act)) == [None, None]


@in_each_run
def test_all_others_are_equal_to_the_bit(
    torture: Tortured, honest_run: tuple[Workshop, Run]
) -> None:
    assert torture.run.values() == honest_run[1].values()
    assert len(torture.run.values()) >= 16


@in_each_run
def test_no_process_is_left(torture: Tortured) -> None:
    assert torture.left == []
    assert left_running(torture.place.plugins) == []


@in_each_run
def test_the_time_is_bounded(torture: Tortured) -> None:
    assert torture.took_s < MOST_S[torture.quick]


@in_each_run
def test_nothing_is_warned_of(torture: Tortured) -> None:
    assert torture.run.warned == []
