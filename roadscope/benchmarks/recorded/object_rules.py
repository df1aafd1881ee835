"""Average precision of boxes by the rules of KITTI's object benchmark (Geiger et al. 2012).

Precision is averaged at 40 recalls (Simonelli et al. 2019). Labels of a neighbouring class (vans
beside cars, sitting people beside pedestrians), and those too hard for a difficulty, are neither
misses nor make a detection false; nor is a detection false that is too low in the image. Image
boxes in a region without labels (DontCare) are not false either; such a region has no box in space.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.formats.kitti_labels import (
    DETECTED_TYPES,
    KittiObjects,
    KittiType,
    read_kitti_object_labels,
    read_kitti_object_results,
)
from roadscope.benchmarks.formats.kitti_scans import numbered_files
from roadscope.benchmarks.formats.table import FormatError, names_in
from roadscope.benchmarks.metrics.score import Score, averaged
from roadscope.benchmarks.recorded.rules import (
    KITTI_DISTRACTORS,
    boxes_3d,
    overlap_in_image,
    overlap_in_space,
    shares_in_regions,
)
from roadscope.core import Category

RECALL_STEPS = 40
"""Recalls 1/40, 2/40, ..., 1 at which precision is averaged."""


class Difficulty(NamedTuple):
    """Which labels have to be found: limits of KITTI's evaluation.

    least_height_px: image boxes of labels are higher, those of detections at least as high.
    most_occluded: a level, see `KittiObjects`. most_truncated: share outside of the image.
    """

    least_height_px: float
    most_occluded: int
    most_truncated: float


DIFFICULTIES: Mapping[str, Difficulty] = {
    "easy": Difficulty(40.0, 0, 0.15),
    "moderate": Difficulty(25.0, 1, 0.30),
    "hard": Difficulty(25.0, 2, 0.50),
}
HIGHEST_PX = max(each.least_height_px for each in DIFFICULTIES.values())
LEAST_OVERLAPS: Mapping[KittiType, float] = {
    KittiType.CAR: 0.7,
    KittiType.PEDESTRIAN: 0.5,
    KittiType.CYCLIST: 0.5,
}
"""A detection can be of a label if their intersection over union is larger."""


def _overlap_from_above(labels: KittiObjects, boxes: KittiObjects) -> np.ndarray:
    from roadscope.core.box_overlap import box_overlaps

    rows = [boxes_3d(each)[:, [0, 1, 3, 4, 6]] for each in (labels, boxes)]
    return box_overlaps(*rows)


OVERLAPS: Mapping[str, Callable[[KittiObjects, KittiObjects], np.ndarray]] = {
    "2d": overlap_in_image,
    "bev": _overlap_from_above,
    "3d": overlap_in_space,
}
"""M labels, N detections -> (M, N) intersection over union: in the image, from above, in space."""


@dataclass(frozen=True, slots=True)
class ObjectPrecision:
    """A curve of precision over recall, and its average.

    ap: 0 to 1; nan without an object.
    objects: number of labels that have to be found.
    precision: at each step of recall that was reached, the best from there on, at most 41.
    """

    ap: float
    objects: int
    precision: tuple[float, ...]

    @property
    def score(self) -> Score:
        """The average as a score."""
        return averaged(self.ap, self.objects)


def object_precisions(
    labels: Sequence[KittiObjects],
    detections: Sequence[KittiObjects],
    kind: KittiType,
    overlap: str = "3d",
) -> dict[str, ObjectPrecision]:
    """Return the precision of each of `DIFFICULTIES`.

    labels: all labels of each frame, of every type.
    detections: of each frame, with image boxes; those of other types than `kind` do not count.
    kind: car, pedestrian or cyclist. overlap: a key of `OVERLAPS`.

    As in KITTI's evaluation, a step of recall is the score of a matched detection, so N labels
    give N steps at most: with fewer than 41 labels even perfect detections have an average of
    (N - 1) / 40.
    """
    frames = [
        _FrameMatches.of(objects, boxes, kind, overlap)
        for objects, boxes in zip(labels, detections, strict=True)
    ]
    return {name: _precision(frames, each) for name, each in DIFFICULTIES.items()}


def precision_scores(
    labels: Sequence[KittiObjects],
    detections: Sequence[KittiObjects],
    kind: KittiType,
    overlaps: Iterable[str],
) -> dict[str, Score]:
    """Return average precisions by overlap and difficulty, named `ap_2d_easy` and the like.

    overlaps: keys of `OVERLAPS`. Detections without a 3-D box count only by the overlap in the
    image. The other arguments are those of `object_precisions`.
    """
    in_space = [rows.select(rows.has_3d_box) for rows in detections]
    return {
        f"ap_{overlap}_{name}": precision.score
        for overlap in overlaps
        for name, precision in object_precisions(
            labels, detections if overlap == "2d" else in_space, kind, overlap
        ).items()
    }


def score_kitti_object_results(
    labels: Path | str, results: Path | str, category: Category = Category.CAR
) -> dict[str, Score]:
    """Return a detector's average precision by KITTI's object rules, over all frames together.

    Scores are `ap_2d_easy` and the like: by overlap in the image, from above (bev) and in space
    (3d), and by difficulty; 0 to 1.

    labels: the folder `label_2`, with a file NNNNNN.txt of 15 columns for each frame.
    results: a folder with as many files of the same names; 16 columns, the last one the score.
    category: car, pedestrian or cyclist.
    """
    label_files, result_files = (numbered_files(Path(f), "txt") for f in (labels, results))
    if not label_files:
        raise FormatError(f"{labels}: expected files 000000.txt, got {names_in(Path(labels))}")
    if differing := sorted(set(label_files) ^ set(result_files)):
        raise FormatError(
            f"{results}: expected a file for each of {len(label_files)} in {labels}; "
            f"{differing[0]:06d}.txt is in one of the folders only"
        )
    objects = [read_kitti_object_labels(path, number) for number, path in label_files.items()]
    boxes = [read_kitti_object_results(path, number) for number, path in result_files.items()]
    return precision_scores(objects, boxes, DETECTED_TYPES[category], OVERLAPS)


@dataclass(frozen=True, slots=True, eq=False)
class _FrameMatches:
    """The labels and detections of one frame that matter.

    objects: labels of the class and of neighbouring ones.
    boxes: detections of the class, and others that may be too low in the image.
    pairs: of each label, the detections that overlap it enough, and how much.
    in_region: (N,) bool, which detections are mostly in a region without labels.
    """

    kind: KittiType
    objects: KittiObjects
    boxes: KittiObjects
    pairs: tuple[tuple[tuple[int, float], ...], ...]
    in_region: np.ndarray

    @staticmethod
    def of(
        labels: KittiObjects, detections: KittiObjects, kind: KittiType, overlap: str
    ) -> _FrameMatches:
        objects = labels.select(np.isin(labels.types, [kind, *KITTI_DISTRACTORS[kind]]))
        matters = (detections.types == kind) | (_heights_px(detections) < HIGHEST_PX)
        boxes = detections.select(matters)
        least = LEAST_OVERLAPS[kind]
        pairs: list[tuple[tuple[int, float], ...]] = [()] * len(objects)
        if len(objects) and len(boxes):
            pairs = [
                tuple((int(k), float(row[k])) for k in np.flatnonzero(row > least))
                for row in OVERLAPS[overlap](objects, boxes)
            ]
        in_region = np.zeros(len(boxes), bool)
        if overlap == "2d":
            regions = labels.boxes[labels.types == KittiType.DONT_CARE]
            in_region = np.any(shares_in_regions(boxes.boxes, regions) > least, axis=1)
        return _FrameMatches(kind, objects, boxes, tuple(pairs), in_region)

    def at(self, difficulty: Difficulty) -> _RatedFrame:
        """Return what counts at a difficulty."""
        heights_px = self.objects.boxes[:, 3] - self.objects.boxes[:, 1]
        wanted = (self.objects.types == self.kind) & (heights_px > difficulty.least_height_px)
        wanted &= self.objects.occluded <= difficulty.most_occluded
        wanted &= self.objects.truncated <= difficulty.most_truncated
        low = _heights_px(self.boxes) < difficulty.least_height_px
        of_class = self.boxes.types == self.kind
        matters = of_class | low
        pairs = [
            (bool(w), [(k, share) for k, share in own if matters[k]])
            for w, own in zip(wanted, self.pairs, strict=True)
        ]
        return _RatedFrame(
            int(wanted.sum()),
            [pair for pair in pairs if pair[1]],
            self.boxes.scores.tolist(),
            low.tolist(),
            (of_class & ~low & ~self.in_region).tolist(),
        )


def _heights_px(rows: KittiObjects) -> np.ndarray:
    heights_px: np.ndarray = np.abs(rows.boxes[:, 3] - rows.boxes[:, 1])
    return heights_px


@dataclass(frozen=True, slots=True)
class _RatedFrame:
    """One frame at one difficulty; lists are faster here than arrays.

    wanted: number of labels that have to be found.
    pairs: of each label with overlapping detections, whether it has to be found, and these.
    scores, low, alarms: of each detection; whether it is too low in the image; whether it is a
        false alarm unless it is matched.
    """

    wanted: int
    pairs: list[tuple[bool, list[tuple[int, float]]]]
    scores: list[float]
    low: list[bool]
    alarms: list[bool]

    def right_scores(self) -> list[float]:
        """Return the scores of right detections if each label takes the best score."""
        taken: set[int] = set()
        right = []
        for wanted, pairs in self.pairs:
            free = [k for k, _ in pairs if k not in taken]
            if not free:
                continue
            best = max(free, key=self.scores.__getitem__)
            taken.add(best)
            if wanted and not self.low[best]:
                right.append(self.scores[best])
        return right

    def matches(self, least_score: float) -> tuple[int, int]:
        """Match each label with the free detection that overlaps it most, low ones last.

        Return the numbers of right detections, and of matched ones that would be false otherwise.
        """
        taken: set[int] = set()
        right = 0
        for wanted, pairs in self.pairs:
            free = [(k, s) for k, s in pairs if k not in taken and self.scores[k] >= least_score]
            if not free:
                continue
            high = [pair for pair in free if not self.low[pair[0]]]
            best, _ = max(high, key=lambda pair: pair[1]) if high else free[0]
            taken.add(best)
            right += wanted and not self.low[best]
        return right, sum(self.alarms[k] for k in taken)

    def add_matches(self, thresholds: np.ndarray, right: np.ndarray, excused: np.ndarray) -> None:
        """Add the matches at each of (T,) falling scores to (T,) sums."""
        if not self.pairs:
            return
        paired = sorted({self.scores[k] for _, pairs in self.pairs for k, _ in pairs})
        # Thresholds between the same two scores of paired detections give the same matches.
        counts = np.searchsorted(paired, thresholds, side="left")
        for count in np.unique(counts):
            chosen = counts == count
            more_right, more_excused = self.matches(float(thresholds[chosen][0]))
            right[chosen] += more_right
            excused[chosen] += more_excused


def _precision(frames: Sequence[_FrameMatches], difficulty: Difficulty) -> ObjectPrecision:
    rated = [frame.at(difficulty) for frame in frames]
    objects = sum(frame.wanted for frame in rated)
    thresholds = np.array(
        _thresholds([s for frame in rated for s in frame.right_scores()], objects)
    )
    if not objects:
        return ObjectPrecision(np.nan, 0, ())
    right, excused = np.zeros(len(thresholds)), np.zeros(len(thresholds))
    for frame in rated:
        frame.add_matches(thresholds, right, excused)
    alarms = np.sort(
        [s for f in rated for s, counts in zip(f.scores, f.alarms, strict=True) if counts]
    )
    above = len(alarms) - np.searchsorted(alarms, thresholds, side="left")
    called = right + above - excused
    precision = np.divide(right, called, out=np.zeros(len(called)), where=called > 0)
    best = np.maximum.accumulate(precision[::-1])[::-1]
    return ObjectPrecision(float(best[1:].sum() / RECALL_STEPS), objects, tuple(best.tolist()))


def _thresholds(scores: Sequence[float], objects: int) -> list[float]:
    """Return the scores at which recall is nearest to 0, 1/40, 2/40, ..., falling."""
    ranked, recall, thresholds = sorted(scores, reverse=True), 0.0, []
    for number, score in enumerate(ranked, start=1):
        here, is_last = number / objects, number == len(ranked)
        if not is_last and (number + 1) / objects - recall < recall - here:
            continue
        thresholds.append(score)
        recall += 1 / RECALL_STEPS
    return thresholds[: RECALL_STEPS + 1]
