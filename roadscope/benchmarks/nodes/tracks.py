"""Tracks: a tracker's, from detections and the ego's poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.isolation import PluginError, PluginHandle, Timed
from roadscope.benchmarks.kinds import TRACKER, traits_of
from roadscope.benchmarks.loop import CallInput, RunOptions, run_plugin
from roadscope.benchmarks.nodes.poses import PoseNode, start_from_ego
from roadscope.benchmarks.records import EpisodeDetections, EpisodeTracks
from roadscope.core import Detections, Pose, Spec, Tracks, Truth
from roadscope.core.answers import AnswerError, check_rescored, check_tracks


@dataclass(frozen=True)
class TrackNode(Node):
    """The tracks of a tracker in frame `world`.

    Detections are the same wherever the poses come from: they reach the tracker in frame `ego`. The
    tracker lives in the world of the poses that it gets: that of an odometry begins in the first
    ego frame and drifts; without poses it lives in the ego frame. Its tracks go into the ego
    frame by the pose that it got, and from there into the true world by the true pose. So slow
    drift costs little, and a jump of the poses costs tracks.

    tracker: its resolved spec. detections: the node whose detections it gets.
    ego: the node of the poses that it gets; None: the true ones.
    posed: False: it gets no poses.
    tentative: keep tentative tracks too.
    """

    tracker: Spec
    detections: Node
    ego: PoseNode | None = None
    posed: bool = True
    tentative: bool = False

    stage = "tracks"
    folder = "tracks"
    record = EpisodeTracks

    def compute(self, options: RunOptions) -> EpisodeTracks:
        """Run the tracker over the detections of an episode."""
        detections: EpisodeDetections = self.detections.read(options)
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
class _Placed:
    """A frame with the ego where the tracker believes it.

    posed: whether the tracker gets the pose. motion: (3,) velocity in x and y, m/s, and yaw rate,
    rad/s, of the ego in the believed world.
    """

    believed: Truth
    posed: bool
    motion: np.ndarray


def track(
    tracker: Spec,
    inputs: EpisodeDetections,
    *,
    poses: Sequence[Pose | None] | None = None,
    tentative: bool = False,
    options: RunOptions | None = None,
) -> EpisodeTracks:
    """Run a tracker over an episode's detections and return its tracks in frame `world`.

    Of an offline tracker they are what it answered after the last frame; every call has its
    share of the time of that.

    poses: what the tracker gets in place of the true poses, None where it gets none.
    tentative: keep tentative tracks too.
    """
    truths = inputs.truths
    ego_poses = [t.world_from_ego for t in truths] if poses is None else list(poses)
    believed = truths if poses is None else _elsewhere(truths, ego_poses)
    motions = ego_motions(believed)
    placed = [
        _Placed(place, pose is not None, motion)
        for place, pose, motion in zip(believed, ego_poses, motions, strict=True)
    ]
    history: list[Tracks] = []

    def calls() -> Iterator[CallInput[_Placed]]:
        for detections, truth, pose, place in zip(
            inputs.detections, truths, ego_poses, placed, strict=True
        ):
            yield CallInput((_in_ego(detections, truth), pose), place)

    def check(answer: Any, call_input: CallInput[_Placed]) -> Tracks:
        place = call_input.context
        tracks = check_tracks(answer, stamp_s=place.believed.stamp_s, posed=place.posed)
        history.append(tracks)
        return tracks

    def rescore(plugin: PluginHandle) -> Timed:
        timed = plugin.call("rescored", tuple(history))
        stamps_s = [place.believed.stamp_s for place in placed]
        try:
            answer = check_rescored(
                timed.answer, stamps_s=stamps_s, posed=[place.posed for place in placed]
            )
        except AnswerError as error:
            raise PluginError(str(tracker.plain), str(error)) from error
        return replace(timed, answer=answer)

    finish = rescore if is_offline(tracker) else None
    replies = run_plugin(tracker, TRACKER, calls(), check, finish=finish, options=options)
    answers = replies.last if finish is not None else replies.answers
    in_believed = [
        _in_world(tracks if tentative else tracks.sure, place)
        for tracks, place in zip(answers, placed, strict=True)
    ]
    return EpisodeTracks(tuple(_in_true_world(in_believed, truths, believed)), replies.times)


def is_offline(tracker: Spec) -> bool:
    """Return whether a tracker answers again when all frames are known, and is scored by that."""
    traits = traits_of(tracker)
    return traits.offline and "rescored" in traits.methods


def scores_tentative_tracks(tracker: Spec) -> bool:
    """Return whether the scores of a tracker's tentative tracks mean something."""
    return traits_of(tracker).weighed


def ego_motions(truths: Sequence[Truth]) -> np.ndarray:
    """Return (T, 3) velocity in x and y, m/s, frame `world`, and yaw rate, rad/s, of the ego."""
    if len(truths) < 2:
        return np.zeros((len(truths), 3))
    stamps = np.array([t.stamp_s for t in truths])
    poses = [t.world_from_ego for t in truths]
    states = np.column_stack(
        [[p.translation[:2] for p in poses], np.unwrap([p.yaw for p in poses])]
    )
    rates: np.ndarray = np.gradient(states, stamps, axis=0)
    return rates


def _elsewhere(truths: Sequence[Truth], poses: Sequence[Pose | None]) -> tuple[Truth, ...]:
    """Put the ego where a tracker believes it; without a pose at the origin."""
    return tuple(
        replace(truth, world_from_ego=Pose.identity() if pose is None else pose)
        for truth, pose in zip(truths, poses, strict=True)
    )


def _in_ego(detections: Detections, truth: Truth) -> Detections:
    """Express detections in frame `ego`; recorded ones are in it already."""
    if detections.frame == "ego":
        return detections
    return detections.moved(truth.world_from_ego.inverse(), "ego")


def _in_world(tracks: Tracks, place: _Placed) -> Tracks:
    """Express tracks in the believed world; those in frame `ego` are relative to its motion."""
    if tracks.frame == "world":
        return tracks
    pose = place.believed.world_from_ego
    moved = tracks.moved(pose, "world")
    lever = moved.centres[:, :2] - pose.translation[:2]
    turning = place.motion[2] * np.column_stack([-lever[:, 1], lever[:, 0]])
    return replace(moved, velocities=moved.velocities + place.motion[:2] + turning)


def _in_true_world(
    tracks: list[Tracks], truths: Sequence[Truth], believed: Sequence[Truth]
) -> list[Tracks]:
    """Bring tracks from the believed world into the true one, each frame by its own poses."""
    if believed is truths:
        return tracks
    return [
        each.moved(truth.world_from_ego @ other.world_from_ego.inverse(), "world")
        for each, truth, other in zip(tracks, truths, believed, strict=True)
    ]
