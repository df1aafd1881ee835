"""Moments of a drive: collisions, near misses and braking without reason."""

from __future__ import annotations

import numpy as np

from roadscope.benchmarks.boards.driving import drive_of
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.metrics.detection import GATE_M
from roadscope.benchmarks.metrics.driving import (
    NEAR_MISS_S,
    ScoredDrive,
    near_misses,
    phantom_braking,
    times_to_collision,
)
from roadscope.benchmarks.nodes.drives import EpisodeDrive
from roadscope.benchmarks.report.replay_records import (
    AROUND_S,
    FrameBoxes,
    ReplayMoment,
    boxes_of,
    focus_on,
    lanes_of,
    motion_of,
    moved_into,
    named,
    near_lanes,
    series_of,
)
from roadscope.core import Category, Detections

COLLISION, NEAR_MISS, PHANTOM = "collision", "near miss", "phantom braking"
REACH_M = 40.0
"""How far from the ego road users and tracks are shown, about twice the first view; chosen by hand.
"""
MARKER_AHEAD_M = 1.45
"""How far the middle of the ego, as the page draws it, is ahead of its pose: the rear axle."""


def drive_moments(job: Job, kind: str, answers: EpisodeDrive) -> list[ReplayMoment]:
    """Return one moment: what was true and what the driver believed around an event.

    At the event itself it also has the detections of the last scan.
    """
    assert isinstance(job.episode, Episode)
    is_event = _event_mask(drive_of(answers, answers.end_s), kind)
    if not is_event.any():
        return []
    event = int(np.argmax(is_event))
    near = np.flatnonzero(abs(answers.stamps_s - answers.stamps_s[event]) <= AROUND_S + 1e-9)
    objects, believed = [], []
    for k in near.tolist():
        # Row 0 is the ego.
        others = np.flatnonzero(np.isfinite(answers.poses[k, :, 0]))[1:]
        poses, tracks = answers.poses[k, others], answers.tracks[k]
        gaps_m = np.linalg.norm(poses[:, None, :2] - tracks.centres[None, :, :2], axis=-1)
        object_states = np.where(gaps_m.min(axis=1, initial=np.inf) <= GATE_M, "m", "x")
        track_states = np.where(gaps_m.min(axis=0, initial=np.inf) <= GATE_M, "m", "f")
        ids, sizes = answers.ids[others], answers.sizes[others, :2]
        objects.append(FrameBoxes(ids, poses[:, :2], sizes, poses[:, 2], object_states))
        believed.append(boxes_of(tracks, tracks.ids)._replace(states=track_states))
    origin, egos = answers.poses[event, 0], answers.poses[near, 0]
    # A drive has the poses of box centres. The page gets those of the rear axle, and draws the
    # middle of the ego ahead of them.
    ahead = np.column_stack([np.cos(egos[:, 2]), np.sin(egos[:, 2]), np.zeros(len(egos))])
    before = int(np.searchsorted(near, event))
    scans = [each for each in answers.detected if each.stamp_s <= answers.stamps_s[event]]
    detected = [_detected(Detections.empty(0.0))] * before + list(map(_detected, scans[-1:]))
    moment = ReplayMoment(
        **named(job),
        kind=kind,
        text=_text_of_drive(answers, kind, event),
        event=before,
        times_s=[round(float(t), 2) for t in answers.stamps_s[near]],
        ego=motion_of(moved_into(egos - MARKER_AHEAD_M * ahead, origin)),
        focus=focus_on(np.zeros((1, 2))),
        objects=series_of(objects, origin, egos, REACH_M),
        answers=[
            *series_of(believed, origin, egos, REACH_M),
            *series_of(detected, origin, egos[: len(detected)], REACH_M),
        ],
        lanes=near_lanes(lanes_of(job.episode), origin, egos, REACH_M),
    )
    return [moment]


def _detected(detections: Detections) -> FrameBoxes:
    boxes = boxes_of(detections, np.full(len(detections), -1))
    return boxes._replace(states=np.full(len(detections), "d"))


def _event_mask(drive: ScoredDrive, kind: str) -> np.ndarray:
    """Return (K,) bool: at which instants of a drive something goes wrong."""
    if kind == PHANTOM:
        return phantom_braking(drive)
    if kind == NEAR_MISS:
        return near_misses(drive, times_to_collision(drive))
    # A drive ends with the collision.
    is_last: np.ndarray = np.arange(len(drive.speeds)) == len(drive.speeds) - 1
    return is_last & drive.collided


def _text_of_drive(answers: EpisodeDrive, kind: str, event: int) -> str:
    """Return what happens, and for how long the driver has known the other one of a collision."""
    speed = f"at {answers.speeds[event]:.1f} m/s"
    if kind == PHANTOM:
        due = answers.reference_accelerations[event]
        return (
            f"brakes with {-answers.accelerations[event]:.1f} m/s2 {speed}; on the truth, a driver "
            f"of the simulation would choose {due:.1f} m/s2"
        )
    if kind == NEAR_MISS:
        return f"less than {NEAR_MISS_S:g} s from a collision {speed}"
    if answers.collided_with <= 0:
        return f"collides with an obstacle {speed}"
    row = int(np.flatnonzero(answers.ids == answers.collided_with)[0])
    name = Category(int(answers.categories[row])).name.lower()
    is_tracked = [
        len(tracks) > 0 and np.linalg.norm(tracks.centres[:, :2] - pose[:2], axis=1).min() <= GATE_M
        for tracks, pose in zip(answers.tracks, answers.poses[:, row], strict=True)
    ]
    untracked = np.flatnonzero(~np.array(is_tracked))
    since = int(untracked[-1]) + 1 if len(untracked) else 0
    if since >= len(is_tracked):
        tracked = "which has no track at that time"
    else:
        tracked = f"tracked for the last {answers.stamps_s[-1] - answers.stamps_s[since]:.1f} s"
    sensed = ""
    if answers.sensed:
        truth = answers.sensed[-1]
        rows = np.flatnonzero(truth.ids == answers.collided_with)
        returns = int(truth.lidar_returns[rows].sum())
        places = truth.centres[rows, None, :2] - answers.detected[-1].centres[None, :, :2]
        count = int((np.linalg.norm(places, axis=2) <= GATE_M).sum())
        detections = {0: "no detection", 1: "1 detection"}.get(count, f"{count} detections")
        sensed = f", {returns} returns and {detections} within {GATE_M:g} m in the last scan"
    return f"collides with {name} {answers.collided_with} {speed}, {tracked}{sensed}"
