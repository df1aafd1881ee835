"""The tracks of a tracker, from detections and the ego's poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.isolation import PluginHandle, Timed
from roadscope.benchmarks.kinds import TRACKER, traits_of
from roadscope.benchmarks.loop import AnswerCheck, CallInput, RunOptions, checked, run_plugin
from roadscope.benchmarks.nodes.poses import PoseNode, start_from_ego
from roadscope.benchmarks.records import EpisodeDetections, EpisodePoses, EpisodeTracks
from roadscope.core import Detections, Pose, Spec, Tracks
from roadscope.core.answers import check_rescored


@dataclass(frozen=True)
class TrackNode(Node):
    """The tracks of a tracker in frame `world`.

    The tracker gets detections in frame `ego`, whatever the source of its poses. It tracks in the
    world frame of these poses. That of an odometry begins in the first ego frame and drifts.
    Without poses, the tracker tracks in frame `ego`. Its tracks are moved into the ego frame by the
    pose that it got, and from there into the true world by the true pose. So slow drift costs
    little, but a jump of the poses costs tracks.

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
        poses = None if self.ego is None else self.ego.read(options)
        return self.track(self.detections.read(options), poses, options)

    def track(
        self, detections: EpisodeDetections, poses: EpisodePoses | None, options: RunOptions
    ) -> EpisodeTracks:
        """Run the tracker over detections. poses: the content of `ego`."""
        if self.least_score:
            likely = [d.select(d.scores >= self.least_score) for d in detections.detections]
            detections = replace(detections, detections=tuple(likely))
        ego_poses: Sequence[Pose | None] | None = None
        if not self.posed:
            ego_poses = [None] * len(detections.truths)
        elif self.ego is not None and poses is not None:
            stamps_s = [truth.stamp_s for truth in detections.truths]
            ego_poses = start_from_ego(poses, self.ego.episode, stamps_s)
        return track(
            self.tracker, detections, poses=ego_poses, tentative=self.tentative, options=options
        )


@dataclass(frozen=True, slots=True)
class _Ego:
    """The ego at one frame, in the world frame in which the tracker tracks.

    world_from_ego: the pose that the tracker gets; the identity if it gets none.
    motion: (3,) velocity in x and y, m/s, and yaw rate, rad/s.
    """

    world_from_ego: Pose
    motion: np.ndarray

    def in_world(self, tracks: Tracks) -> Tracks:
        """Return tracks in that world frame.

        Velocities in frame `ego` are relative to the ego: its own velocity at the track's centre,
        as that of a rigid body, is added.
        """
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
    tracker_poses = true_poses if poses is None else list(poses)
    world_from_egos = [Pose.identity() if pose is None else pose for pose in tracker_poses]
    egos = list(map(_Ego, world_from_egos, ego_motions(stamps_s, world_from_egos)))
    check_answer = AnswerCheck(TRACKER.name)
    history: list[Tracks] = []

    def calls() -> Iterator[CallInput[None]]:
        frames = zip(inputs.detections, true_poses, tracker_poses, strict=True)
        for detections, true_pose, pose in frames:
            yield CallInput((_in_ego(detections, true_pose), pose), None)

    def check(answer: Any, call_input: CallInput[None]) -> Tracks:
        checked_tracks: Tracks = check_answer(answer, call_input)
        history.append(checked_tracks)
        return checked_tracks

    def rescore(plugin: PluginHandle) -> Timed:
        timed = plugin.call("rescored", tuple(history))
        posed = [pose is not None for pose in tracker_poses]
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
        # From the tracker's world into the ego frame, and on into the true world.
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


def _in_ego(detections: Detections, world_from_ego: Pose) -> Detections:
    """Return detections in frame `ego`; recorded ones are in it already."""
    if detections.frame == "ego":
        return detections
    return detections.moved(world_from_ego.inverse(), "ego")
