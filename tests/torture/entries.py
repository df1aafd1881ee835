"""Tests of one run with many hostile entries, to be derived from."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.torture.acts import ACTS, FAILING, HANGS, HARMLESS, TOLERATED, Act, pairs
from tests.torture.boards import (
    HANG_LIMITS,
    MOST_MESSAGE,
    ONE_EPISODE,
    TortureRun,
    Workshop,
    left_running,
    shown,
    workshop,
)

MOST_S = 900.0
"""What a run may take on a loaded machine."""
OWN_ENTRIES = 11
"""Entries and marks of the suite's own, over all boards."""


@dataclass(frozen=True)
class Tortured:
    """A run with many hostile entries at once, and one with those that hang."""

    place: Workshop
    runs: tuple[TortureRun, TortureRun]
    took_s: float

    def spec(self, board: str, act: Act) -> str:
        return self.place.spec(board, act.name)

    def run_of(self, act: Act) -> TortureRun:
        return self.runs[act in HANGS]


def tortured(folder: Path, timelines: Path, *, jobs: int) -> Tortured:
    """Run the suite with all hostile entries: those that hang with short deadlines.

    Boards are written with one worker only: that is done after all workers have ended.
    """
    place = workshop(folder, timelines, ONE_EPISODE)
    start, out = time.monotonic(), place.out if jobs == 1 else None
    others = [act for act in ACTS if act not in HANGS]
    entries = [place.spec(board, act.name) for board, act in pairs(others, jobs)]
    hanging = [place.spec(board, act.name) for board, act in pairs(HANGS, jobs)]
    runs = (
        place.run(entries, jobs=jobs, out_dir=out),
        place.run(hanging, jobs=jobs, limits=HANG_LIMITS, fresh=True),
    )
    return Tortured(place, runs, time.monotonic() - start)


def done_by(acts: Sequence[Act]) -> Callable[[Any], Any]:
    """Run a test for each of the acts on each of its boards."""

    def decorate(test: Any) -> Any:
        test.acts = acts
        return test

    return decorate


class EntryTests:
    """What hostile entries do costs them their own row.

    jobs: workers.
    """

    jobs = 1

    @done_by(FAILING)
    def test_a_failure_is_one_row_that_says_what_happened(
        self, torture: Tortured, board: str, act: Act
    ) -> None:
        entry, run = torture.spec(board, act), torture.run_of(act)
        reasons = run.reasons(entry)
        assert len(reasons) == 1
        for reason in reasons:
            assert reason is not None
            assert reason.startswith(entry)
            assert act.says in reason.removeprefix(entry).lower()
            assert len(reason) <= MOST_MESSAGE
            assert reason.isprintable()
        name = shown(board, entry)
        standings = [s for s in run.results.standings if (s.board, s.entry) == (board, name)]
        assert [(s.rank, s.reason) for s in standings] == [(None, reasons[0])]
        row = run.results.row(board, name, "failed_episodes")
        assert row is not None
        assert row.value == 1
        assert name in run.results.failed_entries

    @done_by(HARMLESS)
    def test_what_must_not_help_changes_nothing(
        self, torture: Tortured, board: str, act: Act
    ) -> None:
        honest = torture.spec(board, HARMLESS[0])
        entry, values = torture.spec(board, act), torture.runs[0].values(hostile=True, board=board)
        places = [place for place in values if place.startswith(f"{board} {entry} ")]
        assert places
        for place in places:
            assert values[place]["reason"] is None
            assert values[place] == values[place.replace(entry, honest)]

    @done_by(TOLERATED)
    def test_odd_answers_are_scored(self, torture: Tortured, board: str, act: Act) -> None:
        reasons = torture.run_of(act).reasons(torture.spec(board, act))
        assert reasons == [None]

    @pytest.mark.parametrize("number", [0, 1])
    def test_all_others_are_equal_to_the_bit(
        self, torture: Tortured, honest_run: tuple[Workshop, TortureRun], number: int
    ) -> None:
        values, expected = torture.runs[number].values(), honest_run[1].values()
        assert values == {place: expected[place] for place in values}
        assert len(values) == OWN_ENTRIES

    def test_no_process_is_left(self, torture: Tortured) -> None:
        assert left_running(torture.place.folder) == []

    def test_the_time_is_bounded(self, torture: Tortured) -> None:
        assert torture.took_s < MOST_S

    def test_nothing_is_warned_of(self, torture: Tortured) -> None:
        assert [run.warned for run in torture.runs] == [[], []]
