"""Runs a suite: each job once, results kept as they come, jobs in parallel."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from roadscope.benchmarks.boards.export import save_all
from roadscope.benchmarks.boards.kept import check_targets, label_of
from roadscope.benchmarks.boards.recorded_agreement import agreements
from roadscope.benchmarks.boards.results import Results, gather
from roadscope.benchmarks.cache import cache_dir, usable_folder
from roadscope.benchmarks.episode import Episode, timeline_of, timeline_path
from roadscope.benchmarks.jobs.apart import DEADLINE_S, MEMORY_GB, ApartError, apart
from roadscope.benchmarks.jobs.camera_job import CameraJob, execute_camera, seen_of
from roadscope.benchmarks.jobs.fusion_job import AnyJob, FusionJob, execute_fusions
from roadscope.benchmarks.jobs.job import Job, detections_of, execute
from roadscope.benchmarks.jobs.manifest import manifest
from roadscope.benchmarks.jobs.odometry_job import OdometryJob, execute_odometries
from roadscope.benchmarks.jobs.plan import Plan, boards_of, plan
from roadscope.benchmarks.jobs.public import PublicDetections
from roadscope.benchmarks.jobs.stack import prints_aside
from roadscope.benchmarks.jobs.store import Outcome, Store, StoredJob
from roadscope.benchmarks.jobs.workers import WorkerError, in_parallel
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.recorded.mot import mot_suite
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
    boards: Sequence[str] | None = None,
    only: bool = False,
    jobs: int = 1,
    out_dir: Path | str | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
    kitti: Path | str | None = None,
    mot: Path | str | None = None,
    calibration: Path | str | None = None,
    deadline_s: float = DEADLINE_S,
) -> Results:
    """Run a suite's entries and yours, and return the leaderboard.

    suite: a suite, its name or a path to its TOML file.
    entries: specs of detectors, trackers, camera detectors, fusions and odometries to compare
        with the suite's own; with `only`, they alone.
    boards: some of `detection`, `tracking`, `camera`, `fusion`, `odometry`; None: all that the
        suite has entries for.
    jobs: worker processes.
    out_dir: where results are kept (`results.sqlite`) and `leaderboard.json`, `.csv`, `.md`
        and `.tex` are written; None keeps results in the cache folder and writes no board. Boards
        of other suites that are there are kept (`leaderboard-SUITE-BOARD[-CALIBRATION].json`).
    fresh: do again what an earlier run has done.
    kitti: a folder of KITTI tracking data, whose sequences take the place of the suite's traffic
        (`kitti_suite`); a malformed file in it raises `FormatError` before anything is run.
    mot: likewise a folder of MOTChallenge's image sequences (`mot_suite`).
    calibration: a file of `roadscope calibrate`, which the fusion board believes.
    deadline_s: for a camera detector, fusion or odometry that is not ours on one episode, in a
        process of its own.
    """
    if kitti is not None:
        suite = kitti_suite(kitti)
    if mot is not None:
        suite = mot_suite(mot)
    suite = load_suite(suite) if isinstance(suite, str) else suite
    with prints_aside():
        given = "" if calibration is None else str(calibration)
        asked = boards_of(suite) if boards is None else boards
        plans = plan(suite, entries, asked, only=only, calibration=given)
    if jobs < 1:
        raise RunError(f"jobs: expected 1 or more worker processes, got {jobs}")
    folder = usable_folder(out_dir) if out_dir is not None else cache_dir()
    conditions = manifest(suite, jobs, asked, given)
    if out_dir is not None:
        check_targets(folder, label_of(conditions))
    with Store(folder / DATABASE) as store:
        way = _Way(jobs, fresh, deadline_s)
        results = _worked_out(store, (suite, conditions), plans, way, progress or silent)
    if out_dir is not None:
        save_all(results, folder)
    return results


def _worked_out(
    store: Store, given: tuple[Suite, Mapping[str, Any]], plans: Plan, way: _Way, tell: Progress
) -> Results:
    """Do what a store does not know yet, and gather the results; given: suite and manifest."""
    suite, conditions = given
    number = store.begin(conditions)
    wanted: Sequence[AnyJob] = plans.jobs
    known = {} if way.fresh else _finished(store, wanted)
    recorder = _Recorder(store, number, known)
    _work(plans, recorder, way.jobs, way.fresh, tell)
    _work_on_images(plans, recorder, way, tell)
    _work_on_rides(plans, recorder, way, tell)
    results = gather(wanted, known, conditions)
    if isinstance(suite, RecordedSuite):
        return replace(results, agreements=agreements(results, plans.tracking, store.outcomes))
    return results


class _Recorder:
    """Writes outcomes down as they come."""

    def __init__(self, store: Store, number: int, known: dict[str, Outcome]) -> None:
        self.known = known
        self._store = store
        self._number = number

    def take(self, job: AnyJob, outcome: Outcome) -> None:
        episode = job.episode
        row = StoredJob(job.key, job.board, job.entry, episode.scenario, episode.seed, job.spec)
        self._store.put(row, outcome, self._number)
        self.known[job.key] = outcome


@dataclass(frozen=True, slots=True)
class _Way:
    """How jobs are done."""

    jobs: int
    fresh: bool
    deadline_s: float


def _finished(store: Store, jobs: Sequence[AnyJob]) -> dict[str, Outcome]:
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
    _drive([e for e in simulated if isinstance(e, Episode)], jobs, progress)
    seeing = [(job, fresh, job.key in {d.key for d in detection}) for job in [*detection, *public]]
    for (job, _, _), outcome in _each(_see, seeing, jobs, "detection", progress):
        if outcome is not None:
            recorder.take(job, outcome)
    for job, outcome in _each(execute, tracking, jobs, "tracking", progress):
        recorder.take(job, outcome)


def _drive(episodes: Sequence[Episode], jobs: int, progress: Progress) -> None:
    """Record the traffic that is not kept; episodes that differ in weather share theirs."""
    recorded = {timeline_path(episode): episode for episode in dict.fromkeys(episodes)}
    traffic = [episode for path, episode in recorded.items() if not path.exists()]
    for _ in _each(_record, traffic, jobs, "traffic", progress):
        pass


def _work_on_images(plans: Plan, recorder: _Recorder, way: _Way, progress: Progress) -> None:
    """Do what is missing of the boards with a camera: images, shared detections, fusions."""
    camera = [job for job in plans.camera if job.key not in recorder.known]
    fusion = [job for job in plans.fusion if job.key not in recorder.known]
    _drive([*(j.episode for j in camera), *(j.episode for j in fusion)], way.jobs, progress)
    looking = [(job, way) for job in camera]
    for (looked, _), outcome in _each(execute_seen, looking, way.jobs, "images", progress):
        recorder.take(looked, outcome)
    for _ in _each(_share, _shared(fusion, way.fresh), way.jobs, "sensors", progress):
        pass
    fusing = [(group, way) for group in _together(fusion)]
    for (group, _), outcomes in _each(execute_fused, fusing, way.jobs, "fusion", progress):
        for fused, outcome in zip(group, outcomes, strict=True):
            recorder.take(fused, outcome)


def _work_on_rides(plans: Plan, recorder: _Recorder, way: _Way, progress: Progress) -> None:
    """Do what is missing of the odometry board."""
    missing = [job for job in plans.odometry if job.key not in recorder.known]
    _drive([job.episode for job in missing], way.jobs, progress)
    riding = [(group, way) for group in _together(missing)]
    for (group, _), outcomes in _each(execute_ridden, riding, way.jobs, "odometry", progress):
        for job, outcome in zip(group, outcomes, strict=True):
            recorder.take(job, outcome)


SomeJob = TypeVar("SomeJob", FusionJob, OdometryJob)


def _together(jobs: Sequence[SomeJob]) -> list[tuple[SomeJob, ...]]:
    """Put jobs of one company on one episode together: a process takes seconds to begin."""
    groups: dict[object, list[SomeJob]] = {}
    for number, job in enumerate(jobs):
        groups.setdefault(number if job.ours else (job.company, job.episode), []).append(job)
    return [tuple(group) for group in groups.values()]


def execute_seen(task: tuple[CameraJob, _Way]) -> Outcome:
    """Look at images; a stranger's detector does so in a process of its own."""
    job, way = task
    if job.ours:
        return execute_camera(job, way.fresh)
    try:
        return apart(execute_camera, job, way.fresh, deadline_s=way.deadline_s)
    except ApartError as error:
        return Outcome({}, f"{job.entry}: {error}")


def execute_fused(task: tuple[tuple[FusionJob, ...], _Way]) -> list[Outcome]:
    """Fuse; a stranger's fusion does so in a process of its own."""
    jobs, way = task
    if all(job.ours for job in jobs):
        return execute_fusions(jobs)
    try:
        return apart(execute_fusions, jobs, deadline_s=way.deadline_s)
    except ApartError as error:
        return [Outcome({}, f"{job.entry}: {error}") for job in jobs]


def execute_ridden(task: tuple[tuple[OdometryJob, ...], _Way]) -> list[Outcome]:
    """Run odometries of one company; those that are not all ours have a process and limits.

    Who ends it is then looked for one by one.
    """
    jobs, way = task
    if all(job.ours for job in jobs):
        return execute_odometries(jobs)
    limits: dict[str, float] = {"deadline_s": len(jobs) * way.deadline_s, "memory_gb": MEMORY_GB}
    try:
        return apart(execute_odometries, jobs, **limits)
    except ApartError as error:
        if len(jobs) > 1:
            return [execute_ridden(((job,), way))[0] for job in jobs]
        return [Outcome({}, f"{jobs[0].plugin}: {error}")]


def _shared(
    jobs: Sequence[FusionJob], fresh: bool
) -> list[tuple[PublicDetections | CameraJob, bool]]:
    """Return whose detections fusions share, as far as they are not there yet."""
    found: dict[Path, tuple[PublicDetections | CameraJob, bool]] = {}
    for job in jobs:
        for one in job.given.sources(job.episode, job.eligibility, job.every_s):
            if fresh or not one.detections_path.exists():
                found[one.detections_path] = one, fresh
    return list(found.values())


def _share(task: tuple[PublicDetections | CameraJob, bool]) -> None:
    """Make detections; what goes wrong is told by the fusions that need them."""
    source, fresh = task
    try:
        if isinstance(source, CameraJob):
            seen_of(source, fresh)
        else:
            source.read(fresh)
    except Exception:
        return


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
