"""The worst moments of entries, for a bird's-eye replay: truth, answers and what was wrong.

They are chosen by the scores of a run and read from its kept files; no plug-in runs again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any, NamedTuple

import msgspec
import numpy as np

from roadscope.benchmarks.boards.driving import drive_of
from roadscope.benchmarks.cache import read_kept
from roadscope.benchmarks.eligibility import Eligibility
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
from roadscope.benchmarks.metrics.matching import Pairing, match
from roadscope.benchmarks.metrics.tracking.clear import switched
from roadscope.benchmarks.metrics.tracking.matching import match_tracks
from roadscope.benchmarks.metrics.tracking.scores import (
    counted_rows,
    counted_sequence,
    matched_rows,
)
from roadscope.benchmarks.metrics.trajectory_errors import absolute_errors, aligned, relative_errors
from roadscope.benchmarks.nodes.drives import EpisodeDrive
from roadscope.benchmarks.nodes.tracks import TrackNode
from roadscope.benchmarks.nodes.traffic import TrafficNode
from roadscope.benchmarks.nodes.tuned import TunedNode
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.records import EpisodeDetections, EpisodePoses, EpisodeTracks
from roadscope.benchmarks.results import JobScores, Results
from roadscope.core import Category, Detections, RecordError, Tracks, Truth

SWITCHES, MISSES, ALARMS = "identity switches", "misses", "false alarms"
DRIFT, JUMP = "drift", "jump"
COLLISION, NEAR_MISS, PHANTOM = "collision", "near miss", "phantom braking"
AROUND_S, MOST_FRAMES_AROUND = 2.0, 30
"""Length of a moment before its event and after it, and most frames of either; chosen by hand."""
SUMMED_FRAMES = 5
"""Frames over which misses and false alarms are summed to find where most are; chosen by hand."""
MOST_OF_A_KIND = 2
"""Most moments of one kind for an entry; chosen by hand."""
JUMP_FRAMES = 10
"""Poses on either side of a jump that are all replayed; chosen by hand."""
MOST_BOXES = 60
"""Most objects, and most boxes of an entry, in a frame: those nearest to the ego."""
MOST_POSES = 240
"""Most poses of a replayed trajectory, beside those around its jump."""
MARGIN_M = 10.0
"""How far objects and lanes are shown beyond the range in which objects are eligible."""
MARKER_AHEAD_M = 1.45
"""How far the middle of the ego, as the page draws it, is ahead of its pose: the rear axle."""
NEAR_M = 45.0
"""The ego is in the first view if something that went wrong is nearer to it; chosen by hand."""
VIEW_MARGIN_M = 12.0
"""Margin of a view around what went wrong; chosen by hand."""
LANE_TOLERANCE_M = 0.15
"""Points of a lane that are nearer than this to its simplified line are left out."""
DECIMETRES, CENTIRADIANS = 10.0, 100.0
"""Decimetres of a metre and hundredths of a radian: the units of files for the page."""


class LaneStrip(msgspec.Struct, frozen=True, array_like=True):
    """A lane: width, decimetres, and x, y of its points, the first one, then differences."""

    width: int
    points: list[int]


class MovingBox(msgspec.Struct, frozen=True, array_like=True):
    """A box over consecutive frames of a moment.

    number: id of an object or track; -1 for a detection. first: its first frame.
    states: a letter for each frame from there on: m matched, x missed, f false alarm, s matched
        after a switch of identities, i does not count, and . absent.
    length, width: decimetres.
    motion: x, y (decimetres) and yaw (0.01 rad) of the first frame, then the differences from each
        frame to the next in which it is present.
    """

    number: int
    first: int
    states: str
    length: int
    width: int
    motion: list[int]


class Moment(msgspec.Struct, frozen=True, kw_only=True):
    """Some seconds of an episode around an event; coordinates are those of the ego at the event.

    kind: such as `misses`. text: what happens. event: number of its frame.
    times_s: of the frames, seconds. ego: its motion, as in `MovingBox`.
    objects, answers: true boxes, and those of the entry.
    estimate: motion of the ego as an odometry estimates it; empty on other boards.
    errors: centimetres from the true position in each frame, for odometries.
    focus: x, y, half length and half width of the first view, decimetres, from the ego.
    """

    board: str
    entry: str
    kind: str
    text: str
    scenario: str
    seed: int
    condition: str
    inputs: str
    event: int
    times_s: list[float]
    ego: list[int]
    focus: tuple[int, int, int, int]
    objects: list[MovingBox] = []
    answers: list[MovingBox] = []
    lanes: list[LaneStrip] = []
    estimate: list[int] = []
    errors: list[int] = []


SEVERITIES: Mapping[type, Mapping[str, str]] = {
    EpisodeTracks: {SWITCHES: "id_switches", MISSES: "recall", ALARMS: "precision"},
    EpisodeDetections: {MISSES: "detection_rate", ALARMS: "precision"},
    EpisodePoses: {DRIFT: "end", JUMP: "rpe"},
    EpisodeDrive: {COLLISION: "collided", NEAR_MISS: "near_misses", PHANTOM: "phantom_braking"},
}
"""For each record of answers: the kinds of moments, each with the metric of how bad it is."""


def worst_moments(
    jobs: Sequence[Job], results: Results, progress: Progress = silent
) -> list[Moment]:
    """Return moments of each ranked entry, the worst ones of all entries first.

    Moments of a kind are from the entry's episode with the worst score of it. Answers that are not
    kept, or that cannot be read, have none.

    jobs: those of the results, in the same order.
    """
    of_entry: dict[tuple[str, str], list[tuple[Job, JobScores]]] = {}
    for job, scored in zip(jobs, results.jobs, strict=True):
        if scored.reason is None and job.mark is None and job.answers.record in SEVERITIES:
            of_entry.setdefault((job.board.name, job.entry), []).append((job, scored))
    queues: list[list[Moment]] = []
    for done, pairs in enumerate(of_entry.values(), start=1):
        first_job, _ = pairs[0]
        for kind, metric in SEVERITIES[first_job.answers.record].items():
            worst_job = _worst(pairs, kind, metric)
            if worst_job is not None:
                queues.append(_read(worst_job, kind))
        progress("worst moments", done, len(of_entry))
    # The first moments of all queues, then the second ones.
    turns = zip_longest(*queues)
    return [moment for turn in turns for moment in turn if moment is not None]


def _worst(pairs: Sequence[tuple[Job, JobScores]], kind: str, metric: str) -> Job | None:
    """Return the job with the worst score; None if all are perfect."""
    scores = [scored.scores[metric] for _, scored in pairs]
    if kind in (MISSES, ALARMS):
        # The metric is a ratio of `n` samples: how many of them are failures.
        severities = [(1.0 - score.value) * score.n for score in scores]
    else:
        severities = [score.value for score in scores]
    severities = np.nan_to_num(severities, nan=0.0).tolist()
    worst = int(np.argmax(severities))
    return pairs[worst][0] if severities[worst] > 0 else None


def _read(job: Job, kind: str) -> list[Moment]:
    """Return the moments of one job from its kept files; none if one is missing or damaged."""
    try:
        answers = read_kept(job.answers.path, job.answers.record.load)
        if isinstance(answers, EpisodePoses):
            return _of_poses(job, kind, answers)
        if isinstance(answers, EpisodeDrive):
            assert isinstance(job.settings, Eligibility)
            return _of_drive(job, kind, answers, job.settings)
        if not isinstance(job.settings, Eligibility):
            return []  # Recorded data are matched by rules of their own.
        inputs = answers
        if isinstance(job.answers, TrackNode | TunedNode):
            source = job.answers.detections
            inputs = read_kept(source.path, source.record.load)
    except (OSError, RecordError):
        return []
    assert isinstance(job.episode, Episode)
    scene, lanes = judged_scene(answers, inputs, job.settings), lanes_of(job.episode)
    return [_of_scene(job, kind, scene, int(event), lanes) for event in _events(scene, kind)]


# --------------------------------------------------------------------------------------------------
# Detections and tracks.


class _Boxes(NamedTuple):
    """The N boxes of a frame from above.

    numbers: (N,). centres, sizes: (N, 2). yaws: (N,).
    states: (N,) letters as in `MovingBox`; they are `i` until the boxes are judged.
    """

    numbers: np.ndarray
    centres: np.ndarray
    sizes: np.ndarray
    yaws: np.ndarray
    states: np.ndarray


@dataclass(frozen=True, slots=True)
class JudgedScene:
    """An episode with what was right and wrong in each frame.

    objects, answers: true boxes, and those of the entry, with their states.
    switches: by frame, texts about switches of identities.
    reach_m: how far from the ego boxes are shown.
    """

    truths: Sequence[Truth]
    objects: Sequence[_Boxes]
    answers: Sequence[_Boxes]
    switches: Mapping[int, Sequence[str]]
    reach_m: float

    def wrong(self, kind: str) -> list[np.ndarray]:
        """Return for each frame (N,) bool: which boxes are wrong, answers for false alarms.

        For switches and misses these are objects.
        """
        boxes = self.answers if kind == ALARMS else self.objects
        letter = {SWITCHES: "s", MISSES: "x", ALARMS: "f"}[kind]
        return [frame.states == letter for frame in boxes]

    def counts(self, kind: str) -> np.ndarray:
        """Return (T,) how often something went wrong in each frame."""
        return np.array([int(rows.sum()) for rows in self.wrong(kind)])

    def hits(self) -> np.ndarray:
        """Return (T,) how many objects were matched in each frame."""
        return np.array([int(np.isin(frame.states, ("m", "s")).sum()) for frame in self.objects])


def judged_scene(
    answers: EpisodeTracks | EpisodeDetections, inputs: EpisodeDetections, rule: Eligibility
) -> JudgedScene:
    """Match answers with the objects of each frame. inputs: with the truth of the frames."""
    truths = inputs.truths
    objects = [_boxes(truth, truth.ids) for truth in truths]
    switches: Mapping[int, Sequence[str]] = {}
    if isinstance(answers, EpisodeTracks):
        pairings = rule.pairings(answers.tracks, truths, inputs.parked)
        boxes = [_boxes(tracks, tracks.ids) for tracks in answers.tracks]
        switches = _judge_tracks(answers.tracks, truths, pairings, objects, boxes)
    else:
        pairings = rule.pairings(answers.detections, truths, inputs.parked)
        boxes = [_boxes(each, np.full(len(each), -1)) for each in answers.detections]
        _judge_detections(pairings, objects, boxes)
    return JudgedScene(truths, objects, boxes, switches, rule.range_m[1] + MARGIN_M)


def _judge_detections(
    pairings: Sequence[Pairing], objects: Sequence[_Boxes], boxes: Sequence[_Boxes]
) -> None:
    """Write the states of the objects and of the detected boxes of each frame."""
    for true, detected, pairing in zip(objects, boxes, pairings, strict=True):
        matching = match(pairing, GATE_M)
        true.states[matching.misses] = "x"
        detected.states[matching.false_alarms] = "f"
        true.states[matching.truth] = "m"
        detected.states[matching.detected] = "m"


def _judge_tracks(
    tracks: Sequence[Tracks],
    truths: Sequence[Truth],
    pairings: Sequence[Pairing],
    objects: Sequence[_Boxes],
    boxes: Sequence[_Boxes],
) -> dict[int, list[str]]:
    """Write the states of the objects and tracks of each frame; return the texts of switches."""
    counted = counted_rows(pairings)
    sequence = counted_sequence(tracks, truths, pairings, counted)
    matched = match_tracks(sequence)
    pairs = matched_rows(sequence, matched, counted)
    is_switch = switched(matched.objects, matched.tracks)
    switches: dict[int, list[str]] = {}
    last_tracks: dict[int, int] = {}
    for k, frame in enumerate(matched.frames.tolist()):
        number = int(sequence.truth_ids[matched.truth_rows[k]])
        track = int(sequence.track_ids[matched.track_rows[k]])
        if is_switch[k]:
            text = f"object {number} goes from track {last_tracks[number]} to track {track}"
            switches.setdefault(frame, []).append(text)
        last_tracks[number] = track
    ends = np.searchsorted(matched.frames, np.arange(len(truths) + 1))
    for t, (frame_counted, pair) in enumerate(zip(counted, pairs, strict=True)):
        objects[t].states[frame_counted.objects] = "x"
        boxes[t].states[frame_counted.tracks] = "f"
        letters = np.where(is_switch[ends[t] : ends[t + 1]], "s", "m")
        objects[t].states[pair.objects] = letters
        boxes[t].states[pair.tracks] = letters
    return switches


def _boxes(record: Truth | Tracks | Detections, numbers: np.ndarray) -> _Boxes:
    """Return the boxes of a record, not yet judged."""
    states = np.full(len(record), "i")
    return _Boxes(numbers, record.centres[:, :2], record.sizes[:, :2], record.yaws, states)


def _events(scene: JudgedScene, kind: str) -> list[int]:
    """Return the frames in which most goes wrong, some seconds apart, the worst one first."""
    counts = scene.counts(kind)
    sums = counts
    if kind != SWITCHES:
        # The mode "same" of NumPy returns more than there is of an episode of few frames.
        sums = np.convolve(counts, np.ones(SUMMED_FRAMES))[SUMMED_FRAMES // 2 :][: len(counts)]
    sums = np.where(counts > 0, sums, 0)
    times_s = np.array([truth.stamp_s for truth in scene.truths])
    events: list[int] = []
    while len(events) < MOST_OF_A_KIND and sums.max(initial=0) > 0:
        events.append(int(np.argmax(sums)))
        sums = np.where(abs(times_s - times_s[events[-1]]) > 2 * AROUND_S, sums, 0)
    return events


def _of_scene(job: Job, kind: str, scene: JudgedScene, event: int, lanes: Sequence[Any]) -> Moment:
    """Return the moment around an event. event: number of its frame in the episode."""
    times_s = np.array([truth.stamp_s for truth in scene.truths])
    near = np.flatnonzero(abs(times_s - times_s[event]) <= AROUND_S + 1e-9)
    frames: list[int] = near[abs(near - event) <= MOST_FRAMES_AROUND].tolist()
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
    return Moment(
        **_named(job),
        kind=kind,
        text=_text(scene, kind, event),
        event=frames.index(event),
        times_s=[round(truth.stamp_s, 2) for truth in truths],
        ego=motion_of(moved_into(egos, origin)),
        focus=focus_on(in_view),
        objects=_series([scene.objects[t] for t in frames], origin, egos, scene.reach_m),
        answers=_series([scene.answers[t] for t in frames], origin, egos, scene.reach_m),
        lanes=near_lanes(lanes, origin, egos, scene.reach_m),
    )


def _named(job: Job) -> dict[str, Any]:
    """Return the fields of a moment that say whose it is."""
    episode = job.episode
    assert isinstance(episode, Episode)
    return {
        "board": job.board.name,
        "entry": job.entry,
        "scenario": episode.scenario,
        "seed": episode.seed,
        "condition": episode.condition,
        "inputs": job.inputs,
    }


def _text(scene: JudgedScene, kind: str, event: int) -> str:
    """Return what happens in the frame of an event."""
    if kind == SWITCHES:
        return "; ".join(scene.switches[event])
    truth, objects = scene.truths[event], scene.objects[event]
    rows = np.flatnonzero(scene.wrong(kind)[event])
    if kind == MISSES:
        counted = int((objects.states != "i").sum())
        named = [_object_text(truth, int(row)) for row in rows[:3]]
        more = [f"{len(rows) - 3} more"] if len(rows) > 3 else []
        return f"{len(rows)} of {counted} objects are missed: {'; '.join([*named, *more])}"
    answers = scene.answers[event]
    gaps = np.linalg.norm(answers.centres[rows][:, None] - objects.centres[None], axis=2)
    nearest = [f"{gap:.1f} m" for gap in gaps.min(axis=1)[:3]] if gaps.size else []
    beside = f"; the nearest objects are {', '.join(nearest)} away" if nearest else ""
    return f"{len(rows)} of {len(answers.states)} boxes are false alarms{beside}"


def _object_text(truth: Truth, row: int) -> str:
    name = Category(int(truth.categories[row])).name.lower()
    away = np.linalg.norm(truth.centres[row, :2] - truth.world_from_ego.translation[:2])
    hidden = f", {100 * truth.occluded_fraction[row]:.0f} % hidden"
    returns = truth.lidar_returns[row]
    return f"{name} {truth.ids[row]} at {away:.0f} m with {returns} returns{hidden}"


def _series(
    frames: Sequence[_Boxes], origin: np.ndarray, egos: np.ndarray, reach_m: float
) -> list[MovingBox]:
    """Join the boxes of frames by their numbers; boxes out of reach of the ego are left out.

    origin: planar pose in whose frame the boxes are shown. egos: those of the ego in each frame.
    """
    series: dict[tuple[int, int], list[_BoxInFrame]] = {}
    for t, (boxes, ego) in enumerate(zip(frames, egos, strict=True)):
        poses = moved_into(np.column_stack([boxes.centres, boxes.yaws]), origin)
        away_m = np.linalg.norm(boxes.centres - ego[:2], axis=1)
        nearest = np.argsort(away_m, kind="stable")[:MOST_BOXES]
        for row in np.sort(nearest[away_m[nearest] <= reach_m]):
            number = max(int(boxes.numbers[row]), -1)
            # A detection has no identity: each is a box of its own.
            key = (number, -1) if number >= 0 else (t, int(row))
            box = _BoxInFrame(t, number, str(boxes.states[row]), poses[row], boxes.sizes[row])
            series.setdefault(key, []).append(box)
    return [_moving_box(each) for each in series.values()]


class _BoxInFrame(NamedTuple):
    """A box in one frame of a moment: its number or -1, state, planar pose, length and width."""

    frame: int
    number: int
    state: str
    pose: np.ndarray
    size: np.ndarray


def _moving_box(boxes: Sequence[_BoxInFrame]) -> MovingBox:
    """Join the boxes of one object, track or detection, in order of frames."""
    first, last = boxes[0].frame, boxes[-1].frame
    states = ["."] * (last - first + 1)
    for box in boxes:
        states[box.frame - first] = box.state
    length, width = np.rint(np.median([box.size for box in boxes], axis=0) * DECIMETRES)
    motion = motion_of(np.array([box.pose for box in boxes]))
    return MovingBox(boxes[0].number, first, "".join(states), int(length), int(width), motion)


# --------------------------------------------------------------------------------------------------
# Drives.


def _of_drive(job: Job, kind: str, answers: EpisodeDrive, rule: Eligibility) -> list[Moment]:
    """Return one moment: what was true and what the driver believed around an event."""
    assert isinstance(job.episode, Episode)
    is_event = _event_mask(drive_of(answers, answers.end_s), kind)
    if not is_event.any():
        return []
    event = int(np.argmax(is_event))
    near = np.flatnonzero(abs(answers.stamps_s - answers.stamps_s[event]) <= AROUND_S + 1e-9)
    reach_m = rule.range_m[1] + MARGIN_M
    objects, believed = [], []
    for k in near.tolist():
        # Row 0 is the ego.
        others = np.flatnonzero(np.isfinite(answers.poses[k, :, 0]))[1:]
        poses, tracks = answers.poses[k, others], answers.tracks[k]
        gaps_m = np.linalg.norm(poses[:, None, :2] - tracks.centres[None, :, :2], axis=-1)
        object_states = np.where(gaps_m.min(axis=1, initial=np.inf) <= GATE_M, "m", "x")
        track_states = np.where(gaps_m.min(axis=0, initial=np.inf) <= GATE_M, "m", "f")
        ids, sizes = answers.ids[others], answers.sizes[others, :2]
        objects.append(_Boxes(ids, poses[:, :2], sizes, poses[:, 2], object_states))
        believed.append(_boxes(tracks, tracks.ids)._replace(states=track_states))
    origin, egos = answers.poses[event, 0], answers.poses[near, 0]
    # A drive has the poses of box centres. The page gets those of the rear axle, and draws the
    # middle of the ego ahead of them.
    ahead = np.column_stack([np.cos(egos[:, 2]), np.sin(egos[:, 2]), np.zeros(len(egos))])
    moment = Moment(
        **_named(job),
        kind=kind,
        text=_text_of_drive(answers, kind, event),
        event=int(np.searchsorted(near, event)),
        times_s=[round(float(t), 2) for t in answers.stamps_s[near]],
        ego=motion_of(moved_into(egos - MARKER_AHEAD_M * ahead, origin)),
        focus=focus_on(np.zeros((1, 2))),
        objects=_series(objects, origin, egos, reach_m),
        answers=_series(believed, origin, egos, reach_m),
        lanes=near_lanes(lanes_of(job.episode), origin, egos, reach_m),
    )
    return [moment]


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
        sensed = f", {returns} returns in the last scan"
    return f"collides with {name} {answers.collided_with} {speed}, {tracked}{sensed}"


# --------------------------------------------------------------------------------------------------
# Odometry.


def _of_poses(job: Job, kind: str, answers: EpisodePoses) -> list[Moment]:
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
    moment = Moment(
        **_named(job),
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
# Places as small whole numbers: poses, lanes, and what to look at. Planar poses are (N, 3): x, y,
# metres, and yaw, radians.


def planar(poses: np.ndarray) -> np.ndarray:
    """Return (N, 3) planar poses of (N, 4, 4) ones."""
    return np.column_stack([poses[:, :2, 3], np.arctan2(poses[:, 1, 0], poses[:, 0, 0])])


def moved_into(poses: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return planar poses in the frame of another one."""
    cos, sin = np.cos(origin[2]), np.sin(origin[2])
    x, y = (poses[:, :2] - origin[:2]).T
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, poses[:, 2] - origin[2]])


def focus_on(points: np.ndarray) -> tuple[int, int, int, int]:
    """Return the centre, half length and half width of a view of (N, 2) points."""
    low, high = points.min(axis=0) - VIEW_MARGIN_M, points.max(axis=0) + VIEW_MARGIN_M
    x, y, length, width = np.rint(np.append(low + high, high - low) / 2 * DECIMETRES).astype(int)
    return int(x), int(y), int(length), int(width)


def motion_of(poses: np.ndarray) -> list[int]:
    """Return planar poses as whole numbers: the first, then differences."""
    unwrapped = np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])])
    scaled = np.rint(unwrapped * (DECIMETRES, DECIMETRES, CENTIRADIANS)).astype(int)
    return _differences(scaled)


def _differences(rows: np.ndarray) -> list[int]:
    """Return the first row, then the differences from row to row, one after the other."""
    return [int(value) for value in np.diff(rows, axis=0, prepend=0 * rows[:1]).ravel()]


def lanes_of(episode: Episode) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the lanes of an episode's road; none if its traffic is not kept."""
    node = TrafficNode.of(episode)
    try:
        return read_kept(node.path, node.record.load).road.lanes()
    except (OSError, RecordError):
        return []


def near_lanes(
    lanes: Sequence[tuple[np.ndarray, np.ndarray]],
    origin: np.ndarray,
    egos: np.ndarray,
    reach_m: float,
) -> list[LaneStrip]:
    """Return the parts of lanes that come near the ego, with no more points than bends need."""
    shown = []
    for points, widths in lanes:
        is_near = np.zeros(len(points), bool)
        for ego in egos[:: max(1, len(egos) // 8)]:
            is_near |= np.linalg.norm(points - ego[:2], axis=1) <= 1.5 * reach_m
        rows = np.flatnonzero(is_near)
        # A lane that leaves and comes back gives several parts.
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            if len(part) > 1:
                poses = np.column_stack([points[part], np.zeros(len(part))])
                line = _simplified(moved_into(poses, origin)[:, :2])
                width = round(float(np.median(widths[part])) * DECIMETRES)
                shown.append(LaneStrip(width, _differences(np.rint(line * DECIMETRES).astype(int))))
    return shown


def _simplified(line: np.ndarray) -> np.ndarray:
    """Return a line with no more points than bends need (Douglas and Peucker 1973)."""
    chord = line[-1] - line[0]
    offsets = line - line[0]
    length = float(np.hypot(*chord))
    if length > 0:
        distances = np.abs(chord[0] * offsets[:, 1] - chord[1] * offsets[:, 0]) / length
    else:
        distances = np.hypot(*offsets.T)
    farthest = int(np.argmax(distances))
    if distances[farthest] <= LANE_TOLERANCE_M:
        return line[[0, -1]]
    before, after = _simplified(line[: farthest + 1]), _simplified(line[farthest:])
    return np.vstack([before[:-1], after])
