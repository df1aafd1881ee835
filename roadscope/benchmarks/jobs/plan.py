"""From a suite and the user's entries to the jobs of a run."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.job import Job
from roadscope.benchmarks.noisy import NOISES
from roadscope.benchmarks.oracle import MARK_SPECS, ORACLE, made_from_truth
from roadscope.benchmarks.recorded.recording import board_of
from roadscope.benchmarks.recorded.suite import RecordedSuite
from roadscope.benchmarks.suite import Suite, SuiteError, check_names
from roadscope.core import Registry, SpecError
from roadscope.core.names import unknown
from roadscope.core.registry import Plugin, split_spec
from roadscope.detectors import DETECTORS
from roadscope.trackers import TRACKERS

BOARDS = ("detection", "tracking")


@dataclass(frozen=True, slots=True)
class Plan:
    """The jobs of each board, and the jobs whose detections several of them share."""

    detection: tuple[Job, ...]
    tracking: tuple[Job, ...]
    public: tuple[Job, ...]


def plan(
    suite: Suite, entries: Sequence[str], boards: Sequence[str], *, only: bool = False
) -> Plan:
    """Return all jobs; unknown names and wrong arguments raise before anything runs.

    Beside trackers, marks stand on no board alone.

    entries: specs of detectors and trackers beside (`only`: instead of) those of the suite.
    """
    if only and not entries:
        raise SpecError("--only needs at least one --entry")
    for board in boards:
        if board not in BOARDS:
            raise SpecError(unknown("board", board, BOARDS))
    if isinstance(suite, RecordedSuite):
        return _recorded_plan(suite, entries, boards, only=only)
    _of_suite(suite, None, check_names, suite)
    kinds = [kind_of(spec) for spec in entries]
    _refuse_unused(entries, kinds, boards)
    marks = {} if only else MARK_SPECS
    detectors = [] if only else list(suite.detectors)
    detectors += [s for s, kind in zip(entries, kinds, strict=True) if kind == "detector"]
    trackers = [] if only else list(suite.trackers)
    trackers += [s for s, kind in zip(entries, kinds, strict=True) if kind == "tracker"]
    _check_all(suite, [s for s in entries if s in detectors], [s for s in entries if s in trackers])
    if "tracking" in boards and not suite.public_detectors and ("tracker" in kinds or only):
        raise SpecError(f"suite {suite.title} names no tracking.detectors that trackers could get")
    tracking = tracking_jobs(suite, trackers) if "tracking" in boards else []
    detects = "detection" in boards and (detectors or not tracking)
    detection = _detection_jobs(suite, marks, detectors) if detects else []
    public = _jobs(suite, "detection", [(d, d, None) for d in suite.public_detectors])
    if not detection and not tracking:
        raise SpecError(f"suite {suite.title} has nothing to run on: {', '.join(boards)}")
    return Plan(tuple(detection), tuple(tracking), tuple(public if tracking else ()))


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


def kind_of(spec: str) -> str:
    """Say whether a spec names a detector or a tracker."""
    name, _ = split_spec(spec)
    if ":" not in name:
        if name in DETECTORS:
            return "detector"
        if name in TRACKERS:
            return "tracker"
        if made_from_truth(spec):
            raise SpecError(
                f"'{spec}' is no entry; a suite gives it to trackers: tracking.detectors"
            )
        known = [*DETECTORS.names(), *TRACKERS.names()]
        raise SpecError(
            unknown("detector or tracker", name, known)
            + "; or name your own: package.module:Class, path/to/file.py:Class"
        )
    factory: Any = DETECTORS.resolve(spec).factory
    if hasattr(factory, "detect"):
        return "detector"
    if hasattr(factory, "update"):
        return "tracker"
    raise SpecError(f"'{spec}' has neither detect() as a detector nor update() as a tracker")


def check(registry: Registry[Any], spec: str) -> None:
    """Refuse a plug-in that cannot be found, is of another kind or refuses its arguments.

    Ours are made once for it, so that values are refused too; what strangers' do when they are
    made is for the job to find out, where it costs them only their own row, and so is what is not
    installed.
    """
    plugin = registry.resolve(spec)
    needed = {"detector": "detect", "tracker": "update"}
    if not hasattr(plugin.factory, needed[registry.kind]):
        others = [kind for kind, name in needed.items() if hasattr(plugin.factory, name)]
        wrong = f"is a {others[0]}, not" if others else f"has no {needed[registry.kind]}(), not"
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
    if not made_from_truth(spec):
        check(DETECTORS, spec)
    elif spec != ORACLE:
        _make(NOISES.resolve(spec))


def _make(plugin: Plugin[Any]) -> None:
    try:
        plugin.make()
    except (TypeError, ValueError) as error:
        raise SpecError(f"'{plugin.spec}': {error}") from error


def _check_all(suite: Suite, detectors: Sequence[str], trackers: Sequence[str]) -> None:
    """Check the entries given, and those of the suite with the key that names them."""
    for spec in detectors:
        check(DETECTORS, spec)
    for spec in trackers:
        check(TRACKERS, spec)
    for key, registry, specs in (
        ("detection.entries", DETECTORS, suite.detectors),
        ("tracking.entries", TRACKERS, suite.trackers),
    ):
        for spec in specs:
            _of_suite(suite, key, check, registry, spec)
    for spec in suite.public_detectors:
        _of_suite(suite, "tracking.detectors", check_detector, spec)


def _of_suite(suite: Suite, key: str | None, work: Callable[..., None], *arguments: Any) -> None:
    """Name the suite, and the key in it, in what is wrong with it."""
    try:
        work(*arguments)
    except ValueError as error:
        place = f"suite {suite.title}" + (f", {key}" if key else "")
        raise SuiteError(f"{place}: {error}") from error


def _refuse_unused(entries: Sequence[str], kinds: Sequence[str], boards: Sequence[str]) -> None:
    for spec, kind in zip(entries, kinds, strict=True):
        board = "detection" if kind == "detector" else "tracking"
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
