"""Runs detectors and trackers over an episode; only the plug-in's own call is timed."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from itertools import chain, islice
from operator import methodcaller
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.fingerprint import PACKAGE
from roadscope.benchmarks.oracle import from_truth, made_from_truth
from roadscope.benchmarks.parked import parked_centres, parked_owners
from roadscope.benchmarks.perceived import Perceived, without_sources
from roadscope.core import Detections, Frame, NotInstalledError, Pose, Tracks, Truth
from roadscope.detectors import DETECTORS
from roadscope.trackers import TRACKERS
from roadscope.trackers.api import OfflineTracker, is_offline, is_weighed

T = TypeVar("T")

STAMP_TOLERANCE_S = 1e-6
WARM_FRAMES = 6
"""Enough for what looks for motion and answers a frame late to have answered."""
_WARM: set[str] = set()
"""Specs of our detectors that were called in this process."""


class EntryError(RuntimeError):
    """A plug-in failed; the message says how."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a detector said of a frame, world frame, and how long after the frame."""

    detections: Detections
    delay_s: float


def perceive(detector: str, episode: Episode, eligibility: Eligibility) -> Perceived:
    """Run a detector, the oracle or a noise model over an episode.

    An answer is filed under the frame whose stamp it bears, this one or an earlier one. A frame
    that is never answered has no detections.
    """
    answers: list[Answer | None] = []
    truths: list[Truth] = []
    calls_ms = []
    parked: set[int] = set()
    detect = _detect(detector, episode, eligibility)
    for frame, truth in _warmed_up(detector, sensed(episode)):
        answers.append(None)
        truths.append(without_sources(truth))
        parked |= parked_owners(truth)
        found, took_ms = detect(frame, truth)
        _file(detector, found, answers, truths)
        calls_ms.append(took_ms)
    if not truths:
        raise ValueError("the episode is shorter than one sweep of the LiDAR")
    return Perceived(
        tuple(
            Detections.empty(truth.stamp_s, "world") if answer is None else answer.detections
            for answer, truth in zip(answers, truths, strict=True)
        ),
        tuple(truths),
        np.array(calls_ms),
        parked_centres(episode, parked),
        np.array([np.nan if answer is None else answer.delay_s for answer in answers]),
    )


def track(
    tracker: str,
    perceived: Perceived,
    *,
    unsure: bool = False,
    told: Sequence[Pose | None] | None = None,
) -> tuple[list[Tracks], np.ndarray]:
    """Run a tracker over an episode's detections, with the true pose of the ego or another.

    Returns confirmed and coasting tracks in the world frame, and the time of each call in ms.
    Of an offline tracker they are what it told after the last frame; every call bears its share
    of the time of that.

    unsure: tentative tracks are wanted, too.
    told: poses of the ego in another world, frame by frame, that the tracker gets in place of the
        true ones, or None where it gets none: the ego stands at the origin of that world. Tracks
        are brought from it into the true one by way of the ego frame.
    """
    plugin = guarded(tracker, lambda: TRACKERS.make(tracker))
    poses = [t.world_from_ego for t in perceived.truths] if told is None else told
    believed = perceived.truths if told is None else _elsewhere(perceived.truths, told)
    guarded(tracker, methodcaller("reset"), plugin)
    followed, history, calls_ms = [], [], []
    velocities = ego_velocities(believed)
    for detections, truth, pose, there, motion in zip(
        perceived.detections, perceived.truths, poses, believed, velocities, strict=True
    ):
        seen = _in_ego(detections, truth)
        tracks, took_ms = timed(tracker, methodcaller("update", seen, pose), plugin)
        followed.append(_world_tracks(tracker, tracks, there, motion, unsure))
        history.append(tracks)
        calls_ms.append(took_ms)
    if not (offline(tracker) and isinstance(plugin, OfflineTracker)):
        return _back(followed, perceived.truths, believed), np.array(calls_ms)
    anew, took_ms = timed(tracker, methodcaller("rescored", tuple(history)), plugin)
    if not isinstance(anew, Sequence) or len(anew) != len(history):
        found = len(anew) if isinstance(anew, Sequence) else type(anew).__name__
        raise EntryError(f"{tracker}: rescored returned {found} for {len(history)} records")
    whole = [
        _world_tracks(tracker, tracks, there, motion, unsure)
        for tracks, there, motion in zip(anew, believed, velocities, strict=True)
    ]
    share_ms = took_ms / max(len(whole), 1)
    return _back(whole, perceived.truths, believed), np.array(calls_ms) + share_ms


def offline(tracker: str) -> bool:
    """Say whether what a tracker is scored by was told with all frames at hand."""
    return is_offline(TRACKERS.resolve(tracker).factory)


def weighed(tracker: str) -> bool:
    """Say whether scores of a tracker's tentative tracks mean something."""
    return is_weighed(TRACKERS.resolve(tracker).factory)


def ego_velocities(truths: Sequence[Truth]) -> np.ndarray:
    """Return (T, 3) velocity in x and y, m/s, world frame, and yaw rate, rad/s, of the ego."""
    if len(truths) < 2:
        return np.zeros((len(truths), 3))
    stamps = np.array([t.stamp_s for t in truths])
    poses = [t.world_from_ego for t in truths]
    track = np.column_stack([[p.translation[:2] for p in poses], np.unwrap([p.yaw for p in poses])])
    rates: np.ndarray = np.gradient(track, stamps, axis=0)
    return rates


def guarded(spec: str, call: Callable[..., T], *arguments: Any) -> T:
    """Call a plug-in; whatever it raises becomes an `EntryError` that says what and where.

    What is not installed needs no place.
    """
    try:
        return call(*arguments)
    except NotInstalledError as error:
        raise EntryError(f"{spec}: {error}") from error
    except (Exception, SystemExit) as error:
        raise EntryError(f"{spec}: {describe(error, in_plugin=True)}") from error


@contextmanager
def prints_aside() -> Iterator[None]:
    """Send what plug-ins print to stderr: stdout is for results."""
    with redirect_stdout(sys.stderr):
        yield


def timed(spec: str, call: Callable[..., T], *arguments: Any) -> tuple[T, float]:
    """Call a plug-in and return what it gave and how many milliseconds it took."""
    start = perf_counter()
    result = guarded(spec, call, *arguments)
    return result, (perf_counter() - start) * 1e3


def describe(error: BaseException, *, in_plugin: bool = False) -> str:
    """Say in one line what was raised and where.

    in_plugin: name the last line within the plug-in's own file, not within what it calls.
    """
    frames = traceback.extract_tb(error.__traceback__)
    foreign = [f.filename for f in frames if not Path(f.filename).is_relative_to(PACKAGE)]
    if in_plugin and foreign:
        frames = traceback.StackSummary(f for f in frames if f.filename == foreign[0])
    place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {' '.join(str(error).split())}{place}"


def _warmed_up(
    detector: str, frames: Iterator[tuple[Frame, Truth]]
) -> Iterator[tuple[Frame, Truth]]:
    """Let an instance that is thrown away see the first frames, then yield all of them.

    Our detectors are compiled when they are first called, and then no call of theirs that is
    timed pays for it. It is done once in a process, again until something was detected. Others
    are not called more often than they are asked; of theirs the first call is not counted.
    """
    if made_from_truth(detector) or detector in _WARM:
        return frames
    if not DETECTORS.resolve(detector).ours:
        return frames
    first = list(islice(frames, WARM_FRAMES))
    plugin = guarded(detector, lambda: DETECTORS.make(detector))
    found = [guarded(detector, plugin.detect, frame) for frame, _ in first]
    if any(len(detections) for detections in found):
        _WARM.add(detector)
    return chain(first, frames)


def _detect(
    detector: str, episode: Episode, eligibility: Eligibility
) -> Callable[[Frame, Truth], tuple[Any, float]]:
    """Return what a frame is given to: what the plug-in answers, and how many ms it took."""
    if made_from_truth(detector):
        make = from_truth(detector, episode, eligibility)
        return lambda _, truth: (make(truth), 0.0)
    plugin = guarded(detector, lambda: DETECTORS.make(detector))
    guarded(detector, methodcaller("reset"), plugin)
    return lambda frame, _: timed(detector, methodcaller("detect", frame), plugin)


def _file(spec: str, found: Any, answers: list[Answer | None], truths: Sequence[Truth]) -> None:
    """Put an answer in the place of its frame, one of those so far.

    An empty one leaves its frame open: a detector that answers late has nothing to say yet.
    """
    if not isinstance(found, Detections):
        raise EntryError(f"{spec}: detect returned {type(found).__name__}, not Detections")
    row, now_s = _frame_of(spec, found.stamp_s, truths), truths[-1].stamp_s
    before = answers[row]
    if before is not None and len(before.detections):
        raise EntryError(
            f"{spec}: two answers for the frame at {round(truths[row].stamp_s, 6)} s, "
            f"the second in the frame at {now_s} s"
        )
    answers[row] = Answer(_world_detections(spec, found, truths[row]), now_s - truths[row].stamp_s)


def _frame_of(spec: str, stamp_s: float, truths: Sequence[Truth]) -> int:
    """Return which frame so far, the last ones first, bears a stamp."""
    for row in reversed(range(len(truths))):
        if abs(stamp_s - truths[row].stamp_s) <= STAMP_TOLERANCE_S:
            return row
    raise EntryError(
        f"{spec}: detections are stamped {round(stamp_s, 6)} s, their frame is at "
        f"{round(truths[-1].stamp_s, 6)} s and no earlier one bears that stamp"
    )


def _in_ego(detections: Detections, truth: Truth) -> Detections:
    """Bring detections into the ego frame; recorded ones are in it and stay as they are."""
    if detections.frame == "ego":
        return detections
    return detections.moved(truth.world_from_ego.inverse(), "ego")


def _world_detections(spec: str, found: Detections, truth: Truth) -> Detections:
    if found.frame == "ego":
        return found.moved(truth.world_from_ego, "world")
    if found.frame != "world":
        raise EntryError(f"{spec}: detections in frame '{found.frame}'; possible: ego, world")
    return found


def _world_tracks(spec: str, tracks: Any, truth: Truth, motion: np.ndarray, unsure: bool) -> Tracks:
    """Bring tracks into the world frame and leave tentative ones out, unless they are wanted.

    motion: (3,) velocity and yaw rate of the ego, which tracks in its frame are relative to.
    """
    if not isinstance(tracks, Tracks):
        raise EntryError(f"{spec}: update returned {type(tracks).__name__}, not Tracks")
    _same_moment(spec, "tracks", tracks.stamp_s, truth.stamp_s)
    if tracks.frame not in ("ego", "world"):
        raise EntryError(f"{spec}: tracks in frame '{tracks.frame}'; possible: ego, world")
    wanted = tracks if unsure else tracks.sure
    if wanted.frame == "world":
        return wanted
    moved = wanted.moved(truth.world_from_ego, "world")
    lever = moved.centres[:, :2] - truth.world_from_ego.translation[:2]
    turning = motion[2] * np.column_stack([-lever[:, 1], lever[:, 0]])
    return replace(moved, velocities=moved.velocities + motion[:2] + turning)


def _elsewhere(truths: Sequence[Truth], told: Sequence[Pose | None]) -> list[Truth]:
    """Put the ego where it is told to be."""
    return [
        replace(truth, world_from_ego=Pose.identity() if pose is None else pose)
        for truth, pose in zip(truths, told, strict=True)
    ]


def _back(
    followed: list[Tracks], truths: Sequence[Truth], believed: Sequence[Truth]
) -> list[Tracks]:
    """Bring tracks from the world of told poses into the true one, each frame by its own poses."""
    if believed is truths:
        return followed
    return [
        tracks.moved(truth.world_from_ego @ there.world_from_ego.inverse(), "world")
        for tracks, truth, there in zip(followed, truths, believed, strict=True)
    ]


def _same_moment(spec: str, what: str, stamp_s: float, frame_s: float) -> None:
    if not abs(stamp_s - frame_s) <= STAMP_TOLERANCE_S:
        raise EntryError(
            f"{spec}: {what} are stamped {round(stamp_s, 6)} s, their frame is at "
            f"{round(frame_s, 6)} s"
        )
