import numpy as np
import pytest
from tracked_scenes import both, boxes

from roadscope.core import Category
from roadscope.core.box_overlap import box_overlaps_3d
from roadscope.trackers.suppression import suppressed
from roadscope.trackers.tracklets import boxes_of


def one_by_one(targets, most):
    """Rows that stay: from the surest on, each that overlaps none so far by too much."""
    overlaps = box_overlaps_3d(boxes_of(targets), boxes_of(targets))
    stays = []
    for row in np.argsort(-targets.scores, kind="stable").tolist():
        if all(overlaps[row, other] <= most for other in stays):
            stays.append(row)
    return sorted(stays)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("most", [0.0, 0.1, 0.25])
def test_as_one_by_one(seed, most):
    rng = np.random.default_rng(seed)
    crowd = boxes(rng.uniform(0, 10, (30, 2)), 0, rng.random(30), yaws=rng.uniform(-3, 3, 30))
    kept = suppressed(crowd, most)
    assert kept == crowd.select(np.array(one_by_one(crowd, most)))
    assert 0 < len(kept) < 30


def test_what_is_dropped_drops_nothing():
    """The middle one goes for the first, and the last, which only that one touches, stays."""
    row = boxes([(0, 0), (2, 0), (4, 0)], 0, [0.9, 0.8, 0.7])
    assert suppressed(row, 0.2).scores.tolist() == [0.9, 0.7]


def test_others_families_are_left_alone():
    scene = both(boxes([(0, 0)], 0, 0.9), boxes([(0, 0)], 0, 0.3, Category.PEDESTRIAN))
    assert len(suppressed(scene, 0.0)) == 2


def test_nothing_stays_nothing():
    assert len(suppressed(boxes([], 0), 0.1)) == 0
