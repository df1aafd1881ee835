"""Runs a suite: each job once, results kept as they come, jobs in parallel."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from roadscope.benchmarks.boards.export import check_targets, save_all
from roadscope.benchmarks.boards.recorded_agreement import agreements
from roadscope.benchmarks.boards.results import Results, gather
from roadscope.benchmarks.cache import cache_dir, usable_folder
from roadscope.benchmarks.episode import Episode, timeline_of, timeline_path
from roadscope.benchmarks.jobs.job import Job, detections_of, execute
from roadscope.benchmarks.jobs.manifest import manifest
from roadscope.benchmarks.jobs.plan import BOARDS, Plan, plan
from roadscope.benchmarks.jobs.stack import prints_aside
from roadscope.benchmarks.jobs.store import Outcome, Store, StoredJob
from roadscope.benchmarks.jobs.workers import WorkerError, in_parallel
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.recorded.recording import Recording, check_recording
from roadscope.benchmarks.recorded.suite import RecordedSuite, kitti_suite
from roadscope.benchmarks.suite import Suite, load_suite

DATABASE = "results.sqlite"
T = TypeVar("T")
R = TypeVar("R")


class RunError(RuntimeError):
    """A run could not go on."""


def run(
    suite: Suite | str = "quick",
    entries: Sequence[str] = (),
    *,
    boards: Sequence[str] = BOARDS,
    only: bool = False,
    jobs: int = 1,
    out_dir: Path | str | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
    kitti: Path | str | None = None,
) -> Results:
    """Run a suite's entries and yours, and return the leaderboard.

    suite: a suite, its name or a path to its TOML file.
    entries: specs of detectors and trackers to compare with the suite's own; with `only`, they
        alone.
    jobs: worker processes.
    out_dir: where results are kept (`results.sqlite`) and `leaderboard.json`, `.csv` and `.md`
        are written; None keeps results in the cache folder and writes no board.
    fresh: do again what an earlier run has done.
    kitti: a folder of KITTI tracking data, whose sequences take the place of the suite's traffic
        (`kitti_suite`); a malformed file in it raises `FormatError` before anything is run.
    """
    if kitti is not None:
        suite = kitti_suite(kitti)
    suite = load_suite(suite) if isinstance(suite, str) else suite
    with prints_aside():
        plans = plan(suite, entries, boards, only=only)
    if jobs < 1:
        raise RunError(f"jobs: expected 1 or more worker processes, got {jobs}")
    folder = usable_folder(out_dir) if out_dir is not None else cache_dir()
    if out_dir is not None:
        check_targets(folder)
    conditions = manifest(suite, jobs)
    with Store(folder / DATABASE) as store:
        number = store.begin(conditions)
        wanted = [*plans.detection, *plans.tracking]
        known = {} if fresh else _finished(store, wanted)
        recorder = _Recorder(store, number, known)
        _work(plans, recorder, jobs, fresh, progress or silent)
        results = gather(wanted, known, conditions)
        if isinstance(suite, RecordedSuite):
            results = replace(results, agreements=agreements(results, wanted, store.outcomes))
    if out_dir is not None:
        save_all(results, folder)
    return results


class _Recorder:
    """Writes outcomes down as they come."""

    def __init__(self, store: Store, number: int, known: dict[str, Outcome]) -> None:
        self.known = known
        self._store = store
        self._number = number

    def take(self, job: Job, outcome: Outcome) -> None:
        episode = job.episode
        row = StoredJob(job.key, job.board, job.entry, episode.scenario, episode.seed, job.spec)
        self._store.put(row, outcome, self._number)
        self.known[job.key] = outcome


def _finished(store: Store, jobs: Sequence[Job]) -> dict[str, Outcome]:
    """Return what earlier runs found; failures are tried again."""
    found = store.outcomes(job.key for job in jobs)
    return {key: outcome for key, outcome in found.items() if outcome.reason is None}


def _work(plans: Plan, recorder: _Recorder, jobs: int, fresh: bool, progress: Progress) -> None:
    """Do what is missing: traffic first, then detections, then tracks."""
    detection = [job for job in plans.detection if job.key not in recorder.known]
    tracking = [job for job in plans.tracking if job.key not in recorder.known]
    readings = dict.fromkeys(j.episode for j in tracking if isinstance(j.episode, Recording))
    for _ in _each(check_recording, list(readings), jobs, "reading", progress):
        pass
    at_hand = {job.detections_path for job in detection}
    needed = {job.detections_path for job in tracking if isinstance(job.episode, Episode)}
    public = [
        job
        for job in plans.public
        if job.detections_path in needed - at_hand and not job.detections_path.exists()
    ]
    simulated = [job.episode for job in [*detection, *public]]
    asked = dict.fromkeys(e for e in simulated if isinstance(e, Episode))
    # Episodes that differ in weather share their traffic.
    recorded = {timeline_path(episode): episode for episode in asked}
    traffic = [episode for path, episode in recorded.items() if not path.exists()]
    for _ in _each(_record, traffic, jobs, "traffic", progress):
        pass
    seeing = [(job, fresh, job.key in {d.key for d in detection}) for job in [*detection, *public]]
    for (job, _, _), outcome in _each(_see, seeing, jobs, "detection", progress):
        if outcome is not None:
            recorder.take(job, outcome)
    for job, outcome in _each(execute, tracking, jobs, "tracking", progress):
        recorder.take(job, outcome)


def _record(episode: Episode) -> None:
    """Record traffic; what goes wrong is told by the jobs that need it."""
    try:
        timeline_of(episode)
    except Exception:
        return


def _see(task: tuple[Job, bool, bool]) -> Outcome | None:
    """Score a detector, or only make the detections that trackers share."""
    job, fresh, scored = task
    if scored:
        return execute(job, fresh)
    try:
        detections_of(job)
    except Exception:
        return None
    return None


def _each(
    function: Callable[[T], R], items: Sequence[T], jobs: int, stage: str, progress: Progress
) -> Iterator[tuple[T, R]]:
    """Apply a function to items in any order and tell the progress."""
    if items:
        progress(stage, 0, len(items))
    try:
        for done, (index, result) in enumerate(in_parallel(function, items, jobs), start=1):
            yield items[index], result
            progress(stage, done, len(items))
    except WorkerError as error:
        raise RunError(
            "a worker process died (out of memory, or a plug-in that ends its process); finished "
            "results are kept, run again to go on, with --jobs 1 to see which entry it is"
        ) from error
