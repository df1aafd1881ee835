"""A perception stack: detector, tracker and perhaps an odometry, fed while the ego drives."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from difflib import get_close_matches
from typing import Any, NamedTuple

import numpy as np

from roadscope.core import Detections, Frame, ImageDetections, Pose, Registry, Spec, Tracks, Truth
from roadscope.core.loading import SpecError
from roadscope.core.projection import Projection
from roadscope.core.spec import FUSED, FUSED_PARTS, NO_POSES, TRUE_POSES
from roadscope.detectors import DETECTORS
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.envs.sensors.rig import Rig
from roadscope.fusion import FUSIONS
from roadscope.fusion.pairing import LIMIT_S, moved_projection
from roadscope.odometry import ODOMETRIES
from roadscope.odometry.api import update_with_wheels
from roadscope.trackers import TRACKERS, is_offline

PLUS = " + "
"""Separates the detector from the tracker in the text of a stack."""
_DELAY = re.compile(r" *\+ *([0-9]{1,5}) *ms\Z")
"""The delay at the end of a stack, whole milliseconds."""
TRUTH, BLIND = "truth", "blind"
"""Stacks without sensors: the true road users, and no road users."""


ROUNDING_S = 1e-6
"""Instants that differ by less are the same."""
MakePlugin = Callable[[Registry[Any], Spec], Any]
"""Makes a plug-in of a registry."""


class StackParts(NamedTuple):
    """What a stack is made of.

    detector, tracker: their specs; that of the tracker resolved. delay_s: from the stamp of a scan
    to the moment when its tracks are known, at the earliest.
    """

    detector: Spec
    tracker: Spec
    delay_s: float


class ProcessedScan(NamedTuple):
    """What a stack made of a scan.

    detections: as the tracker got them. tracks: right after it, frame `world`, at its stamp.
    """

    detections: Detections
    tracks: Tracks


def in_this_process(registry: Registry[Any], spec: Spec) -> Any:
    """Make a plug-in in this process; `SpecError` for a tracker that needs the whole episode."""
    plugin = registry.make(spec)
    if is_offline(type(plugin)):
        raise SpecError(f"'{spec}' needs the whole episode, so nobody can drive with it")
    return plugin


def parts_of(text: str) -> StackParts:
    """Return what a stack is made of; `SpecError` for a text that is no stack."""
    if not isinstance(text, str):
        raise TypeError(
            f"perception: expected a text, '{TRUTH}', '{BLIND}' or 'DETECTOR{PLUS}TRACKER', "
            f"got {text!r}"
        )
    delay = _DELAY.search(text)
    stack = text[: delay.start()] if delay else text
    detector, plus, tracker = stack.rpartition(PLUS)
    if not plus:
        raise SpecError(
            f"'{text}' names no perception stack{_suggestion(stack)}: expected "
            f"'DETECTOR{PLUS}TRACKER', such as 'distance-l-shape{PLUS}existence', or '{TRUTH}' or "
            f"'{BLIND}', which have no delay"
        )
    if tracker[:1].isdigit():
        raise SpecError(
            f"'{text}': '{tracker}' is no delay: expected whole milliseconds, "
            f"'{detector}{PLUS}200 ms'"
        )
    spec = Spec.parse(detector)
    if spec.name in CAMERA_DETECTORS and spec.name not in DETECTORS:
        raise SpecError(
            f"'{detector}' is a camera detector: it gives boxes in images, without distance. "
            f"'fused?lidar=A&camera={detector}&fusion=C{PLUS}{tracker}' uses one"
        )
    return StackParts(spec, TRACKERS.resolve(tracker), float(delay[1]) / 1e3 if delay else 0.0)


def _suggestion(text: str) -> str:
    """Return which stack may have been meant, for error texts; empty if none is similar."""
    detector, plus, tracker = text.rpartition(PLUS.strip())
    close = [each for each in get_close_matches(text.lower(), (TRUTH, BLIND), n=1) if each != text]
    if plus:
        close = [f"{detector.strip()}{PLUS}{tracker.strip()}"]
    return f" (did you mean '{close[0]}'?)" if close else ""


class Perception:
    """A detector and a tracker that run while the ego drives.

    text: `DETECTOR + TRACKER`, each a spec. The detector is one of LiDAR or
        `fused?lidar=A&camera=B&fusion=C`. The tracker may have `?ego=ODOMETRY` or `?ego=none`;
        otherwise it gets the true poses of the ego. With `DETECTOR + TRACKER + 200 ms` the tracks
        of a scan are known 0.2 s after its stamp, as if the stack computed for so long. The tracker
        itself gets every scan at once.
    rig: the sensors whose frames it gets.
    make: makes a plug-in of a registry from its spec; None makes them in this process.

    Raises `SpecError` if the text names no stack.
    """

    def __init__(self, text: str, rig: Rig, make: MakePlugin | None = None) -> None:
        make = make or in_this_process
        detector, tracker, self._delay_s = parts_of(text)
        self.text = text
        self._tracker = make(TRACKERS, tracker.plain)
        self._ego = _EgoPoses(tracker.ego, rig, make)
        fused = detector.name == FUSED
        self._source = _Fused(detector, rig, make) if fused else _Lidar(detector, make)
        self.reset()

    def reset(self) -> None:
        """Forget the episode."""
        self._source.reset()
        self._tracker.reset()
        self._ego.reset()
        self._known = Tracks.empty(0.0, "world")
        self._last_stamp_s = -np.inf
        self._computing: deque[Tracks] = deque()
        self._processed: list[ProcessedScan] = []

    def used_sensors(self, rig: Rig) -> Rig:
        """Return the sensors of a rig that the stack uses."""
        if not isinstance(self._source, _Fused):
            rig = replace(rig, camera=None)
        return rig if self._ego.estimates else replace(rig, imu=None, wheels=None)

    def update(self, frames: Iterable[Frame], truths: Iterable[Truth], now_s: float) -> None:
        """Process the frames that sensors completed since the last call, up to `now_s`.

        truths: of the frames; only the poses of the ego are used.
        """
        for frame, truth in zip(frames, truths, strict=True):
            self._ego.add(frame, truth)
            self._source.add(frame)
        for detections in self._source.completed(now_s):
            self._track(detections)

    def take_processed(self) -> list[ProcessedScan]:
        """Return the scans that were processed since the last call."""
        processed, self._processed = self._processed, []
        return processed

    def tracks(self, now_s: float) -> Tracks:
        """Return the tracks that are not tentative, frame `world`, moved on to `now_s`.

        `now_s` must not be before that of an earlier call.
        """
        while self._computing and self._computing[0].stamp_s + self._delay_s <= now_s + ROUNDING_S:
            self._known = self._computing.popleft()
        moved = self._known.centres.copy()
        moved[:, :2] += (now_s - self._known.stamp_s) * self._known.velocities
        return replace(self._known, centres=moved, stamp_s=now_s)

    def _track(self, detections: Detections) -> None:
        # A detector that answers late has an empty answer for a frame first, and then another.
        if detections.stamp_s <= self._last_stamp_s:
            return
        self._last_stamp_s = detections.stamp_s
        pose = self._ego.believed(detections.stamp_s)
        tracks = self._tracker.update(detections, pose).sure
        in_world = self._ego.in_true_world(tracks, pose, detections.stamp_s)
        self._computing.append(in_world)
        self._processed.append(ProcessedScan(detections, in_world))


def stack_of(text: str, rig: Rig) -> Perception | str:
    """Return the perception that a text names; `truth` and `blind` stay texts."""
    return text if text in (TRUTH, BLIND) else Perception(text, rig)


class _Lidar:
    """Detections of a LiDAR detector."""

    def __init__(self, spec: Spec, make: MakePlugin) -> None:
        self._detector = make(DETECTORS, spec)

    def reset(self) -> None:
        self._detector.reset()
        self._completed: list[Detections] = []

    def add(self, frame: Frame) -> None:
        if frame.lidar is not None:
            detections = self._detector.detect(frame)
            if not isinstance(detections, Detections):
                raise SpecError(
                    f"{type(self._detector).__name__} detects no boxes in space: a stack needs a "
                    "LiDAR detector"
                )
            self._completed.append(detections)

    def completed(self, now_s: float) -> list[Detections]:
        """Return the detections since the last call."""
        completed, self._completed = self._completed, []
        return completed


class _Fused:
    """Fused detections of each scan and the image nearest in time.

    A scan waits until no later image can be the nearest.
    """

    def __init__(self, spec: Spec, rig: Rig, make: MakePlugin) -> None:
        if rig.camera is None:
            raise SpecError(f"'{spec}' needs a camera, which the rig '{rig.name}' does not have")
        missing = [key for key in FUSED_PARTS if key not in spec.parts]
        if missing:
            raise SpecError(f"'{spec}': expected {'=, '.join(missing)}= too")
        self._rig, self._camera = rig, rig.camera
        self._detector = make(DETECTORS, spec.parts["lidar"])
        self._image_detector = make(CAMERA_DETECTORS, spec.parts["camera"])
        self._fusion = make(FUSIONS, spec.parts["fusion"])

    def reset(self) -> None:
        for each in (self._detector, self._image_detector, self._fusion):
            each.reset()
        self._scans: deque[tuple[Frame, Detections]] = deque()
        self._images: deque[ImageDetections] = deque(maxlen=8)

    def add(self, frame: Frame) -> None:
        if frame.camera is not None:
            boxes = self._image_detector.detect(frame)
            assert isinstance(boxes, ImageDetections)
            self._images.append(boxes)
        if frame.lidar is not None:
            detections = self._detector.detect(frame)
            assert isinstance(detections, Detections)
            self._scans.append((frame, detections))

    def completed(self, now_s: float) -> list[Detections]:
        """Return the fused detections of scans whose nearest image is known."""
        wait_s = LIMIT_S + self._camera.spec.exposure_s / 2
        fused = []
        while self._scans and self._scans[0][1].stamp_s + wait_s <= now_s:
            fused.append(self._fuse(*self._scans.popleft()))
        return fused

    def _fuse(self, frame: Frame, detections: Detections) -> Detections:
        near = [
            boxes for boxes in self._images if abs(boxes.stamp_s - detections.stamp_s) <= LIMIT_S
        ]
        image = min(near, key=lambda b: abs(b.stamp_s - detections.stamp_s), default=None)
        pinhole = self._camera.spec.pinhole
        mounting = frame.calibration.pose(self._camera.name)
        projection = Projection.of(pinhole.intrinsics, mounting, pinhole.width, pinhole.height)
        gap_s = 0.0 if image is None else image.stamp_s - detections.stamp_s
        period_s = self._rig.lidar.spec.period_s
        projection = moved_projection(projection, frame.previous_from_ego, period_s, gap_s)
        fused: Detections = self._fusion.fuse(detections, image, projection).detections()
        return fused


class _EgoPoses:
    """The poses of the ego that a tracker gets: true ones, those of an odometry, or none.

    spec: the tracker's `?ego=`; None for true poses.
    """

    def __init__(self, spec: Spec | None, rig: Rig, make: MakePlugin) -> None:
        source = TRUE_POSES if spec is None else str(spec)
        self._has_poses, self._odometry = source != NO_POSES, None
        self._rig = rig
        if source not in (TRUE_POSES, NO_POSES):
            self._odometry = make(ODOMETRIES, Spec.parse(source))

    @property
    def estimates(self) -> bool:
        """Whether an odometry estimates the poses."""
        return self._odometry is not None

    def reset(self) -> None:
        self._true: deque[tuple[float, Pose]] = deque(maxlen=64)
        self._estimated: deque[tuple[float, Pose]] = deque(maxlen=64)
        self._must_reset = True

    def add(self, frame: Frame, truth: Truth) -> None:
        self._true.append((truth.stamp_s, truth.world_from_ego))
        if self._odometry is None or frame.lidar is None:
            return
        mounting = frame.calibration.pose(self._rig.lidar.name)
        if self._must_reset:
            lidar_from_imu = None
            if self._rig.imu is not None:
                lidar_from_imu = mounting.inverse() @ frame.calibration.pose(self._rig.imu.name)
            self._odometry.reset(lidar_from_imu)
            self._must_reset = False
        estimate = update_with_wheels(self._odometry, frame.lidar, frame.imu, frame.wheels)
        pose = mounting @ estimate.start_from_lidar @ mounting.inverse()
        self._estimated.append((frame.lidar.stamp_s, pose))

    def believed(self, stamp_s: float) -> Pose | None:
        """Return `world_from_ego` as the tracker gets it, None if it gets no poses."""
        if not self._has_poses:
            return None
        return _nearest(self._true if self._odometry is None else self._estimated, stamp_s)

    def in_true_world(self, tracks: Tracks, pose: Pose | None, stamp_s: float) -> Tracks:
        """Return tracks in the true frame `world`; relative to the ego, their places do not change.

        pose: that of `believed`, which the tracker got.
        """
        world_from_ego = _nearest(self._true, stamp_s)
        if tracks.frame == "ego":
            own = tracks.moved(world_from_ego, "world")
            return replace(own, velocities=own.velocities + self._velocity(world_from_ego, own))
        if pose is None or self._odometry is None:
            return tracks
        return tracks.moved(world_from_ego @ pose.inverse(), "world")

    def _velocity(self, world_from_ego: Pose, tracks: Tracks) -> np.ndarray:
        """Return (N, 2) velocities that tracks would have if they were fixed to the ego, m/s."""
        if len(self._true) < 2:
            return np.zeros((len(tracks), 2))
        (before_s, before), (now_s, now) = self._true[-2], self._true[-1]
        step_s = now_s - before_s
        if step_s <= 0:
            return np.zeros((len(tracks), 2))
        velocity = (now.translation - before.translation)[:2] / step_s
        rate = float(np.angle(np.exp(1j * (now.yaw - before.yaw)))) / step_s
        lever = tracks.centres[:, :2] - world_from_ego.translation[:2]
        moving: np.ndarray = velocity + rate * np.column_stack([-lever[:, 1], lever[:, 0]])
        return moving


def _nearest(poses: Iterable[tuple[float, Pose]], stamp_s: float) -> Pose:
    return min(poses, key=lambda each: abs(each[0] - stamp_s))[1]
