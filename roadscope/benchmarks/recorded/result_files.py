"""Scores of result files of any tracker, in the format of KITTI or MOTChallenge."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from roadscope.benchmarks.formats.kitti_labels import (
    DETECTED_TYPES,
    KittiObjects,
    read_kitti_labels,
    read_kitti_object_labels,
    read_kitti_object_results,
)
from roadscope.benchmarks.formats.kitti_scans import numbered_files
from roadscope.benchmarks.formats.motchallenge import read_mot, read_mot_sequence
from roadscope.benchmarks.formats.table import FormatError, names_in
from roadscope.benchmarks.formats.tracking_rows import FrameLimit
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracking.hota import hota
from roadscope.benchmarks.recorded.combined import SUFFIXES, alpha_parts
from roadscope.benchmarks.recorded.object_rules import OVERLAPS, precision_scores
from roadscope.benchmarks.recorded.rules import (
    BOX_SIMILARITIES,
    IMAGE_THRESHOLD,
    apply_kitti_rules,
    apply_mot_rules,
    distractors_of,
)
from roadscope.benchmarks.recorded.scores import sequence_scores
from roadscope.core import Category


def score_mot_results(sequence: Path | str, results: Path | str) -> dict[str, Score]:
    """Return HOTA (also by alpha), MOTA, IDF1 and other scores of one sequence, by image boxes.

    sequence: its folder with `gt/gt.txt`, `det/det.txt` and `seqinfo.ini`.
    results: a tracker's results, 7 or 10 columns.
    A malformed file raises `FormatError` with file, line and what was expected.

    >>> from roadscope.benchmarks import score_mot_results
    >>> scores = score_mot_results("MOT17-02", "mine/MOT17-02.txt")
    >>> for name in ("hota", "mota", "idf1"):
    ...     print(f"{name} {scores[name].value:.3f}")
    hota 0.707
    mota 0.500
    idf1 0.667
    """
    labelled = read_mot_sequence(sequence)
    truth = labelled.truth_rows
    if truth is None:
        raise FormatError(f"{Path(sequence) / 'gt' / 'gt.txt'}: missing; scores need ground truth")
    limit = FrameLimit(len(truth), f"the last of the sequence {sequence}")
    tracks = read_mot(Path(results), limit=limit).by_frame(len(truth))
    counted = apply_mot_rules(truth, tracks, distractors_of(labelled.name))
    return sequence_scores(counted, IMAGE_THRESHOLD) | alpha_parts(hota(counted))


def score_kitti_results(
    labels: Path | str, results: Path | str, category: Category = Category.CAR
) -> dict[str, Score]:
    """Return the same scores of a KITTI sequence, by image boxes and under KITTI's rules.

    labels: `label_02/SEQ.txt`. results: 17 columns, or 18 with a score.
    category: car, pedestrian or cyclist.

    >>> from roadscope.benchmarks import score_kitti_results
    >>> scores = score_kitti_results("label_02/0000.txt", "mine/0000.txt")
    >>> scores["hota"].value
    1.0
    """
    truth, tracks = read_kitti_labels(labels), read_kitti_labels(results, results=True)
    return kitti_result_scores(truth, tracks, category, ["iou_2d"])


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
    truth, found = (numbered_files(Path(folder), "txt") for folder in (labels, results))
    if not truth:
        raise FormatError(f"{labels}: expected files 000000.txt, got {names_in(Path(labels))}")
    if differing := sorted(set(truth) ^ set(found)):
        raise FormatError(
            f"{results}: expected a file for each of {len(truth)} in {labels}; "
            f"{differing[0]:06d}.txt is in one of the folders only"
        )
    objects = [read_kitti_object_labels(path, number) for number, path in truth.items()]
    boxes = [read_kitti_object_results(path, number) for number, path in found.items()]
    return precision_scores(objects, boxes, DETECTED_TYPES[category], OVERLAPS)


def kitti_result_scores(
    labels: KittiObjects, results: KittiObjects, category: Category, similarities: Sequence[str]
) -> dict[str, Score]:
    """Return the scores of a sequence by each similarity, with the suffixes of the boards.

    similarities: keys of `BOX_SIMILARITIES`.
    """
    count = 1 + max(int(rows.frames.max(initial=-1)) for rows in (labels, results))
    truth, tracks, kind = labels.by_frame(count), results.by_frame(count), DETECTED_TYPES[category]
    scores: dict[str, Score] = {}
    for name in similarities:
        counted = apply_kitti_rules(truth, tracks, kind, name)
        by_similarity = sequence_scores(counted, BOX_SIMILARITIES[name].threshold)
        scores |= {f"{metric}{SUFFIXES[name]}": score for metric, score in by_similarity.items()}
        scores |= alpha_parts(hota(counted), SUFFIXES[name])
    return scores
