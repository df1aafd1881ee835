"""The following board: drivers that hold their distance to a car ahead.

This file is all of a board whose plug-ins act on the world: its kind of plug-in, its settings, its
node and its scores. `test_sixth_board.py` puts it into a copy of the package, beside the other
boards.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from roadscope.benchmarks import (
    BoardSettings,
    CallInput,
    CallTimes,
    Episode,
    EpisodeRecord,
    Job,
    Kind,
    Node,
    Positive,
    RunOptions,
    Suite,
    run_plugin,
)
from roadscope.benchmarks.boards import (
    CONDITIONS,
    Board,
    Breakdown,
    Column,
    JobOptions,
    Scores,
    call_cost,
    episodes,
    time_columns,
)
from roadscope.benchmarks.metrics import Score
from roadscope.core import AnswerError, Registry, Spec

MOST_M_S2 = 8.0
"""No car brakes harder on a dry road. Chosen by hand."""


class Coast:
    """Never accelerates and never brakes."""

    def reset(self) -> None:
        """Forget the last episode."""

    def drive(self, gap_m: float, speed_m_s: float) -> float:
        """Return an acceleration, m/s2."""
        return 0.0


DRIVER: Kind = Kind("follower", Registry[Any]("follower", {"coast": f"{__name__}:Coast"}), "drive")


@dataclass(frozen=True, slots=True, eq=False)
class FollowingRecord(EpisodeRecord):
    """A drive of T steps; gaps_m: (T,) distance to the car ahead."""

    gaps_m: np.ndarray
    times: CallTimes


@dataclass(frozen=True)
class FollowingNode(Node):
    """The drive of a driver: the world goes on with each of its answers."""

    driver: Spec
    episode: Episode
    step_s: float

    stage = "drives"
    record = FollowingRecord

    def compute(self, options: RunOptions) -> FollowingRecord:
        """Drive behind a car that brakes; how hard, the seed says."""
        rng = np.random.default_rng(self.episode.seed)
        ahead_m, ahead_m_s, braking_m_s2 = 20.0, 10.0, rng.uniform(1.0, 2.0)
        own_m, own_m_s = 0.0, 10.0
        gaps_m: list[float] = []

        def moments() -> Iterator[CallInput[None]]:
            nonlocal ahead_m, ahead_m_s, own_m
            for _ in range(round((self.episode.duration_s or 10.0) / self.step_s)):
                gaps_m.append(ahead_m - own_m)
                yield CallInput((gaps_m[-1], own_m_s), None)
                ahead_m_s = max(ahead_m_s - braking_m_s2 * self.step_s, 0.0)
                ahead_m += ahead_m_s * self.step_s
                own_m += own_m_s * self.step_s

        def accelerate(answer: Any, moment: CallInput[None]) -> float:
            nonlocal own_m_s
            if not isinstance(answer, float) or not abs(answer) <= MOST_M_S2:
                raise AnswerError(f"expected an acceleration up to 8 m/s2, got {answer!r}")
            own_m_s = max(own_m_s + answer * self.step_s, 0.0)
            return answer

        replies = run_plugin(self.driver, DRIVER, moments(), accelerate, options=options)
        return FollowingRecord(np.array(gaps_m), replies.times)


class FollowingSettings(BoardSettings, frozen=True, kw_only=True):
    """The table `[following]`; step_s: time from one call of a driver to the next."""

    step_s: Positive = 0.1


class FollowingBoard(Board):
    """Ranks drivers by their least distance to the car ahead."""

    name = "following"
    kind = DRIVER
    settings_type = FollowingSettings
    headline = "least_gap"
    columns = (
        Column("least_gap", "least gap m", 1, "least gap: to the car ahead, negative in a crash."),
        Column("mean_gap", "mean gap m", 1),
        *time_columns(2, "step"),
    )
    breakdowns = tuple(Breakdown(by) for by in CONDITIONS)
    by_condition = ("least_gap",)
    shown_parts = (Column("least_gap", "least gap m"),)
    unviewable = "a drive behind a car, which no view shows"

    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return every driver on all episodes."""
        step_s = suite.settings(self.name, FollowingSettings).step_s
        return [
            Job(self, str(driver), episode, FollowingNode(driver, episode, step_s))
            for episode in episodes(suite)
            for driver in entries
        ]

    def score(self, job: Job, answers: FollowingRecord, options: RunOptions) -> Scores:
        """Return the scores of a drive, and the cost of the driver's calls."""
        least, mean, steps = answers.gaps_m.min(), answers.gaps_m.mean(), len(answers.gaps_m)
        return {
            "least_gap": Score(float(least), "m", "higher", steps, least=-np.inf),
            "mean_gap": Score(float(mean), "m", "lower", steps, least=-np.inf),
            **call_cost(answers.times),
        }

    def explanation(self, suite: Suite) -> str:
        """Return what drivers do, for a reader."""
        return "Drivers follow a car that brakes."
