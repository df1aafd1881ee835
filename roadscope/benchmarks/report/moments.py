"""The worst moments of entries, for a replay: truth, answers and what was wrong.

They are chosen by the scores of a run and read from its kept files; no plug-in runs again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from itertools import zip_longest
from typing import Any

import numpy as np
from PIL import Image

from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.boards.driving import drive_of
from roadscope.benchmarks.cache import read_kept
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.images import camera_of, pictures, projection_of
from roadscope.benchmarks.metrics.detection import GATE_M
from roadscope.benchmarks.metrics.driving import (
    NEAR_MISS_S,
    ScoredDrive,
    near_misses,
    phantom_braking,
    times_to_collision,
)
from roadscope.benchmarks.metrics.trajectory_errors import absolute_errors, aligned, relative_errors
from roadscope.benchmarks.nodes.drives import EpisodeDrive
from roadscope.benchmarks.nodes.fusions import FusionNode
from roadscope.benchmarks.nodes.images import extinction_per_m
from roadscope.benchmarks.nodes.tracks import TrackNode
from roadscope.benchmarks.nodes.tuned import TunedNode
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.records import (
    EpisodeDetections,
    EpisodeFusions,
    EpisodeImageDetections,
    EpisodePoses,
    EpisodeTracks,
)
from roadscope.benchmarks.report.judged_scenes import (
    ALARMS,
    MISSES,
    SWITCHES,
    JudgedFrames,
    JudgedImages,
    JudgedScene,
    judged_fusions,
    judged_images,
    judged_scene,
)
from roadscope.benchmarks.report.replay_records import (
    AROUND_S,
    DECIMETRES,
    MOST_BOXES,
    FrameBoxes,
    MovingBox,
    ReplayMoment,
    boxes_of,
    category_names,
    focus_on,
    lanes_of,
    motion_of,
    moved_into,
    named,
    near_lanes,
    planar,
    series_of,
)
from roadscope.benchmarks.results import JobScores, Results
from roadscope.core import Category, Detections, RecordError
from roadscope.envs.sensors.rigs import rig

DRIFT, JUMP = "drift", "jump"
COLLISION, NEAR_MISS, PHANTOM = "collision", "near miss", "phantom braking"
MOST_FRAMES_AROUND = 30
"""Most frames of a moment before its event, or after it; chosen by hand."""
SUMMED_FRAMES = 5
"""Frames over which misses and false alarms are summed to find where most are; chosen by hand."""
MOST_OF_A_KIND = 2
"""Most moments of one kind in an episode; chosen by hand."""
JUMP_FRAMES = 10
"""Poses on either side of a jump that are all replayed; chosen by hand."""
MOST_POSES = 240
"""Most poses of a replayed trajectory, beside those around its jump."""
NEAR_M = 45.0
"""The ego is in the first view if something that went wrong is nearer to it; chosen by hand."""
REACH_M = 40.0
"""How far from the ego road users and tracks are shown, about twice the first view; chosen by hand.
"""
MARKER_AHEAD_M = 1.45
"""How far the middle of the ego, as the page draws it, is ahead of its pose: the rear axle."""
IMAGE_WIDTH_PX, JPEG_QUALITY = 400, 40
"""Width and quality of the images of a moment, about 9 kB each; chosen by hand."""
LEAST_VIEW = 0.5
"""Share of the image's width and height that is in the first view at least; chosen by hand."""

SEVERITIES: Mapping[type, Mapping[str, str]] = {
    EpisodeTracks: {SWITCHES: "id_switches", MISSES: "recall", ALARMS: "precision"},
    EpisodeDetections: {MISSES: "detection_rate", ALARMS: "precision"},
    EpisodeFusions: {MISSES: "detection_rate", ALARMS: "precision"},
    EpisodeImageDetections: {MISSES: "detection_rate", ALARMS: "false_alarms"},
    EpisodePoses: {DRIFT: "end", JUMP: "rpe"},
    EpisodeDrive: {COLLISION: "collided", NEAR_MISS: "near_misses", PHANTOM: "phantom_braking"},
}
"""For each record of answers: the kinds of moments, each with the metric of how bad it is."""


def worst_moments(
    jobs: Sequence[Job], results: Results, progress: Progress = silent
) -> list[ReplayMoment]:
    """Return moments of each ranked entry, the worst ones of all entries first.

    Moments of a kind are from the entry's episode with the worst score of it; those of collisions
    are from all. Marks have moments of drives only. Answers that are not kept, or that cannot be
    read, have none.

    jobs: those of the results, in the same order.
    """
    of_entry: dict[tuple[str, str], list[tuple[Job, JobScores]]] = {}
    for job, scored in zip(jobs, results.jobs, strict=True):
        record = job.answers.record
        shown = job.mark is None or record is EpisodeDrive
        replayable = record in SEVERITIES and not board_named(job.board.name).without_replay
        if scored.reason is None and shown and replayable:
            of_entry.setdefault((job.board.name, job.entry), []).append((job, scored))
    queues: list[list[ReplayMoment]] = []
    for done, pairs in enumerate(of_entry.values(), start=1):
        first_job, _ = pairs[0]
        for kind, metric in SEVERITIES[first_job.answers.record].items():
            worst = _worst(pairs, kind, metric)
            queues.append([moment for job in worst for moment in _read(job, kind)])
        progress("worst moments", done, len(of_entry))
    # The first moments of all queues, then the second ones.
    turns = zip_longest(*queues)
    return [moment for turn in turns for moment in turn if moment is not None]


def _worst(pairs: Sequence[tuple[Job, JobScores]], kind: str, metric: str) -> list[Job]:
    """Return the job with the worst score, if it is not perfect; of collisions, all jobs."""
    scores = [scored.scores[metric] for _, scored in pairs]
    if kind in (MISSES, ALARMS):
        # The metric is a mean of `n` samples: how many failures there are in all.
        severities = [
            (score.value if score.better == "lower" else 1.0 - score.value) * score.n
            for score in scores
        ]
    else:
        severities = [score.value for score in scores]
    severities = np.nan_to_num(severities, nan=0.0).tolist()
    worst = [job for (job, _), severity in zip(pairs, severities, strict=True) if severity > 0]
    if kind == COLLISION:
        return worst
    return [pairs[int(np.argmax(severities))][0]] if worst else []


def _read(job: Job, kind: str) -> list[ReplayMoment]:
    """Return the moments of one job from its kept files; none if one is missing or damaged."""
    try:
        answers = read_kept(job.answers.path, job.answers.record.load)
        if isinstance(answers, EpisodePoses):
            return _of_poses(job, kind, answers)
        if isinstance(answers, EpisodeDrive):
            return _of_drive(job, kind, answers)
        judged = _judged(job, answers)
    except (OSError, RecordError):
        return []
    return [_of_frames(job, kind, judged, event) for event in _events(judged, kind)]


def _judged(job: Job, answers: Any) -> JudgedFrames:
    """Return the answers of a job with what was right and wrong; read what they are made from."""
    assert isinstance(job.episode, Episode)
    if isinstance(answers, EpisodeImageDetections):
        return judged_images(answers, extinction_per_m(job.episode))
    if isinstance(job.answers, FusionNode):
        lidar, camera = job.answers.lidar, job.answers.camera
        return judged_fusions(
            answers,
            read_kept(lidar.path, lidar.record.load),
            read_kept(camera.path, camera.record.load),
            projection_of(rig(job.episode.rig)),
        )
    inputs = answers
    if isinstance(job.answers, TrackNode | TunedNode):
        source = job.answers.detections
        inputs = read_kept(source.path, source.record.load)
    assert isinstance(job.settings, Eligibility)
    return judged_scene(answers, inputs, job.settings)


# --------------------------------------------------------------------------------------------------
# Detections, tracks, fused detections, and detections in images.


def _events(judged: JudgedFrames, kind: str) -> list[int]:
    """Return the frames in which most goes wrong, some seconds apart, the worst one first."""
    counts, times_s = judged.counts(kind), judged.times_s
    sums = counts
    if kind != SWITCHES:
        # The mode "same" of NumPy returns more than there is of an episode of few frames.
        sums = np.convolve(counts, np.ones(SUMMED_FRAMES))[SUMMED_FRAMES // 2 :][: len(counts)]
    sums = np.where(counts > 0, sums, 0)
    events: list[int] = []
    while len(events) < MOST_OF_A_KIND and sums.max(initial=0) > 0:
        events.append(int(np.argmax(sums)))
        sums = np.where(abs(times_s - times_s[events[-1]]) > 2 * AROUND_S, sums, 0)
    return events


def _of_frames(job: Job, kind: str, judged: JudgedFrames, event: int) -> ReplayMoment:
    """Return the moment around an event. event: number of its frame in the episode."""
    times_s = judged.times_s
    near = np.flatnonzero(abs(times_s - times_s[event]) <= AROUND_S + 1e-9)
    frames: list[int] = near[abs(near - event) <= MOST_FRAMES_AROUND].tolist()
    if isinstance(judged, JudgedImages):
        shown = _in_images(job, kind, judged, frames, event)
    else:
        assert isinstance(judged, JudgedScene)
        shown = _from_above(job, kind, judged, frames, event)
    return ReplayMoment(
        **named(job),
        kind=kind,
        text=_text(judged, kind, event),
        event=frames.index(event),
        times_s=[round(float(times_s[t]), 2) for t in frames],
        **shown,
    )


def _from_above(
    job: Job, kind: str, scene: JudgedScene, frames: Sequence[int], event: int
) -> dict[str, Any]:
    """Return the fields of a moment that is seen from above."""
    assert isinstance(job.episode, Episode)
    truths = [scene.truths[t] for t in frames]
    origin = planar(scene.truths[event].world_from_ego.matrix[None])[0]
    egos = planar(np.array([truth.world_from_ego.matrix for truth in truths]))
    boxes = (scene.answers if kind == ALARMS else scene.objects)[event]
    wrong = scene.wrong(kind)[event]
    wrong_poses = np.column_stack([boxes.centres[wrong], boxes.yaws[wrong]])
    in_view = moved_into(wrong_poses, origin)[:, :2]
    if np.linalg.norm(in_view, axis=1).min() < NEAR_M:
        ego = np.zeros(2)
        in_view = np.vstack([in_view, ego])

    def series(of_episode: Sequence[FrameBoxes]) -> list[MovingBox]:
        return series_of([of_episode[t] for t in frames], origin, egos, scene.reach_m)

    shown = {
        "ego": motion_of(moved_into(egos, origin)),
        "focus": focus_on(in_view),
        "objects": [
            *series(scene.objects),
            *series_of([scene.parked] * len(frames), origin, egos, scene.reach_m),
        ],
        "answers": [*series(scene.answers), *(series(scene.given) if scene.given else ())],
        "lanes": near_lanes(lanes_of(job.episode), origin, egos, scene.reach_m),
    }
    if scene.images is None:
        return shown
    size_px = _image_size(job.episode)
    images = [int(scene.images.rows[t]) for t in frames]
    in_image = (scene.images.answers if kind == ALARMS else scene.images.objects)[event]
    in_focus = in_image.select(in_image.states == ("f" if kind == ALARMS else "x"))
    return shown | {
        "size_px": tuple(size_px.tolist()),
        "images": _images(job.episode, images),
        "image_focus": _focus_in_image(in_focus, size_px),
        "image_objects": _series_in_images([scene.images.objects[t] for t in frames], size_px),
        "image_answers": _series_in_images([scene.images.answers[t] for t in frames], size_px),
    }


def _in_images(
    job: Job, kind: str, judged: JudgedImages, frames: Sequence[int], event: int
) -> dict[str, Any]:
    """Return the fields of a moment in images."""
    assert isinstance(job.episode, Episode)
    size_px = _image_size(job.episode)
    boxes, wrong = (judged.answers if kind == ALARMS else judged.objects)[event], judged.wrong(kind)
    return {
        "ego": [],
        "focus": _focus_in_image(boxes.select(wrong[event]), size_px),
        "objects": _series_in_images([judged.objects[t] for t in frames], size_px),
        "answers": _series_in_images([judged.answers[t] for t in frames], size_px),
        "size_px": tuple(size_px.tolist()),
        "images": _images(job.episode, [int(judged.rows[t]) for t in frames]),
    }


def _image_size(episode: Episode) -> np.ndarray:
    """Return width and height of the images of an episode."""
    pinhole = camera_of(rig(episode.rig)).spec.pinhole
    return np.array([pinhole.width, pinhole.height])


def _series_in_images(frames: Sequence[FrameBoxes], size_px: np.ndarray) -> list[MovingBox]:
    """Return the boxes of images; where there are too many, those that count and large ones."""
    middles = np.tile(size_px / 2 * (1, -1), (len(frames), 1))
    ranks = [np.lexsort((-boxes.sizes[:, 1], boxes.states == "i")) for boxes in frames]
    shown = [
        boxes.select(np.sort(rank[:MOST_BOXES])) for boxes, rank in zip(frames, ranks, strict=True)
    ]
    return series_of(shown, np.zeros(3), middles, np.inf)


def _focus_in_image(boxes: FrameBoxes, size_px: np.ndarray) -> tuple[int, int, int, int]:
    """Return the centre, half width and half height of a view of boxes; of no box, of all."""
    corners = np.array([[0, -size_px[1]], [size_px[0], 0]])
    if len(boxes.states):
        corners = np.vstack([boxes.centres - boxes.sizes / 2, boxes.centres + boxes.sizes / 2])
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = np.clip(0.75 * (high - low), LEAST_VIEW * size_px / 2, size_px / 2)
    first, last = np.array([0, -size_px[1]]), np.array([size_px[0], 0])
    middle = np.clip((low + high) / 2, first + half, last - half)
    x, y, width, height = np.rint(np.append(middle, half) * DECIMETRES).astype(int).tolist()
    return x, y, width, height


def _images(episode: Episode, rows: Sequence[int]) -> list[bytes]:
    """Draw the images with these numbers again, as small files."""
    files = []
    for picture in pictures(episode, tuple(rows)):
        file, image = BytesIO(), picture.frame.camera
        if image is not None:
            width, height = image.size_px
            size = (IMAGE_WIDTH_PX, round(IMAGE_WIDTH_PX * height / width))
            small = Image.fromarray(image.pixels).resize(size, Image.Resampling.BOX)
            small.save(file, "JPEG", quality=JPEG_QUALITY, optimize=True)
        files.append(file.getvalue())
    return files


def _text(judged: JudgedFrames, kind: str, event: int) -> str:
    """Return what happens in the frame of an event."""
    if kind == SWITCHES:
        assert isinstance(judged, JudgedScene)
        return "; ".join(judged.switches[event])
    objects, answers = judged.objects[event], judged.answers[event]
    rows = np.flatnonzero(judged.wrong(kind)[event])
    if kind == MISSES:
        counted = int((objects.states != "i").sum())
        named = [judged.object_text(event, int(row)) for row in rows[:3]]
        return f"{len(rows)} of {counted} objects are missed: {_listed(named, len(rows))}"
    text = f"{len(rows)} of {len(answers.states)} boxes are false alarms"
    if any(answers.labels):
        return f"{text}: {_listed(answers.labels[rows[:3]].tolist(), len(rows))}"
    gaps = np.linalg.norm(answers.centres[rows][:, None] - objects.centres[None], axis=2)
    nearest = [f"{gap:.1f} m" for gap in gaps.min(axis=1)[:3]] if gaps.size else []
    return f"{text}; the nearest objects are {', '.join(nearest)} away" if nearest else text


def _listed(first: Sequence[str], count: int) -> str:
    """Return the first ones of a list in words, and how many more there are."""
    more = [f"{count - len(first)} more"] if count > len(first) else []
    return "; ".join([*first, *more])


# --------------------------------------------------------------------------------------------------
# Odometry.


def _of_poses(job: Job, kind: str, answers: EpisodePoses) -> list[ReplayMoment]:
    """Return one moment: the whole drive, with the largest jump or the end as its event."""
    trajectories = answers.trajectories
    estimate = planar(aligned(trajectories, "origin"))
    truth = planar(trajectories.truth)
    errors_m = absolute_errors(trajectories, "origin").positions_m
    step_errors_m = relative_errors(trajectories).translations_m
    if not len(step_errors_m):
        return []
    jump = int(np.argmax(step_errors_m)) + 1
    event = jump if kind == JUMP else len(truth) - 1
    spread = np.linspace(0, len(truth) - 1, min(MOST_POSES, len(truth)))
    around_jump = np.arange(max(0, jump - JUMP_FRAMES), min(len(truth), jump + JUMP_FRAMES + 1))
    shown = np.unique(np.concatenate([np.rint(spread).astype(int), around_jump, [event]]))
    origin = truth[0]
    true_path, path = moved_into(truth, origin)[shown], moved_into(estimate, origin)[shown]
    # A drift is seen over the whole path; the view of a jump is of the ego alone.
    paths = np.vstack([true_path[:, :2], path[:, :2]]) - true_path[-1, :2]
    travelled_m = trajectories.distances[-1]
    text = (
        f"from one scan to the next, the estimated motion is {step_errors_m[jump - 1]:.2f} m off"
        if kind == JUMP
        else f"after {travelled_m:.0f} m the estimated position is {errors_m[-1]:.2f} m off"
    )
    moment = ReplayMoment(
        **named(job),
        kind=kind,
        text=text,
        event=int(np.searchsorted(shown, event)),
        times_s=[round(float(t), 2) for t in answers.stamps_s[shown]],
        ego=motion_of(true_path),
        focus=focus_on(paths if kind == DRIFT else np.zeros((1, 2))),
        estimate=motion_of(path),
        errors=[round(100 * float(error)) for error in errors_m[shown]],
    )
    return [moment]


# --------------------------------------------------------------------------------------------------
# Drives: collisions, near misses and braking without reason.


def _of_drive(job: Job, kind: str, answers: EpisodeDrive) -> list[ReplayMoment]:
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
        names = category_names(answers.categories[others])
        objects.append(FrameBoxes(ids, poses[:, :2], sizes, poses[:, 2], object_states, names))
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
