"""Drives of a driver, who gets the tracks that a perception stack makes while the ego drives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.fingerprints import code_hash, fingerprint
from roadscope.benchmarks.isolation import PluginHandle
from roadscope.benchmarks.kinds import (
    CAMERA_DETECTOR,
    DETECTOR,
    DRIVER,
    FUSION,
    KINDS,
    ODOMETRY,
    Kind,
    traits_of,
)
from roadscope.benchmarks.loop import (
    AnswerCheck,
    CallInput,
    RunOptions,
    checked,
    open_with,
    run_plugin,
)
from roadscope.benchmarks.nodes.detections import in_world
from roadscope.benchmarks.nodes.traffic import SensingNode
from roadscope.benchmarks.parked import parked_centres_on, parked_owners
from roadscope.benchmarks.plugin_sources import plugin_hash
from roadscope.benchmarks.records import CallTimes, EpisodeRecord, without_sources
from roadscope.core import (
    Detections,
    DrivingCommand,
    DrivingScene,
    Registry,
    Spec,
    SpecError,
    Tracks,
    Truth,
    WheelSamples,
)
from roadscope.core.answers import check_command
from roadscope.core.spec import FUSED, NO_POSES, TRUE_POSES
from roadscope.driving import ClosedLoop, Perception
from roadscope.driving.perception import BLIND, TRUTH, parts_of
from roadscope.envs.sensors.rigs import rig

CLOSED_LOOP = "roadscope.driving.closed_loop"
"""A module that a drive depends on; its code counts in the node's content."""


@dataclass(frozen=True)
class Stack:
    """A perception stack: `DETECTOR + TRACKER [+ N ms]`, `truth` or `blind`."""

    text: str

    @property
    def senses(self) -> bool:
        """Whether it uses sensors."""
        return self.text not in (TRUTH, BLIND)

    def plugins(self) -> tuple[Spec, ...]:
        """Return the resolved specs of all plug-ins in it; `SpecError` if it is no stack."""
        if not self.senses:
            return ()
        detector, tracker, _ = parts_of(self.text)
        specs = [tracker.plain]
        if detector.name == FUSED:
            kinds = {"lidar": DETECTOR, "camera": CAMERA_DETECTOR, "fusion": FUSION}
            missing = [key for key in kinds if key not in detector.parts]
            if missing:
                raise SpecError(f"'{detector}': expected {'=, '.join(missing)}= too")
            specs += [kind.registry.resolve(detector.parts[key]) for key, kind in kinds.items()]
        else:
            specs.append(DETECTOR.registry.resolve(detector))
        if tracker.ego is not None and str(tracker.ego) not in (TRUE_POSES, NO_POSES):
            specs.append(ODOMETRY.registry.resolve(tracker.ego))
        return tuple(specs)

    def missing(self) -> str:
        """Return what it needs and is not installed; empty if nothing."""
        return next(filter(None, (traits_of(spec).requires for spec in self.plugins())), "")

    def spec(self) -> list[object]:
        """Return what its answers depend on."""
        return [self.text, *(plugin_hash(spec) for spec in self.plugins())]


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeDrive(EpisodeRecord):
    """A drive of K decisions, 0.1 s apart, among A other road users; frame `world`.

    stamps_s: (K,). speeds, accelerations: (K,) of the ego, m/s and m/s^2.
    reference_accelerations: (K,) m/s^2, of a driver of the simulation that gets the truth.
    ids: (1 + A,) of all road users, 0 for the ego. categories: (1 + A,). sizes: (1 + A, 3) metres.
    poses: (K, 1 + A, 3) box centre and yaw, NaN where absent. velocities: (K, 1 + A, 2), m/s.
    tracks: K records, those that the driver got. end_s: when the drive ended.
    desired_speed_m_s: of the ego. collided_with: an id, 0 for an obstacle, -1 for nobody.
    sensed, detected, believed: the truth of every processed scan, without sources, its detections,
        and the tracks right after it, at its stamp; empty without sensors.
    parked: (P, 2) centres of parked cars, which are scenery and no road users.
    driver_times: of the driver's calls. perception_times: of the calls of the stack for each scan.
    """

    stamps_s: np.ndarray
    speeds: np.ndarray
    accelerations: np.ndarray
    reference_accelerations: np.ndarray
    ids: np.ndarray
    categories: np.ndarray
    sizes: np.ndarray
    poses: np.ndarray
    velocities: np.ndarray
    tracks: tuple[Tracks, ...]
    end_s: float
    desired_speed_m_s: float
    collided_with: int
    sensed: tuple[Truth, ...]
    detected: tuple[Detections, ...]
    believed: tuple[Tracks, ...]
    parked: np.ndarray
    driver_times: CallTimes
    perception_times: CallTimes


@dataclass(frozen=True)
class DriveNode(SensingNode):
    """A drive through traffic that reacts to the ego.

    The plug-ins of the stack and the driver each run in a process of their own, unless they are
    part of roadscope. The report reads the lanes from the recorded traffic.

    A driver that gives the same commands as the one before it, in the same scenes, has the same
    drive: it is not simulated again, and the times of the stack are those of that drive. Only so if
    driver and stack are part of roadscope: other drivers may not see a drive before their own.
    """

    driver: Spec
    stack: Stack
    episode: Episode

    stage = "drives"
    record = EpisodeDrive

    def content(self) -> Mapping[str, Any]:
        """Return what the drive depends on."""
        return {**super().content(), "loop": code_hash(CLOSED_LOOP)}

    def plugins(self) -> Iterator[Spec]:
        """Yield the driver and the plug-ins of the stack."""
        yield self.driver
        yield from self.stack.plugins()

    def compute(self, options: RunOptions) -> EpisodeDrive:
        """Drive until the time is up, the road ends or the ego collides."""
        if any(spec.isolated for spec in self.plugins()):
            return self._driven(options).drive
        content = self.content()
        key = fingerprint({name: value for name, value in content.items() if name != "driver"})
        last = _last_drive.get(key)
        # Computed again, a driver drives again.
        if last is not None and self.driver not in last.drivers:
            last.drivers.add(self.driver)
            if (drive := self._repeated(last, options)) is not None:
                return drive
        _last_drive.clear()
        _last_drive[key] = last = self._driven(options)
        return last.drive

    def _repeated(self, last: _DrivenScenes, options: RunOptions) -> EpisodeDrive | None:
        """Return another driver's drive as that of this driver; None if its commands differ."""
        commands = iter(last.commands)

        def compare(answer: Any, call_input: CallInput[DrivingScene]) -> DrivingCommand:
            command = check_command(answer, lanes=call_input.context.lanes)
            if command != next(commands):
                raise _OtherCommandError
            return command

        inputs = (CallInput((scene,), scene) for scene in last.scenes)
        try:
            replies = run_plugin(self.driver, DRIVER, inputs, compare, options=options)
        except _OtherCommandError:
            return None
        return replace(last.drive, driver_times=replies.times)

    def _driven(self, options: RunOptions) -> _DrivenScenes:
        """Return the drive of the driver."""
        episode, sensors = self.episode, rig(self.episode.rig)
        with ExitStack() as opened:
            calls = _StackCalls(options, opened)
            stack: Perception | str = self.stack.text
            if self.stack.senses:
                stack = Perception(self.stack.text, sensors, calls.make)
            loop = ClosedLoop(
                episode.scenario,
                episode.seed,
                perception=stack,
                rig=sensors,
                duration_s=duration_of(episode),
                weather=episode.weather,
                light=None if episode.light == "day" else episode.light,
                faults=episode.faults,
            )
            log = _DriveLog()

            # They take turns: the next scene is made after the traffic has moved on in `execute`.
            def scenes() -> Iterator[CallInput[DrivingScene]]:
                while not loop.over:
                    tracks = loop.tracks()
                    log.add_scans(loop, calls)
                    scene = loop.scene(tracks)
                    log.add_scene(scene, loop)
                    yield CallInput((scene,), scene)

            def execute(answer: Any, call_input: CallInput[DrivingScene]) -> DrivingCommand:
                command = check_command(answer, lanes=call_input.context.lanes)
                loop.step(command)
                return command

            replies = run_plugin(self.driver, DRIVER, scenes(), execute, options=options)
        if not log.scenes:
            raise ValueError("the ego has collided before the drive begins")
        drive = log.drive(loop, episode.seed, replies.times)
        return _DrivenScenes({self.driver}, log.scenes, replies.answers, drive)


@dataclass(frozen=True, slots=True)
class _DrivenScenes:
    """A drive with the K scenes that the driver got, and its commands.

    drivers: those that have driven or repeated it.
    """

    drivers: set[Spec]
    scenes: Sequence[DrivingScene]
    commands: Sequence[DrivingCommand | None]
    drive: EpisodeDrive


class _OtherCommandError(Exception):
    """A driver gave another command than the one before it."""


_last_drive: dict[str, _DrivenScenes] = {}
"""The last drive in this process, by all that it depends on but the driver."""


def duration_of(episode: Episode) -> float:
    """Return how long a drive should last, seconds."""
    from roadscope.envs.traffic.scenarios import find

    return episode.duration_s or find(episode.scenario).duration_s


@dataclass(slots=True)
class _DriveLog:
    """What is written down during a drive; see the fields of `EpisodeDrive`.

    parked: numbers of the parked cars that sensors saw.
    scan_times: processor and wall time of the stack for each processed scan, milliseconds.
    """

    scenes: list[DrivingScene] = field(default_factory=list)
    reference_accelerations: list[float] = field(default_factory=list)
    sensed: list[Truth] = field(default_factory=list)
    detected: list[Detections] = field(default_factory=list)
    believed: list[Tracks] = field(default_factory=list)
    parked: set[int] = field(default_factory=set)
    scan_times: list[tuple[float, float]] = field(default_factory=list)

    def add_scene(self, scene: DrivingScene, loop: ClosedLoop) -> None:
        """Note what the driver gets, and how a driver of the simulation would accelerate."""
        self.scenes.append(scene)
        traffic = loop.traffic
        reference = traffic.outlook(traffic.true_tracks()).model
        self.reference_accelerations.append(reference.acceleration_m_s2)

    def add_scans(self, loop: ClosedLoop, calls: _StackCalls) -> None:
        """Note the scans that the stack has processed in this step, and their times."""
        for truth in loop.truths:
            self.parked |= parked_owners(truth)
        count = len(loop.processed)
        if not count:
            return
        # Of scans that are processed together, each has its share of the time.
        processor_ms, wall_ms = calls.take_times()
        for truth, scan in loop.processed:
            self.sensed.append(without_sources(truth))
            self.detected.append(in_world(scan.detections, truth))
            self.believed.append(scan.tracks)
            self.scan_times.append((processor_ms / count, wall_ms / count))

    def drive(self, loop: ClosedLoop, seed: int, driver_times: CallTimes) -> EpisodeDrive:
        """Return the record of the drive, which is over."""
        timeline = loop.traffic.timeline(loop.traffic.now_s)
        stamps_s = np.array([scene.stamp_s for scene in self.scenes])
        states = timeline.at(stamps_s)
        poses = np.concatenate([timeline.centres(states), states.yaws[..., None]], axis=-1)
        poses[~states.present] = np.nan
        speeds = np.array([scene.speed_m_s for scene in self.scenes])
        end_s = loop.traffic.now_s
        next_speeds = np.append(speeds[1:], loop.traffic.speed_m_s)
        steps_s = np.diff(stamps_s, append=end_s)
        collided = loop.traffic.collided_with
        return EpisodeDrive(
            stamps_s=stamps_s,
            speeds=speeds,
            accelerations=(next_speeds - speeds) / steps_s,
            reference_accelerations=np.array(self.reference_accelerations),
            ids=timeline.ids,
            categories=timeline.categories,
            sizes=timeline.sizes,
            poses=poses,
            velocities=states.velocities,
            tracks=tuple(scene.tracks for scene in self.scenes),
            end_s=end_s,
            desired_speed_m_s=loop.traffic.desired_speed_m_s,
            collided_with=-1 if collided is None else collided,
            sensed=tuple(self.sensed),
            detected=tuple(self.detected),
            believed=tuple(self.believed),
            parked=parked_centres_on(timeline, seed, self.parked),
            driver_times=driver_times,
            perception_times=CallTimes(*np.array(self.scan_times).reshape(-1, 2).T),
        )


class _StackCalls:
    """Makes plug-ins whose calls are checked and timed."""

    def __init__(self, options: RunOptions, opened: ExitStack) -> None:
        self._options, self._opened = options, opened
        self._processor_ms = self._wall_ms = 0.0

    def make(self, registry: Registry[Any], spec: Spec) -> Any:
        """Make a plug-in of a registry, in a process of its own unless it is ours."""
        resolved = registry.resolve(spec)
        handle = self._opened.enter_context(open_with(self._options, resolved))
        return _CalledPlugin(self, handle, resolved, KINDS[registry.kind])

    def call(self, handle: PluginHandle, method: str, *arguments: Any) -> Any:
        """Call a method and add its time to the times of the stack."""
        timed = handle.call(method, *arguments)
        self._processor_ms += timed.processor_ms
        self._wall_ms += timed.wall_ms
        return timed.answer

    def take_times(self) -> tuple[float, float]:
        """Return the processor and wall time of all calls since it was called last, ms."""
        times = self._processor_ms, self._wall_ms
        self._processor_ms = self._wall_ms = 0.0
        return times


class _CalledPlugin:
    """A plug-in of a stack as an object whose methods call the plug-in, check and time.

    It has the methods of every kind; the stack calls those of the plug-in's kind.
    """

    def __init__(self, calls: _StackCalls, handle: PluginHandle, spec: Spec, kind: Kind) -> None:
        self._calls, self._handle, self._spec, self._kind = calls, handle, spec, kind

    def reset(self, *arguments: Any) -> None:
        self._handle.call("reset", *arguments)
        self._check = AnswerCheck(self._kind.name)

    def add_wheels(self, wheels: WheelSamples) -> None:
        if self._handle.traits.takes_wheels:
            self._calls.call(self._handle, "add_wheels", wheels)

    def _answer(self, *arguments: Any) -> Any:
        answer = self._calls.call(self._handle, self._kind.method, *arguments)
        return checked(self._spec, self._check, answer, CallInput(arguments, None))

    detect = fuse = update = _answer
