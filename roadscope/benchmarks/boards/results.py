"""Rows of a leaderboard, from the scores of its jobs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from roadscope.benchmarks.boards.rank_agreement import BoardAgreement
from roadscope.benchmarks.boards.rows import (
    CONDITIONS,
    DETECTOR,
    GIVEN,
    INPUTS,
    RECORDED_CONDITIONS,
    Record,
    Row,
    part_rows,
    whole_rows,
)
from roadscope.benchmarks.boards.standing import Standing, standings
from roadscope.benchmarks.jobs.entries import SENSOR_BOARDS
from roadscope.benchmarks.jobs.fusion_job import ALONE, AnyJob
from roadscope.benchmarks.jobs.odometry_job import OdometryJob
from roadscope.benchmarks.jobs.store import Outcome
from roadscope.benchmarks.metrics.breakdown import BANDS
from roadscope.benchmarks.metrics.odometry.by_distance import DISTANCE
from roadscope.benchmarks.metrics.tracking.alphas import BY_ALPHA
from roadscope.benchmarks.noisy_camera import CAMERA_NOISES
from roadscope.benchmarks.oracle import mark_of
from roadscope.benchmarks.oracle_odometry import IMITATION, odometry_mark
from roadscope.benchmarks.recorded.recording import RECORDED_BOARDS
from roadscope.core.names import unknown
from roadscope.core.registry import split_spec

BREAKDOWNS: Mapping[str, tuple[str, ...]] = {
    "detection": (*BANDS, *CONDITIONS),
    "tracking": (*CONDITIONS, DETECTOR, BY_ALPHA),
    "camera": ("family", "size", "range", "occlusion", "category", "score", *CONDITIONS),
    "fusion": ("family", "range", "crowd", "score", *CONDITIONS, INPUTS),
    "odometry": (DISTANCE, *CONDITIONS),
    **dict.fromkeys(RECORDED_BOARDS, (BY_ALPHA, *RECORDED_CONDITIONS)),
}
"""By what the figures of each board are broken down."""


ONE_SENSOR = "alone"
"""The mark of what one sensor finds without the other."""
NOT_INSTALLED = " is not installed: "
"""In the reason of an entry that needs another package; see `Requirement.missing`."""


class BreakdownError(ValueError):
    """Results are not broken down by that."""


@dataclass(frozen=True, slots=True)
class Failure:
    """An entry that did not come through an episode, and why.

    condition: weather, light and faults in words.
    """

    board: str
    entry: str
    scenario: str
    seed: int
    condition: str
    reason: str


@dataclass(frozen=True, slots=True)
class Results:
    """What a run found.

    manifest: the conditions.
    rows: figures over all episodes, entries in rank order, marks last.
    parts: the same broken down.
    standings: the order of the entries, and how sure it is.
    agreements: on recorded data, how its ranks agree with those on simulated traffic.
    """

    manifest: Mapping[str, Any]
    rows: tuple[Row, ...]
    failures: tuple[Failure, ...]
    parts: tuple[Row, ...] = ()
    standings: tuple[Standing, ...] = ()
    agreements: tuple[BoardAgreement, ...] = ()

    def boards(self) -> list[str]:
        """Return the boards that have rows."""
        return list(dict.fromkeys(row.board for row in self.rows))

    def entries(self, board: str) -> list[str]:
        """Return the entries of a board, best first, then its marks."""
        return list(dict.fromkeys(row.entry for row in self.rows if row.board == board))

    def row(self, board: str, entry: str, metric: str) -> Row | None:
        """Return one figure, or None where it was not measured."""
        for row in self.rows:
            if (row.board, row.entry, row.metric) == (board, entry, metric):
                return row
        return None

    def breakdown(self, by: str, board: str = "detection") -> list[Row]:
        """Return the rows of a board by range, category, occlusion, points, score or condition.

        `BREAKDOWNS` says what there is; anything else raises `BreakdownError`.
        """
        check_breakdown(by, (board,))
        return [row for row in self.parts if (row.board, row.by) == (board, by)]

    def standing(self, board: str, entry: str) -> Standing:
        """Return the place of an entry; one that nothing is known of has none."""
        for standing in self.standings:
            if (standing.board, standing.entry) == (board, entry):
                return standing
        return Standing(board, entry, None)

    def board_of(self, entry: str) -> str:
        """Return the board that an entry is on."""
        return next(row.board for row in self.rows if row.entry == entry)

    def nothing_eligible(self, board: str) -> bool:
        """Say whether a board lacks every value of what is a share of the objects to be found."""
        share = "detection_rate" if board in ("detection", *SENSOR_BOARDS) else "mota"
        values = [row.value for row in self.rows if (row.board, row.metric) == (board, share)]
        return bool(values) and all(value is None for value in values)

    def reasons(self) -> list[tuple[str, int, str]]:
        """Return entry, number of episodes and reason of all failures, each reason once."""
        counts: dict[tuple[str, str], int] = {}
        for failure in self.failures:
            key = failure.entry, failure.reason
            counts[key] = counts.get(key, 0) + 1
        return [(entry, count, reason) for (entry, reason), count in counts.items()]

    def not_installed(self, entry: str) -> bool:
        """Say whether an entry failed for want of what is not installed."""
        return any(f.entry == entry and NOT_INSTALLED in f.reason for f in self.failures)

    def barren(self) -> bool:
        """Say whether no entry came through a single episode."""
        return all(row.metric == "failed_episodes" for row in self.rows)

    def to_json(self) -> str:
        """Return everything as JSON text."""
        content = {
            "manifest": dict(self.manifest),
            "standings": [asdict(standing) for standing in self.standings],
            "rows": [asdict(row) for row in self.rows],
            "parts": [asdict(row) for row in self.parts],
            "failures": [asdict(failure) for failure in self.failures],
            "agreements": [asdict(agreement) for agreement in self.agreements],
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"


def reason_alone(entry: str, reason: str) -> str:
    """Leave the entry's own name out at the beginning of a reason."""
    spec, _, rest = reason.partition(": ")
    return rest if entry == spec or entry.startswith(f"{spec} on ") else reason


def check_breakdown(by: str, boards: Sequence[str]) -> None:
    """Refuse what none of the boards is broken down by."""
    known = list(dict.fromkeys(name for board in boards for name in BREAKDOWNS.get(board, ())))
    if by not in known:
        board = f"{boards[0]} " if len(boards) == 1 else ""
        raise BreakdownError(unknown(f"{board}breakdown", by, known))


def gather(
    jobs: Sequence[AnyJob], outcomes: Mapping[str, Outcome], manifest: Mapping[str, Any]
) -> Results:
    """Join the outcomes of jobs into rows, ranked."""
    grouped: dict[str, dict[str, list[AnyJob]]] = {}
    for job in jobs:
        grouped.setdefault(job.board, {}).setdefault(job.entry, []).append(job)
    order: list[Standing] = []
    records: list[Record] = []
    for board in sorted(grouped):
        named = {entry: _record(group, outcomes) for entry, group in grouped[board].items()}
        places = standings(list(named.values()))
        order += places
        records += [named[place.entry] for place in places]
    failures = [
        _failure(job, reason) for job in jobs if (reason := outcomes[job.key].reason) is not None
    ]
    return Results(
        manifest,
        rows=tuple(row for record in records for row in whole_rows(record)),
        failures=tuple(failures),
        parts=tuple(row for record in records for row in part_rows(record)),
        standings=tuple(order),
    )


def _failure(job: AnyJob, reason: str) -> Failure:
    episode = job.episode
    condition = CONDITIONS["condition"](episode)
    return Failure(job.board, job.entry, episode.scenario, episode.seed, condition, reason)


def _mark(job: AnyJob) -> str | None:
    if isinstance(job, OdometryJob):
        return odometry_mark(job.odometry)
    if job.board == "fusion":
        return ONE_SENSOR if job.entry in ALONE else None
    if split_spec(job.entry)[0] in CAMERA_NOISES:
        return IMITATION
    return mark_of(job.entry, job.tracker)


def _record(jobs: Sequence[AnyJob], outcomes: Mapping[str, Outcome]) -> Record:
    first = jobs[0]
    sound = [job for job in jobs if outcomes[job.key].reason is None]
    public = first.board in GIVEN
    reasons = [reason for job in jobs if (reason := outcomes[job.key].reason) is not None]
    return Record(
        first.board,
        first.entry,
        _mark(first),
        tuple((job.episode, outcomes[job.key].scores) for job in sound),
        len(jobs),
        tuple(job.detector for job in sound) if public else (),
        None if sound else reasons[0],
    )
