import numpy as np
import pytest
from toy_boxes import detections, truth

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.metrics.breakdown import (
    BANDS,
    broken_down,
    part_name,
    split_name,
)
from roadscope.benchmarks.metrics.detection import score_detections
from roadscope.core import Pose

RULE = Eligibility(range_m=(0.0, 80.0), min_returns=5)


def parts(found, truths):
    return broken_down(found, truths, RULE.pairings(found, truths))


def test_names_are_read_back() -> None:
    assert split_name(part_name("precision", "range", "0-20")) == ("precision", "range", "0-20")
    assert split_name("f1") == ("f1", "", "")


@pytest.mark.parametrize("by", BANDS)
def test_bands_have_a_label_each_and_ascend(by) -> None:
    bands = BANDS[by]
    assert len(bands.edges) == len(bands.labels) == len(set(bands.labels))
    assert list(bands.edges) == sorted(bands.edges)
    assert bands.of(np.array(bands.edges)).tolist() == list(range(len(bands.edges)))


def test_objects_by_what_is_true_of_them() -> None:
    there = truth(
        [[10, 0], [30, 0], [30, 10]],
        categories=np.array([0, 2, 0]),
        returns=[300, 12, 5],
        occluded_fraction=np.array([0.0, 0.3, 0.8]),
    )
    s = parts([detections([[10, 0], [30, 0], [70, 0]])], [there])

    def rate(by, band):
        score = s[part_name("detection_rate", by, band)]
        return score.value, score.n

    assert rate("range", "0-20") == (1.0, 1)
    assert rate("range", "20-40") == (0.5, 2)
    assert rate("category", "car") == (0.5, 2)
    assert rate("category", "truck") == (1.0, 1)
    assert rate("occlusion", "none") == (1.0, 1)
    assert rate("occlusion", "25-50") == (1.0, 1)
    assert rate("occlusion", "75-100") == (0.0, 1)
    assert rate("points", "5-9") == (0.0, 1)
    assert rate("points", "10-19") == (1.0, 1)
    assert rate("points", "200+") == (1.0, 1)
    assert rate("points", "1-4")[1] == 0


def test_false_alarms_by_their_own_range() -> None:
    there = truth([[10, 0]], world_from_ego=Pose.planar(5.0, 0.0, 1.0))
    s = parts([detections([[10, 0], [70, 0]]), detections([[24, 0]])], [there, there])
    assert s["precision by range: 0-20"].value == 0.5
    assert s["false_alarms_per_frame by range: 0-20"].value == 0.5
    assert s["precision by range: 60-80"].value == 0.0
    assert s["precision by range: 20-40"].n == 0


def test_precision_by_score() -> None:
    s = parts(
        [detections([[10, 0], [40, 0], [50, 0]], scores=[0.95, 0.95, 0.1])], [truth([[10, 0]])]
    )
    assert s["precision by score: .9-1"].value == 0.5
    assert s["score_excess by score: .9-1"].value == pytest.approx(0.45)
    assert s["score_excess by score: .1-.2"].value == pytest.approx(0.1)


def test_bands_add_up_to_the_whole() -> None:
    rng = np.random.default_rng(3)
    found, truths = [], []
    for _ in range(20):
        xy = rng.uniform(-60, 60, (12, 2))
        truths.append(
            truth(
                xy,
                returns=rng.integers(1, 400, 12),
                categories=rng.integers(0, 5, 12),
                occluded_fraction=rng.random(12),
            )
        )
        seen = xy[rng.random(12) < 0.6] + rng.normal(0, 0.7, 2)
        found.append(detections(np.vstack([seen, rng.uniform(-60, 60, (3, 2))])))
    pairings = RULE.pairings(found, truths)
    whole, s = score_detections(found, truths, pairings), broken_down(found, truths, pairings)
    for by in ("range", "category", "occlusion", "points"):
        rows = [s[part_name("detection_rate", by, band)] for band in BANDS[by].labels]
        assert sum(r.n for r in rows) == whole.detection_rate.n
        hits = sum(r.value * r.n for r in rows if r.n)
        assert hits == pytest.approx(whole.detection_rate.value * whole.detection_rate.n)
    alarms = [s[part_name("false_alarms_per_frame", "range", b)] for b in BANDS["range"].labels]
    assert sum(a.value for a in alarms) == pytest.approx(whole.false_alarms_per_frame.value)
    judged = [s[part_name("precision", "score", b)] for b in BANDS["score"].labels]
    assert sum(r.n for r in judged) == whole.precision.n


def test_nothing_there() -> None:
    s = parts([detections([])], [truth([])])
    assert all(score.n == 0 for name, score in s.items() if "frame" not in name)
    assert set(s) == set(parts([detections([[1, 0]])], [truth([[1, 0]])]))
