"""Scores of result files of any tracker against ground truth, in KITTI's or MOTChallenge's format.

Here is no tracker at work: both kinds of files come from elsewhere. Our own trackers follow boxes
in space, of which MOTChallenge's detections have none.
"""

from __future__ import annotations

from pathlib import Path

from roadscope.benchmarks.formats.kitti_objects import TYPE_OF, read_labels
from roadscope.benchmarks.formats.kitti_rules import SIMILARITIES, judged
from roadscope.benchmarks.formats.mot_rules import THRESHOLD, distractors_of, mot_judged
from roadscope.benchmarks.formats.motchallenge import by_frame, read_mot, read_mot_sequence
from roadscope.benchmarks.formats.table import FormatError
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.recorded.kitti_scores import sequence_scores
from roadscope.core import Category


def score_mot_results(sequence: Path | str, results: Path | str) -> dict[str, Score]:
    """Return HOTA, MOTA, IDF1 and the like of one sequence by image boxes.

    sequence: its folder with `gt/gt.txt`, `det/det.txt` and `seqinfo.ini`.
    results: what a tracker told of it, 7 or 10 columns.
    Anything malformed raises `FormatError` with file, line and what was expected.

    >>> from roadscope.benchmarks import score_mot_results
    >>> scores = score_mot_results("MOT17-02", "mine/MOT17-02.txt")
    >>> for name in ("hota", "mota", "idf1"):
    ...     print(f"{name} {scores[name].value:.3f}")
    hota 0.707
    mota 0.500
    idf1 0.667
    """
    known = read_mot_sequence(sequence)
    true = known.truth
    if true is None:
        raise FormatError(f"{Path(sequence) / 'gt' / 'gt.txt'}: missing; nothing to score by")
    told = read_mot(Path(results), end=(len(true), f"the last of the sequence {sequence}"))
    counted = mot_judged(true, by_frame(told, len(true)), distractors_of(known.name))
    return sequence_scores(counted, THRESHOLD)


def score_kitti_results(
    labels: Path | str, results: Path | str, category: Category = Category.CAR
) -> dict[str, Score]:
    """Return the same of a KITTI sequence, by image boxes and under KITTI's rules.

    labels: `label_02/SEQ.txt`. results: 17 columns, or 18 with a score.
    category: car, pedestrian or cyclist.

    >>> from roadscope.benchmarks.recorded.result_files import score_kitti_results
    >>> scores = score_kitti_results("label_02/0000.txt", "mine/0000.txt")
    >>> scores["hota"].value
    1.0
    """
    true, told = read_labels(Path(labels)), read_labels(Path(results), results=True)
    count = 1 + max(int(rows.frames.max(initial=-1)) for rows in (true, told))
    counted = judged(true.by_frame(count), told.by_frame(count), TYPE_OF[category])
    return sequence_scores(counted, SIMILARITIES["iou_2d"].threshold)
