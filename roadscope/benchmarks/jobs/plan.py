"""From a suite and the user's entries to the jobs of a run."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.camera_job import CameraJob
from roadscope.benchmarks.jobs.fused import FusedSpec
from roadscope.benchmarks.jobs.fusion_job import FusionJob
from roadscope.benchmarks.jobs.job import Job
from roadscope.benchmarks.jobs.look import drawn_from_truth
from roadscope.benchmarks.jobs.sensor_plan import camera_jobs, check_camera_of, fusion_jobs
from roadscope.benchmarks.noisy import NOISES
from roadscope.benchmarks.noisy_camera import CAMERA_NOISES
from roadscope.benchmarks.oracle import (
    FUSED,
    MARK_SPECS,
    ORACLE,
    SUITES_ONLY,
    full_name,
    is_fused,
    made_from_truth,
)
from roadscope.benchmarks.recorded.recording import board_of
from roadscope.benchmarks.recorded.suite import RecordedSuite
from roadscope.benchmarks.suite import Suite, SuiteError, check_names
from roadscope.core import Registry, SpecError
from roadscope.core.names import unknown
from roadscope.core.registry import Plugin, split_spec
from roadscope.detectors import DETECTORS
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.fusion import FUSIONS
from roadscope.fusion.calibration_file import read_calibration
from roadscope.trackers import TRACKERS

BOARDS = ("detection", "tracking")
"""Boards of what LiDAR sees, which every suite may have."""
SENSOR_BOARDS = ("camera", "fusion")
"""Boards that need a rig with a camera."""
ALL_BOARDS = (*BOARDS, *SENSOR_BOARDS)
BOARD_OF: Mapping[str, str] = {
    "detector": "detection",
    "tracker": "tracking",
    "camera detector": "camera",
    "fusion": "fusion",
}
"""By kind of entry."""
METHOD_OF: Mapping[str, str] = {
    "detector": "detect",
    "tracker": "update",
    "camera detector": "detect",
    "fusion": "fuse",
}
REGISTRIES: Mapping[str, Registry[Any]] = {
    "detector": DETECTORS,
    "tracker": TRACKERS,
    "camera detector": CAMERA_DETECTORS,
    "fusion": FUSIONS,
}


@dataclass(frozen=True, slots=True)
class Plan:
    """The jobs of each board, and the jobs whose detections several of them share."""

    detection: tuple[Job, ...] = ()
    tracking: tuple[Job, ...] = ()
    public: tuple[Job, ...] = ()
    camera: tuple[CameraJob, ...] = ()
    fusion: tuple[FusionJob, ...] = ()

    @property
    def jobs(self) -> tuple[Job | CameraJob | FusionJob, ...]:
        """All that has a place on a board."""
        return (*self.detection, *self.tracking, *self.camera, *self.fusion)


def boards_of(suite: Suite) -> tuple[str, ...]:
    """Return the boards that a suite has entries for."""
    if isinstance(suite, RecordedSuite):
        return BOARDS
    there = BOARDS if suite.detectors or suite.trackers else ()
    camera = ("camera",) if suite.camera_detectors else ()
    return (*there, *camera, *(("fusion",) if suite.fusions else ())) or BOARDS


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
    _of_suite(suite, None, check_names, suite)
    kinds = [kind_of(spec, boards) for spec in entries]
    _refuse_unused(entries, kinds, boards)
    given = {
        kind: [s for s, its in zip(entries, kinds, strict=True) if its == kind] for kind in BOARD_OF
    }
    for kind, specs in given.items():
        for spec in specs:
            check(REGISTRIES[kind], spec)
    _check_suite(suite)
    made = _lidar_plan(suite, given, boards, only=only)
    made = replace(made, **_sensor_jobs(suite, given, boards, only=only, calibration=calibration))
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


def _recorded_plan(
    suite: RecordedSuite, entries: Sequence[str], boards: Sequence[str], *, only: bool
) -> Plan:
    """Return the jobs on recorded detections, which leave nothing to detectors."""
    if "tracking" not in boards:
        raise SpecError(f"suite {suite.title} has recorded detections: it is for trackers only")
    _refuse_unused(entries, [kind_of(spec) for spec in entries], ("tracking",))
    for spec in entries:
        check(TRACKERS, spec)
    trackers = [*([] if only else suite.trackers), *entries]
    return Plan((), tuple(recorded_jobs(suite, trackers)), ())


def kind_of(spec: str, boards: Sequence[str] = BOARDS) -> str:
    """Say which kind of plug-in a spec names.

    boards: a class of one's own with detect() is of the camera where they have no detection board.
    """
    name, _ = split_spec(spec)
    if ":" not in name:
        for kind, registry in REGISTRIES.items():
            if name in registry:
                return kind
        if made_from_truth(spec) or name in (FUSED, *SUITES_ONLY, *CAMERA_NOISES):
            raise SpecError(
                f"'{spec}' is no entry; a suite gives it to trackers: tracking.detectors"
            )
        asked = [kind for kind, board in BOARD_OF.items() if board in boards]
        raise SpecError(
            unknown(" or ".join(asked), name, [n for kind in asked for n in REGISTRIES[kind]])
            + "; or name your own: package.module:Class, path/to/file.py:Class"
        )
    factory: Any = DETECTORS.resolve(spec).factory
    if hasattr(factory, "detect"):
        by_camera = "camera" in boards and "detection" not in boards
        return "camera detector" if by_camera else "detector"
    if hasattr(factory, "update"):
        return "tracker"
    if hasattr(factory, "fuse"):
        return "fusion"
    raise SpecError(
        f"'{spec}' has neither detect() as a detector nor update() as a tracker, nor fuse() as a "
        "fusion"
    )


def check(registry: Registry[Any], spec: str) -> None:
    """Refuse a plug-in that cannot be found, is of another kind or refuses its arguments.

    Ours are made once for it, so that values are refused too; what strangers' do when they are
    made is for the job to find out, where it costs them only their own row, and so is what is not
    installed.
    """
    plugin = registry.resolve(spec)
    needed = METHOD_OF[registry.kind]
    if not hasattr(plugin.factory, needed):
        others = [kind for kind, name in METHOD_OF.items() if hasattr(plugin.factory, name)]
        wrong = f"is a {others[0]}, not" if others else f"has no {needed}(), not"
        raise SpecError(f"'{spec}' {wrong} a {registry.kind}")
    if not hasattr(plugin.factory, "reset"):
        raise SpecError(f"'{spec}' has no reset()")
    try:
        inspect.signature(plugin.factory).bind(**plugin.arguments)
    except TypeError:
        plugin.make()
    if plugin.ours and not plugin.missing:
        _make(plugin)


def check_detector(spec: str) -> None:
    """Refuse what makes no detections; the oracle and noise models do, beside detectors."""
    if is_fused(spec):
        _check_fused(FusedSpec.parse(spec))
    elif not made_from_truth(spec):
        check(DETECTORS, full_name(spec))
    elif spec != ORACLE:
        _make(NOISES.resolve(spec))


def check_camera(spec: str) -> None:
    """Refuse what finds nothing in images; the oracle and imitations do, beside detectors."""
    if not drawn_from_truth(spec):
        check(CAMERA_DETECTORS, spec)
    elif spec != ORACLE:
        _make(CAMERA_NOISES.resolve(spec))


def _check_fused(spec: FusedSpec) -> None:
    if is_fused(spec.lidar):
        raise SpecError(f"lidar={spec.lidar}: name a LiDAR detector, not another fusion")
    check_detector(spec.lidar)
    check_camera(spec.camera)
    check(FUSIONS, spec.fusion)
    if spec.calibration:
        read_calibration(spec.calibration)


def _make(plugin: Plugin[Any]) -> None:
    """Make a plug-in of ours once, and read the weights that are named."""
    try:
        made = plugin.make()
        if "weights" in plugin.arguments and hasattr(made, "prepare"):
            made.prepare()
    except (TypeError, ValueError) as error:
        raise SpecError(f"'{plugin.spec}': {error}") from error


def _check_suite(suite: Suite) -> None:
    """Check the entries of the suite with the key that names them."""
    for key, registry, specs in (
        ("detection.entries", DETECTORS, suite.detectors),
        ("tracking.entries", TRACKERS, suite.trackers),
        ("fusion.entries", FUSIONS, suite.fusions),
    ):
        for spec in specs:
            _of_suite(suite, key, check, registry, spec)
    for key, specs in (
        ("tracking.detectors", suite.public_detectors),
        ("fusion.lidar", suite.fused_lidar),
    ):
        for spec in specs:
            _of_suite(suite, key, check_detector, spec)
            if is_fused(spec):
                _of_suite(suite, key, check_camera_of, suite)
    for key, specs in (
        ("camera.entries", suite.camera_detectors),
        ("fusion.camera", suite.fused_camera),
    ):
        for spec in specs:
            _of_suite(suite, key, check_camera, spec)


def _of_suite(suite: Suite, key: str | None, work: Callable[..., object], *arguments: Any) -> None:
    """Name the suite, and the key in it, in what is wrong with it."""
    try:
        work(*arguments)
    except ValueError as error:
        place = f"suite {suite.title}" + (f", {key}" if key else "")
        raise SuiteError(f"{place}: {error}") from error


def _refuse_unused(entries: Sequence[str], kinds: Sequence[str], boards: Sequence[str]) -> None:
    for spec, kind in zip(entries, kinds, strict=True):
        board = BOARD_OF[kind]
        if board not in boards:
            raise SpecError(f"'{spec}' is a {kind}; it belongs on the {board} board")


def _detection_jobs(suite: Suite, marks: Mapping[str, str], detectors: Sequence[str]) -> list[Job]:
    specs = {**marks, **{detector: detector for detector in detectors}}
    return _jobs(suite, "detection", [(entry, spec, None) for entry, spec in specs.items()])


def tracking_jobs(suite: Suite, trackers: Sequence[str]) -> list[Job]:
    """Every tracker on every public detector, all of them one entry; on the oracle, one apart."""
    alone = suite.public_detectors == (ORACLE,)
    rows = [
        (tracker if detector != ORACLE or alone else f"{tracker} on {detector}", detector, tracker)
        for detector in suite.public_detectors
        for tracker in dict.fromkeys(trackers)
    ]
    return _jobs(suite, "tracking", rows)


def recorded_jobs(suite: RecordedSuite, trackers: Sequence[str]) -> list[Job]:
    """Every tracker on every recording; the first detector goes without saying."""
    first = suite.public_detectors[0]
    return [
        Job(
            board_of(recording),
            tracker if recording.detector == first else f"{tracker} on {recording.detector}",
            recording.detector, tracker, recording, suite.eligibility,
        )
        for recording in suite.recordings
        for tracker in dict.fromkeys(trackers)
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
