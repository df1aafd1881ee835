"""Drives of a driver, who gets the tracks that a perception stack makes from sensor data."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.fingerprints import code_hash, plugin_hash
from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.isolation import PluginHandle, open_plugin
from roadscope.benchmarks.kinds import DRIVER, KINDS, traits_of
from roadscope.benchmarks.loop import CallInput, RunOptions, checked, run_plugin
from roadscope.benchmarks.nodes.traffic import TrafficNode
from roadscope.benchmarks.parked import parked_centres_on, parked_owners
from roadscope.benchmarks.records import CallTimes, EpisodeRecord, without_sources
from roadscope.benchmarks.references import resolved_plugin
from roadscope.core import (
    DrivingCommand,
    DrivingScene,
    Frame,
    Registry,
    Spec,
    SpecError,
    Tracks,
    Truth,
)
from roadscope.core.answers import (
    check_command,
    check_detections,
    check_estimate,
    check_fused,
    check_image_detections,
    check_tracks,
)
from roadscope.core.spec import FUSED, NO_POSES, TRUE_POSES
from roadscope.driving import ClosedLoop, Perception
from roadscope.driving.perception import BLIND, TRUTH, parts_of
from roadscope.envs.sensors.rigs import rig

CLOSED_LOOP = "roadscope.driving.closed_loop"
"""The module whose code a drive depends on."""


@dataclass(frozen=True)
class Stack:
    """A perception stack: `DETECTOR + TRACKER`, `truth` or `blind`."""

    text: str

    @property
    def senses(self) -> bool:
        """Whether it uses sensors."""
        return self.text not in (TRUTH, BLIND)

    def plugins(self) -> tuple[Spec, ...]:
        """Return the resolved specs of all plug-ins in it; `SpecError` if it is no stack."""
        if not self.senses:
            return ()
        detector, tracker = parts_of(self.text)
        specs = [tracker.plain]
        if detector.name == FUSED:
            kinds = {"lidar": "detector", "camera": "camera detector", "fusion": "fusion"}
            missing = [key for key in kinds if key not in detector.parts]
            if missing:
                raise SpecError(f"'{detector}': expected {'=, '.join(missing)}= too")
            specs += [
                resolved_plugin(KINDS[kind].registry, detector.parts[key])
                for key, kind in kinds.items()
            ]
        else:
            specs.append(resolved_plugin(KINDS["detector"].registry, detector))
        if tracker.ego is not None and str(tracker.ego) not in (TRUE_POSES, NO_POSES):
            specs.append(KINDS["odometry"].registry.resolve(tracker.ego))
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
    sensed, believed: the truth of every processed scan, without sources, and the tracks right after
        it, at its stamp; empty without sensors. parked: (P, 2) centres of parked cars, which are
        scenery and no road users.
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
    believed: tuple[Tracks, ...]
    parked: np.ndarray
    driver_times: CallTimes
    perception_times: CallTimes


@dataclass(frozen=True)
class DriveNode(Node):
    """A drive through traffic that reacts to the ego.

    The plug-ins of the stack and the driver each run in a process of their own, unless they are
    part of roadscope.
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

    def sources(self) -> tuple[Node, ...]:
        """Return the recorded traffic: the report reads the lanes from it."""
        return (TrafficNode.of(self.episode),)

    def compute(self, options: RunOptions) -> EpisodeDrive:
        """Drive until the time is up, the road ends or the ego collides."""
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

            def scenes() -> Iterator[CallInput[DrivingScene]]:
                while not loop.over:
                    tracks = loop.tracks()
                    log.add_scans(loop, calls)
                    scene = loop.scene(tracks)
                    log.add(scene, loop)
                    yield CallInput((scene,), scene)

            def execute(answer: Any, call_input: CallInput[DrivingScene]) -> DrivingCommand:
                command = check_command(answer, lanes=call_input.context.lanes)
                loop.step(command)
                return command

            replies = run_plugin(self.driver, DRIVER, scenes(), execute, options=options)
        if not log.scenes:
            raise ValueError("the ego has collided before the drive begins")
        return log.drive(loop, episode.seed, replies.times)


def duration_of(episode: Episode) -> float:
    """Return how long a drive should last, seconds."""
    from roadscope.envs.traffic.scenarios import find

    return episode.duration_s or find(episode.scenario).duration_s


@dataclass(slots=True)
class _DriveLog:
    """What is written down during a drive."""

    scenes: list[DrivingScene] = field(default_factory=list)
    reference_accelerations: list[float] = field(default_factory=list)
    sensed: list[Truth] = field(default_factory=list)
    believed: list[Tracks] = field(default_factory=list)
    parked: set[int] = field(default_factory=set)
    times: list[tuple[float, float]] = field(default_factory=list)

    def add(self, scene: DrivingScene, loop: ClosedLoop) -> None:
        self.scenes.append(scene)
        traffic = loop.traffic
        reference = traffic.outlook(traffic.true_tracks()).model
        self.reference_accelerations.append(reference.acceleration_m_s2)

    def add_scans(self, loop: ClosedLoop, calls: _StackCalls) -> None:
        for truth in loop.truths:
            self.parked |= parked_owners(truth)
        count = len(loop.processed)
        if not count:
            return
        # Of scans that are processed together, each has its share of the time.
        processor_ms, wall_ms = calls.take_times()
        for truth, tracks in loop.processed:
            self.sensed.append(without_sources(truth))
            self.believed.append(tracks)
            self.times.append((processor_ms / count, wall_ms / count))

    def drive(self, loop: ClosedLoop, seed: int, driver_times: CallTimes) -> EpisodeDrive:
        timeline = loop.traffic.timeline(loop.traffic.now_s)
        stamps_s = np.array([scene.stamp_s for scene in self.scenes])
        states = timeline.at(stamps_s)
        poses = np.concatenate([timeline.centres(states), states.yaws[..., None]], axis=-1)
        poses[~states.present] = np.nan
        speeds = np.array([scene.speed_m_s for scene in self.scenes])
        end_s = loop.traffic.now_s
        after = np.append(speeds[1:], loop.traffic.speed_m_s)
        steps_s = np.diff(stamps_s, append=end_s)
        collided = loop.traffic.collided_with
        return EpisodeDrive(
            stamps_s=stamps_s,
            speeds=speeds,
            accelerations=(after - speeds) / steps_s,
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
            believed=tuple(self.believed),
            parked=parked_centres_on(timeline, seed, self.parked),
            driver_times=driver_times,
            perception_times=CallTimes(*np.array(self.times).reshape(-1, 2).T),
        )


# --------------------------------------------------------------------------------------------------
# The plug-ins of a stack.


class _StackCalls:
    """Makes plug-ins whose calls are checked and timed."""

    def __init__(self, options: RunOptions, opened: ExitStack) -> None:
        self._options, self._opened = options, opened
        self._processor_ms = self._wall_ms = 0.0

    def make(self, registry: Registry[Any], spec: Spec) -> Any:
        """Make a plug-in of a registry, in a process of its own unless it is ours."""
        resolved, options = resolved_plugin(registry, spec).plain, self._options
        handle: AbstractContextManager[PluginHandle] = open_plugin(
            resolved,
            limits=options.limits,
            isolated=resolved.isolated and not options.trust,
            sandbox=options.sandbox,
            hidden=options.hidden,
        )
        plugin = _CALLED[registry.kind](self._opened.enter_context(handle), resolved)
        plugin.note = self._note
        return plugin

    def take_times(self) -> tuple[float, float]:
        """Return the processor and wall time of all calls since the last time, milliseconds."""
        times = self._processor_ms, self._wall_ms
        self._processor_ms = self._wall_ms = 0.0
        return times

    def _note(self, processor_ms: float, wall_ms: float) -> None:
        self._processor_ms += processor_ms
        self._wall_ms += wall_ms


class _CalledPlugin:
    """A plug-in as an object, whose methods call its handle."""

    note: Callable[[float, float], None]

    def __init__(self, handle: PluginHandle, spec: Spec) -> None:
        self._handle, self._spec = handle, spec
        self._stamps_s: list[float] = []

    def reset(self, *arguments: Any) -> None:
        self._handle.call("reset", *arguments)
        self._stamps_s = []

    def _call(self, check: Callable[[Any], Any], method: str, *arguments: Any) -> Any:
        timed = self._handle.call(method, *arguments)
        self.note(timed.processor_ms, timed.wall_ms)
        return checked(self._spec, check, timed.answer)


class _CalledDetector(_CalledPlugin):
    def detect(self, frame: Frame) -> Any:
        assert frame.lidar is not None
        self._stamps_s.append(frame.lidar.stamp_s)
        return self._call(
            lambda answer: check_detections(answer, stamps_s=self._stamps_s), "detect", frame
        )


class _CalledCameraDetector(_CalledPlugin):
    def detect(self, frame: Frame) -> Any:
        assert frame.camera is not None
        stamp_s = frame.camera.stamp_s
        return self._call(
            lambda answer: check_image_detections(answer, stamp_s=stamp_s), "detect", frame
        )


class _CalledFusion(_CalledPlugin):
    def fuse(self, lidar: Any, camera: Any, projection: Any) -> Any:
        return self._call(
            lambda answer: check_fused(answer, stamp_s=lidar.stamp_s),
            "fuse",
            lidar,
            camera,
            projection,
        )


class _CalledTracker(_CalledPlugin):
    def update(self, detections: Any, pose: Any) -> Any:
        return self._call(
            lambda answer: check_tracks(answer, stamp_s=detections.stamp_s, posed=pose is not None),
            "update",
            detections,
            pose,
        )


class _CalledOdometry(_CalledPlugin):
    @property
    def wheels(self) -> bool:
        return self._handle.traits.takes_wheels

    def add_wheels(self, wheels: Any) -> None:
        if self.wheels:
            self._call(lambda answer: answer, "add_wheels", wheels)

    def update(self, scan: Any, imu: Any) -> Any:
        return self._call(
            lambda answer: check_estimate(answer, stamp_s=scan.stamp_s, returns=len(scan)),
            "update",
            scan,
            imu,
        )


_CALLED: Mapping[str, type[_CalledPlugin]] = {
    "detector": _CalledDetector,
    "camera detector": _CalledCameraDetector,
    "tracker": _CalledTracker,
    "fusion": _CalledFusion,
    "odometry": _CalledOdometry,
}
