"""From a suite and the user's entries to the jobs of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from roadscope.benchmarks.ego import TRUE_POSES, odometry_told, told_each
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.camera_job import CameraJob
from roadscope.benchmarks.jobs.entries import (
    ALL_BOARDS,
    BOARD_OF,
    BOARDS,
    ODOMETRY,
    check_entry,
    check_suite,
    check_tracker,
    kind_of,
    of_suite,
    refuse_unused,
)
from roadscope.benchmarks.jobs.fusion_job import AnyJob, FusionJob
from roadscope.benchmarks.jobs.job import Job
from roadscope.benchmarks.jobs.odometry_job import OdometryJob, odometry_jobs
from roadscope.benchmarks.jobs.sensor_plan import camera_jobs, fusion_jobs
from roadscope.benchmarks.oracle import (
    MARK_SPECS,
    ORACLE,
)
from roadscope.benchmarks.oracle_odometry import GIVEN_TRUTH, odometry_mark
from roadscope.benchmarks.recorded.suite import RecordedSuite
from roadscope.benchmarks.suite import Suite, check_names
from roadscope.core import SpecError
from roadscope.core.names import unknown


@dataclass(frozen=True, slots=True)
class Plan:
    """The jobs of each board, and the jobs whose detections several of them share."""

    detection: tuple[Job, ...] = ()
    tracking: tuple[Job, ...] = ()
    public: tuple[Job, ...] = ()
    camera: tuple[CameraJob, ...] = ()
    fusion: tuple[FusionJob, ...] = ()
    odometry: tuple[OdometryJob, ...] = ()

    @property
    def jobs(self) -> tuple[AnyJob, ...]:
        """All that has a place on a board."""
        return (*self.detection, *self.tracking, *self.camera, *self.fusion, *self.odometry)


def boards_of(suite: Suite) -> tuple[str, ...]:
    """Return the boards that a suite has entries for."""
    if isinstance(suite, RecordedSuite):
        return BOARDS
    there = BOARDS if suite.detectors or suite.trackers else ()
    camera = ("camera",) if suite.camera_detectors else ()
    fusion = ("fusion",) if suite.fusions else ()
    return (*there, *camera, *fusion, *((ODOMETRY,) if suite.odometries else ())) or BOARDS


def plan(
    suite: Suite,
    entries: Sequence[str],
    boards: Sequence[str],
    *,
    only: bool = False,
    calibration: str = "",
) -> Plan:
    """Return all jobs; unknown names and wrong arguments raise before anything runs.

    Beside trackers, marks stand on no board alone.

    entries: specs of whatever the boards rank, beside (`only`: instead of) those of the suite.
    calibration: file that fusions are given in place of what the rig is believed to be.
    """
    if only and not entries:
        raise SpecError("--only needs at least one --entry")
    for board in boards:
        if board not in ALL_BOARDS:
            raise SpecError(unknown("board", board, ALL_BOARDS))
    if isinstance(suite, RecordedSuite):
        return _recorded_plan(suite, entries, boards, only=only)
    of_suite(suite, None, check_names, suite)
    kinds = [kind_of(spec, boards) for spec in entries]
    refuse_unused(entries, kinds, boards)
    given = {
        kind: [s for s, its in zip(entries, kinds, strict=True) if its == kind] for kind in BOARD_OF
    }
    for kind, specs in given.items():
        for spec in specs:
            check_entry(kind, spec)
    check_suite(suite)
    made = _lidar_plan(suite, given, boards, only=only)
    made = replace(made, **_sensor_jobs(suite, given, boards, only=only, calibration=calibration))
    if ODOMETRY in boards:
        made = replace(made, odometry=_odometry_jobs(suite, given["odometry"], only=only))
    if not made.jobs:
        raise SpecError(f"suite {suite.title} has nothing to run on: {', '.join(boards)}")
    return made


def _lidar_plan(
    suite: Suite, given: Mapping[str, Sequence[str]], boards: Sequence[str], *, only: bool
) -> Plan:
    """Return the jobs of the boards of what LiDAR sees."""
    marks = {} if only else MARK_SPECS
    detectors = [*([] if only else suite.detectors), *given["detector"]]
    trackers = [*([] if only else suite.trackers), *given["tracker"]]
    asked = bool(given["tracker"]) or (only and not (given["camera detector"] or given["fusion"]))
    if "tracking" in boards and not suite.public_detectors and asked:
        raise SpecError(f"suite {suite.title} names no tracking.detectors that trackers could get")
    tracking = tracking_jobs(suite, trackers) if "tracking" in boards else []
    detects = "detection" in boards and (detectors or not tracking)
    detection = _detection_jobs(suite, marks, detectors) if detects else []
    public = _jobs(suite, "detection", [(d, d, None) for d in suite.public_detectors])
    return Plan(tuple(detection), tuple(tracking), tuple(public if tracking else ()))


def _sensor_jobs(
    suite: Suite,
    given: Mapping[str, Sequence[str]],
    boards: Sequence[str],
    *,
    only: bool,
    calibration: str,
) -> dict[str, Any]:
    """Return the jobs of the boards that need a camera."""
    found: dict[str, Any] = {}
    if "camera" in boards:
        detectors = [*([] if only else suite.camera_detectors), *given["camera detector"]]
        found["camera"] = tuple(camera_jobs(suite, detectors, episodes(suite), marks=not only))
    if "fusion" in boards:
        fusions = [*([] if only else suite.fusions), *given["fusion"]]
        jobs = fusion_jobs(suite, fusions, episodes(suite), calibration, marks=not only)
        found["fusion"] = tuple(jobs)
    return found


def _odometry_jobs(suite: Suite, given: Sequence[str], *, only: bool) -> tuple[OdometryJob, ...]:
    """Return the jobs of odometries, and with the suite's own each once more with an oracle."""
    specs = [*([] if only else suite.odometries), *given]
    ranked = [spec for spec in specs if odometry_mark(spec) is None]
    oracles = [] if only else [GIVEN_TRUTH + spec for spec in ranked]
    return tuple(odometry_jobs(suite, [*specs, *oracles], episodes(suite)))


def _recorded_plan(
    suite: RecordedSuite, entries: Sequence[str], boards: Sequence[str], *, only: bool
) -> Plan:
    """Return the jobs on recorded detections, which leave nothing to detectors."""
    if "tracking" not in boards:
        raise SpecError(f"suite {suite.title} has recorded detections: it is for trackers only")
    refuse_unused(entries, [kind_of(spec) for spec in entries], ("tracking",))
    for spec in entries:
        check_tracker(spec)
        if odometry_told(spec) is not None:
            raise SpecError(f"'{spec}': recorded detections come without scans for an odometry")
    trackers = [*([] if only else suite.trackers), *entries]
    return Plan((), tuple(recorded_jobs(suite, trackers)), ())


def _detection_jobs(suite: Suite, marks: Mapping[str, str], detectors: Sequence[str]) -> list[Job]:
    specs = {**marks, **{detector: detector for detector in detectors}}
    return _jobs(suite, "detection", [(entry, spec, None) for entry, spec in specs.items()])


def tracking_jobs(suite: Suite, trackers: Sequence[str]) -> list[Job]:
    """Every tracker on every public detector, all of them one entry; on the oracle, one apart.

    Those that are told other poses of the ego are entries of their own.
    """
    alone = suite.public_detectors == (ORACLE,)
    rows = [
        (tracker if detector != ORACLE or alone else f"{tracker} on {detector}", detector, tracker)
        for detector in suite.public_detectors
        for tracker in told_each(trackers, suite.egos)
    ]
    return _jobs(suite, "tracking", rows)


def recorded_jobs(suite: RecordedSuite, trackers: Sequence[str]) -> list[Job]:
    """Every tracker on every recording; the first detector goes without saying."""
    first = suite.public_detectors[0]
    return [
        Job(
            recording.board,
            tracker if recording.detector == first else f"{tracker} on {recording.detector}",
            recording.detector, tracker, recording, suite.eligibility,
        )
        for recording in suite.recordings
        for tracker in told_each(trackers, (TRUE_POSES,))
    ]  # fmt: skip


def _jobs(suite: Suite, board: str, rows: Sequence[tuple[str, str, str | None]]) -> list[Job]:
    return [
        Job(board, entry, detector, tracker, episode, suite.eligibility)
        for episode in episodes(suite)
        for entry, detector, tracker in rows
    ]


def episodes(suite: Suite) -> list[Episode]:
    """Return every scenario with every seed in every weather, light and set of faults.

    These are not crossed: further lights and faults come with the first of the others.
    """
    (weather, *weathers), (light, *lights) = suite.weathers, suite.lights
    first, *faults = suite.faults
    seen = [(weather, light, first), *((other, light, first) for other in weathers)]
    seen += [(weather, other, first) for other in lights]
    seen += [(weather, light, other) for other in faults]
    return [
        Episode(scenario, seed, suite.rig, suite.duration_s, *conditions)
        for seed in suite.seeds
        for scenario in suite.scenarios
        for conditions in seen
    ]
