"""Answers of an episode with what was right and wrong in each frame: boxes in space, in images."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.metrics import fusion as fusion_metrics
from roadscope.benchmarks.metrics import image_detection as image_metrics
from roadscope.benchmarks.metrics.detection import GATE_M
from roadscope.benchmarks.metrics.fusion import FusionTargets, match_targets
from roadscope.benchmarks.metrics.image_labels import FAMILIES, PARKED, Labels
from roadscope.benchmarks.metrics.matching import Pairing, match
from roadscope.benchmarks.metrics.ranked_precision import FALSE_ALARM
from roadscope.benchmarks.metrics.tracking.clear import switched
from roadscope.benchmarks.metrics.tracking.matching import match_tracks
from roadscope.benchmarks.metrics.tracking.scores import (
    counted_rows,
    counted_sequence,
    matched_rows,
)
from roadscope.benchmarks.nodes.fusions import PARKED_SIZE_M, nearest_image, rows_in_both
from roadscope.benchmarks.records import (
    EpisodeDetections,
    EpisodeFusions,
    EpisodeImageDetections,
    EpisodeTracks,
)
from roadscope.benchmarks.report.replay_records import FrameBoxes, boxes_of, category_names, joined
from roadscope.core import Category, Detections, ImageDetections, Tracks, Truth
from roadscope.core.category import families_of
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection

SWITCHES, MISSES, ALARMS = "identity switches", "misses", "false alarms"
PARKED_CAR, FIRST_PARKED = "parked car", -2
"""Label of parked cars, and the number of the first one."""
MARGIN_M = 10.0
"""How far objects and lanes are shown beyond the range in which objects are eligible."""
BEAM_M, BEAM_WIDTH_M = 30.0, 0.4
"""Length, where no object gives one, and width of a beam; chosen by hand."""


@dataclass(frozen=True, slots=True)
class JudgedFrames(ABC):
    """Frames of an episode with what was right and wrong in each.

    times_s: (T,). objects, answers: true boxes, and those of the entry, with their states.
    """

    times_s: np.ndarray
    objects: Sequence[FrameBoxes]
    answers: Sequence[FrameBoxes]

    @abstractmethod
    def object_text(self, frame: int, row: int) -> str:
        """Return what an object is, where, and how much of it is seen."""

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


class ImageFrames(NamedTuple):
    """Boxes in the images of T frames: pixels, x to the right and y up from the left top corner.

    rows: (T,) numbers of the images. objects, answers: as in `JudgedFrames`.
    """

    rows: np.ndarray
    objects: Sequence[FrameBoxes]
    answers: Sequence[FrameBoxes]


@dataclass(frozen=True, slots=True)
class JudgedScene(JudgedFrames):
    """Frames whose boxes are seen from above.

    truths: of the frames. switches: by frame, texts about switches of identities.
    reach_m: how far from the ego boxes are shown.
    parked: boxes of parked cars, which never count, of the whole episode.
    given: the detections that the entry got, where they are shown beside its answers.
    images: the same frames in the camera's images, where these are shown too.
    """

    truths: Sequence[Truth]
    switches: Mapping[int, Sequence[str]]
    reach_m: float
    parked: FrameBoxes
    given: Sequence[FrameBoxes] = ()
    images: ImageFrames | None = None

    def object_text(self, frame: int, row: int) -> str:
        """Return what an object is, where, and how much of it the LiDAR sees."""
        truth = self.truths[frame]
        name = Category(int(truth.categories[row])).name.lower()
        away_m = np.linalg.norm(truth.centres[row, :2] - truth.world_from_ego.translation[:2])
        hidden = f"{100 * truth.occluded_fraction[row]:.0f} % hidden from the LiDAR"
        returns = truth.lidar_returns[row]
        return f"{name} {truth.ids[row]} at {away_m:.0f} m with {returns} returns, {hidden}"


@dataclass(frozen=True, slots=True)
class JudgedImages(JudgedFrames):
    """Frames whose boxes are in images: pixels, x to the right and y up from the left top corner.

    rows: (T,) numbers of the images. labels: the objects of each.
    """

    rows: np.ndarray
    labels: Sequence[Labels]

    def object_text(self, frame: int, row: int) -> str:
        """Return what an object is, where, and how much of it is seen."""
        labels = self.labels[frame]
        name, hidden = self.objects[frame].labels[row], f"{100 * labels.occluded[row]:.0f} % hidden"
        return f"{name} at {labels.ranges_m[row]:.0f} m with {labels.pixels[row]} pixels, {hidden}"


# --------------------------------------------------------------------------------------------------
# Detections and tracks.


def judged_scene(
    answers: EpisodeTracks | EpisodeDetections, inputs: EpisodeDetections, rule: Eligibility
) -> JudgedScene:
    """Match answers with the objects of each frame. inputs: with the truth of the frames."""
    truths = inputs.truths
    objects = [boxes_of(truth, truth.ids) for truth in truths]
    switches: Mapping[int, Sequence[str]] = {}
    if isinstance(answers, EpisodeTracks):
        pairings = rule.pairings(answers.tracks, truths, inputs.parked)
        boxes = [boxes_of(tracks, tracks.ids) for tracks in answers.tracks]
        switches = _judge_tracks(answers.tracks, truths, pairings, objects, boxes)
    else:
        pairings = rule.pairings(answers.detections, truths, inputs.parked)
        boxes = [boxes_of(each, np.full(len(each), -1)) for each in answers.detections]
        _judge_detections(pairings, objects, boxes)
    reach_m = rule.range_m[1] + MARGIN_M
    parked = _parked_boxes(inputs)
    return JudgedScene(_times_of(truths), objects, boxes, truths, switches, reach_m, parked)


def _parked_boxes(inputs: EpisodeDetections) -> FrameBoxes:
    """Return boxes of the parked cars; of size and yaw, which are not kept, likely ones."""
    count = len(inputs.parked)
    egos = [truth.world_from_ego for truth in inputs.truths]
    places = np.array([ego.translation[:2] for ego in egos])
    nearest = np.linalg.norm(inputs.parked[:, None] - places, axis=2).argmin(axis=1)
    return FrameBoxes(
        FIRST_PARKED - np.arange(count),
        inputs.parked,
        np.tile(PARKED_SIZE_M[:2], (count, 1)),
        np.array([egos[k].yaw for k in nearest]),
        np.full(count, "i"),
        np.full(count, PARKED_CAR),
    )


def _times_of(truths: Sequence[Truth]) -> np.ndarray:
    return np.array([truth.stamp_s for truth in truths])


def _judge_detections(
    pairings: Sequence[Pairing], objects: Sequence[FrameBoxes], boxes: Sequence[FrameBoxes]
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
    objects: Sequence[FrameBoxes],
    boxes: Sequence[FrameBoxes],
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


# --------------------------------------------------------------------------------------------------
# Fused detections, and detections in images. Those of low scores are left out, as in the rates of
# their boards.


def judged_fusions(
    answers: EpisodeFusions,
    lidar: EpisodeDetections,
    camera: EpisodeImageDetections,
    projection: Projection,
) -> JudgedScene:
    """Match fused detections with the objects of their scans. projection: into the images."""
    frames = answers.rows.tolist()
    truths = [lidar.truths[frame] for frame in frames]
    objects = [boxes_of(truth, truth.ids) for truth in truths]
    boxes: list[FrameBoxes] = []
    images: list[int] = []
    true_in_images: list[FrameBoxes] = []
    own_in_images: list[FrameBoxes] = []
    for k, (truth, fused, targets) in enumerate(
        zip(truths, answers.fused, answers.targets, strict=True)
    ):
        shown = fused.select(fused.scores >= fusion_metrics.SCORE_THRESHOLD)
        shown = shown.select(shown.has_box | shown.has_image_box)
        matched = match_targets([shown], [targets]).targets
        image = nearest_image(truth, camera)
        # Parked cars, the last ones among the targets, are never eligible.
        rows = rows_in_both(truth, camera.truths[image])
        eligible = rows[targets.eligible[: len(rows)]]
        objects[k].states[eligible] = "x"
        objects[k].states[eligible[matched[matched >= 0]]] = "m"
        placed = _with_beams(shown, targets, matched, projection)
        placed = placed.moved(truth.world_from_ego, "world")
        states, labels = _answer_states(matched), _scored_names(shown)
        alone = np.where(shown.has_box, labels, np.char.add(labels, ", camera alone"))
        own = boxes_of(placed, np.full(len(placed), -1))
        boxes.append(own._replace(states=states, labels=alone))
        images.append(image)
        true_in_images.append(_targets_in_image(objects[k].select(rows), targets))
        fused_boxes = _image_boxes(shown.image_boxes, labels)._replace(states=states)
        own_in_images.append(
            joined(fused_boxes.select(shown.has_image_box), _detected_in(camera.filled[image]))
        )
    given = [_given(lidar.detections[frame]) for frame in frames]
    reach_m = fusion_metrics.FARTHEST_M + MARGIN_M
    parked = _parked_boxes(lidar)
    in_images = ImageFrames(camera.rows[images], true_in_images, own_in_images)
    return JudgedScene(
        _times_of(truths), objects, boxes, truths, {}, reach_m, parked, given, in_images
    )


def _given(detections: Detections) -> FrameBoxes:
    """Return the detections of the LiDAR as a fusion gets them."""
    boxes = boxes_of(detections, np.full(len(detections), -1))
    return boxes._replace(states=np.full(len(detections), "d"))


def _detected_in(detections: ImageDetections) -> FrameBoxes:
    """Return the detections of an image as a fusion gets them."""
    boxes = _image_boxes(detections.boxes, _scored_names(detections))
    return boxes._replace(states=np.full(len(detections), "d"))


def _targets_in_image(objects: FrameBoxes, targets: FusionTargets) -> FrameBoxes:
    """Return the boxes of the targets that are near enough to be shown and in the image.

    objects: the judged ones, in order.
    """
    parked = len(targets) - len(objects.states)
    labels = np.append(objects.labels, np.full(parked, PARKED_CAR))
    states = np.append(objects.states, np.full(parked, "i"))
    sides = targets.image_boxes[:, 2:] - targets.image_boxes[:, :2]
    boxes = _image_boxes(targets.image_boxes, labels)._replace(states=states)
    near = targets.distances_m <= fusion_metrics.FARTHEST_M + MARGIN_M
    return boxes.select(near & (sides > 0).all(axis=1))


def _with_beams(
    fused: FusedDetections, targets: FusionTargets, matched: np.ndarray, projection: Projection
) -> Detections:
    """Return fused detections in frame `ego`; one without a box becomes a beam in its direction.

    The beam begins at the camera and ends at the matched object, or after `BEAM_M`.
    """
    ego_from_pixel = np.linalg.inv(projection.matrix[:, :3])
    camera = -(ego_from_pixel @ projection.matrix[:, 3])[:2]
    middles = (fused.image_boxes[:, :2] + fused.image_boxes[:, 2:]) / 2
    rays = np.column_stack([middles, np.ones(len(fused))]) @ ego_from_pixel.T
    yaws = np.arctan2(rays[:, 1], rays[:, 0])
    lengths_m, hit = np.full(len(fused), BEAM_M), matched >= 0
    ends = targets.centres[targets.eligible][matched[hit], :2]
    lengths_m[hit] = np.linalg.norm(ends - camera, axis=1)
    beams = camera + lengths_m[:, None] / 2 * np.column_stack([np.cos(yaws), np.sin(yaws)])
    sizes = np.column_stack([lengths_m, np.full((len(fused), 2), BEAM_WIDTH_M)])
    has_box = fused.has_box[:, None]
    return Detections(
        np.where(has_box, fused.centres, np.column_stack([beams, np.zeros(len(fused))])),
        np.where(has_box, fused.sizes, sizes),
        np.where(fused.has_box, fused.yaws, yaws),
        fused.categories,
        fused.scores,
        "ego",
        fused.stamp_s,
    )


def judged_images(answers: EpisodeImageDetections, extinction_per_m: float) -> JudgedImages:
    """Match detections in images with the objects in them. extinction_per_m: of the air."""
    labels = answers.labels(extinction_per_m)
    objects, boxes = [], []
    for detected, each in zip(answers.filled, labels, strict=True):
        shown = detected.select(detected.scores >= image_metrics.SCORE_THRESHOLD)
        names = category_names(np.where(each.categories == PARKED, Category.CAR, each.categories))
        names = np.where(each.categories == PARKED, PARKED_CAR, names)
        true = _image_boxes(each.boxes, names)
        own = _image_boxes(shown.boxes, _scored_names(shown))
        true.states[each.eligible] = "x"
        for family in range(len(FAMILIES)):
            rows = np.flatnonzero(families_of(shown.categories) == family)
            columns = np.flatnonzero(each.families == family)
            (image,) = image_metrics.images_of_family([shown], [each], family)
            matched = image_metrics.matched_objects(image)
            own.states[rows] = _answer_states(matched)
            true.states[columns[matched[matched >= 0]]] = "m"
        objects.append(true)
        boxes.append(own)
    return JudgedImages(_times_of(answers.truths), objects, boxes, answers.rows, labels)


def _image_boxes(boxes: np.ndarray, labels: np.ndarray) -> FrameBoxes:
    """Return boxes of an image, not yet judged. boxes: (N, 4), left top right bottom."""
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2 * (1, -1)
    count = len(boxes)
    return FrameBoxes(
        np.full(count, -1),
        centres,
        boxes[:, 2:] - boxes[:, :2],
        np.zeros(count),
        np.full(count, "i"),
        labels,
    )


def _answer_states(matched: np.ndarray) -> np.ndarray:
    """Return the states of answers. matched: object of each, or `FALSE_ALARM` or `IGNORED`."""
    return np.select([matched >= 0, matched == FALSE_ALARM], ["m", "f"], "i")


def _scored_names(detections: FusedDetections | ImageDetections) -> np.ndarray:
    """Return (N,) categories and scores, `car 0.93`."""
    names = category_names(detections.categories)
    pairs = zip(names, detections.scores, strict=True)
    return np.array([f"{name} {score:.2f}" for name, score in pairs], str)
