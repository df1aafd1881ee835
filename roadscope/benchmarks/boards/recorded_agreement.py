"""Whether who is good on simulated traffic is good on recorded data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from roadscope.benchmarks.boards.rank_agreement import BoardAgreement, agreement
from roadscope.benchmarks.boards.results import Results, gather
from roadscope.benchmarks.boards.rows import FIRST_METRIC
from roadscope.benchmarks.jobs.job import Job
from roadscope.benchmarks.jobs.plan import tracking_jobs
from roadscope.benchmarks.jobs.store import Outcome
from roadscope.benchmarks.suite import SUITES, Suite, load_suite

Outcomes = Callable[[Iterable[str]], Mapping[str, Outcome]]
"""Looks up by key what earlier runs found."""


def agreements(
    results: Results, jobs: Sequence[Job], outcomes: Outcomes
) -> tuple[BoardAgreement, ...]:
    """Compare the boards of recorded data with each suite that was run on the same trackers.

    jobs: those behind the results. Only what earlier runs have finished is compared, under the
    code as it is now; nothing is run for it.
    """
    trackers = list(dict.fromkeys(job.tracker for job in jobs if job.tracker is not None))
    found = []
    for name in SUITES:
        suite = load_suite(name)
        simulated = simulated_figures(suite, trackers, outcomes) if suite.public_detectors else {}
        for board in results.boards():
            recorded = figures(results, board, trackers)
            if match := agreement(simulated, recorded):
                found.append(BoardAgreement(board, suite.title, match.rho, match.entries))
    return tuple(found)


def simulated_figures(
    suite: Suite, trackers: Sequence[str], outcomes: Outcomes
) -> dict[str, float]:
    """Return what trackers are ranked by on a suite, of those that came through all of it."""
    every = [job for job in tracking_jobs(suite, trackers) if job.entry == job.tracker]
    known = outcomes([job.key for job in every])
    missing = {
        job.entry for job in every if job.key not in known or known[job.key].reason is not None
    }
    done = [job for job in every if job.entry not in missing]
    return figures(gather(done, known, {}), "tracking", trackers)


def figures(results: Results, board: str, entries: Sequence[str]) -> dict[str, float]:
    """Return what the entries of a board are ranked by, where they have it."""
    rows = {entry: results.row(board, entry, FIRST_METRIC[board]) for entry in entries}
    return {
        entry: row.value for entry, row in rows.items() if row is not None and row.value is not None
    }
