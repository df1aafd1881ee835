"""Tracks: of a tracker, from detections and the ego's poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.isolation import PluginHandle, Timed
from roadscope.benchmarks.kinds import TRACKER, traits_of
from roadscope.benchmarks.loop import CallInput, RunOptions, checked, run_plugin
from roadscope.benchmarks.nodes.poses import PoseNode, start_from_ego
from roadscope.benchmarks.records import EpisodeDetections, EpisodeTracks
from roadscope.core import Detections, Pose, Spec, Tracks, Truth
from roadscope.core.answers import check_rescored, check_tracks


@dataclass(frozen=True)
class TrackNode(Node):
    """The tracks of a tracker in frame `world`.

    The tracker gets detections in frame `ego`, whatever the source of its poses. It tracks in the
    world frame of these poses: that of an odometry begins in the first ego frame and drifts;
    without poses it is the ego frame. Its tracks are moved into the ego frame by the pose that it
    got, and from there into the true world by the true pose. So slow drift costs little, and a
    jump of the poses costs tracks.

    tracker: its resolved spec. detections: the node whose detections it gets.
    ego: the node of the poses that it gets; None: the true ones.
    posed: whether it gets poses at all.
    tentative: whether tentative tracks are kept.
    least_score: detections with a lower score are left out.
    """

    tracker: Spec
    detections: Node
    ego: PoseNode | None = None
    posed: bool = True
    tentative: bool = False
    least_score: float = 0.0

    stage = "tracks"
    folder = "tracks"
    record = EpisodeTracks

    def compute(self, options: RunOptions) -> EpisodeTracks:
        """Run the tracker over the detections of an episode."""
        detections: EpisodeDetections = self.detections.read(options)
        if self.least_score:
            chosen = [d.select(d.scores >= self.least_score) for d in detections.detections]
            detections = replace(detections, detections=tuple(chosen))
        return track(
            self.tracker,
            detections,
            poses=self._poses(detections.truths, options),
            tentative=self.tentative,
            options=options,
        )

    def _poses(self, truths: Sequence[Truth], options: RunOptions) -> Sequence[Pose | None] | None:
        """Return the poses that the tracker gets, frame by frame; None: the true ones."""
        if not self.posed:
            return [None] * len(truths)
        if self.ego is None:
            return None
        stamps_s = [truth.stamp_s for truth in truths]
        return start_from_ego(self.ego.read(options), self.ego.episode, stamps_s)


@dataclass(frozen=True, slots=True)
class _Ego:
    """The ego at one frame, in the world frame of the tracker.

    world_from_ego: the pose that the tracker gets; the identity if it gets none.
    posed: whether the tracker gets the pose.
    motion: (3,) velocity in x and y, m/s, and yaw rate, rad/s.
    """

    stamp_s: float
    world_from_ego: Pose
    posed: bool
    motion: np.ndarray

    def in_world(self, tracks: Tracks) -> Tracks:
        """Return tracks in that world frame; velocities in frame `ego` are relative to the ego."""
        if tracks.frame == "world":
            return tracks
        moved = tracks.moved(self.world_from_ego, "world")
        lever = moved.centres[:, :2] - self.world_from_ego.translation[:2]
        turning = self.motion[2] * np.column_stack([-lever[:, 1], lever[:, 0]])
        return replace(moved, velocities=moved.velocities + self.motion[:2] + turning)


def track(
    tracker: Spec,
    inputs: EpisodeDetections,
    *,
    poses: Sequence[Pose | None] | None = None,
    tentative: bool = False,
    options: RunOptions | None = None,
) -> EpisodeTracks:
    """Run a tracker over an episode's detections and return its tracks in frame `world`.

    For an offline tracker, these are the tracks that it answers after the last frame; the time of
    that call is shared among all calls.

    poses: that the tracker gets in place of the true poses, None in frames without.
    tentative: whether tentative tracks are kept.
    """
    true_poses = [truth.world_from_ego for truth in inputs.truths]
    stamps_s = [truth.stamp_s for truth in inputs.truths]
    ego_poses = true_poses if poses is None else list(poses)
    egos = _egos(stamps_s, ego_poses)
    history: list[Tracks] = []

    def calls() -> Iterator[CallInput[_Ego]]:
        frames = zip(inputs.detections, true_poses, ego_poses, egos, strict=True)
        for detections, true_pose, pose, ego in frames:
            yield CallInput((_in_ego(detections, true_pose), pose), ego)

    def check(answer: Any, call_input: CallInput[_Ego]) -> Tracks:
        ego = call_input.context
        history.append(check_tracks(answer, stamp_s=ego.stamp_s, posed=ego.posed))
        return history[-1]

    def rescore(plugin: PluginHandle) -> Timed:
        timed = plugin.call("rescored", tuple(history))
        posed = [ego.posed for ego in egos]
        check_all = partial(check_rescored, stamps_s=stamps_s, posed=posed)
        return replace(timed, answer=checked(tracker, check_all, timed.answer))

    finish = rescore if is_offline(tracker) else None
    replies = run_plugin(tracker, TRACKER, calls(), check, finish=finish, options=options)
    answers = replies.last if finish is not None else replies.answers
    tracks = [
        ego.in_world(answer if tentative else answer.sure)
        for answer, ego in zip(answers, egos, strict=True)
    ]
    if poses is not None:
        tracks = [
            each.moved(true_pose @ ego.world_from_ego.inverse(), "world")
            for each, true_pose, ego in zip(tracks, true_poses, egos, strict=True)
        ]
    return EpisodeTracks(tuple(tracks), replies.times)


def is_offline(tracker: Spec) -> bool:
    """Return whether a tracker is scored by the tracks that it answers after the last frame."""
    traits = traits_of(tracker)
    return traits.offline and "rescored" in traits.methods


def scores_tentative_tracks(tracker: Spec) -> bool:
    """Return whether a tracker gives meaningful scores to its tentative tracks."""
    return traits_of(tracker).weighed


def ego_motions(stamps_s: Sequence[float], poses: Sequence[Pose]) -> np.ndarray:
    """Return (T, 3) velocity in x and y, m/s, frame `world`, and yaw rate, rad/s, of the ego."""
    if len(poses) < 2:
        return np.zeros((len(poses), 3))
    states = np.column_stack(
        [[p.translation[:2] for p in poses], np.unwrap([p.yaw for p in poses])]
    )
    rates: np.ndarray = np.gradient(states, np.array(stamps_s), axis=0)
    return rates


def _egos(stamps_s: Sequence[float], poses: Sequence[Pose | None]) -> list[_Ego]:
    """Return the ego at each frame. poses: None where the tracker gets no pose."""
    believed = [
        Pose.identity() if pose is None else pose for _, pose in zip(stamps_s, poses, strict=True)
    ]
    posed = [pose is not None for pose in poses]
    return list(map(_Ego, stamps_s, believed, posed, ego_motions(stamps_s, believed)))


def _in_ego(detections: Detections, world_from_ego: Pose) -> Detections:
    """Return detections in frame `ego`; recorded ones are in it already."""
    if detections.frame == "ego":
        return detections
    return detections.moved(world_from_ego.inverse(), "ego")
