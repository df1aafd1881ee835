import re
from dataclasses import replace

import numpy as np
import pytest
from toy_boxes import detections, truth

from roadscope.benchmarks import Eligibility
from roadscope.benchmarks.metrics import (
    BANDS,
    part_name,
    score_detections,
    score_detections_by_band,
    split_name,
)
from roadscope.core import Pose

RULE = Eligibility(range_m=(0.0, 80.0), min_returns=5)


def parts(detected, truths):
    return score_detections_by_band(detected, truths, RULE.pairings(detected, truths))


def test_names_are_read_back() -> None:
    assert split_name(part_name("precision", "range", "0-20")) == ("precision", "range", "0-20")
    assert split_name("f1") == ("f1", "", "")


@pytest.mark.parametrize("by", BANDS)
def test_bands_have_a_label_each_and_ascend(by) -> None:
    bands = BANDS[by]
    assert len(bands.edges) == len(bands.labels) == len(set(bands.labels))
    assert list(bands.edges) == sorted(bands.edges)
    assert bands.of(np.array(bands.edges)).tolist() == list(range(len(bands.edges)))


@pytest.mark.parametrize(("by", "with_end"), [("range", 0), ("occlusion", 0), ("points", 1)])
def test_whole_numbers_lie_in_the_band_of_their_label(by, with_end) -> None:
    bands = BANDS[by]
    for band, label in enumerate(bands.labels):
        if re.fullmatch(r"\d+-\d+", label):
            first, last = map(int, label.split("-"))
            assert set(bands.of(np.arange(first, last + with_end))) == {band}


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


def test_errors_by_what_is_true_of_the_object() -> None:
    there = truth(
        [[10, 0], [19, 0], [30, 0], [50, 0]],
        categories=np.array([0, 2, 2, 0]),
        returns=[300, 12, 12, 5],
        occluded_fraction=np.array([0.0, 0.3, 0.3, 0.8]),
    )
    # The second one is found beyond its band, the last one not at all.
    detected = detections(
        [[10, 0.3], [20.2, 0], [30, 1.6]], yaws=np.radians([0, 3, -4]), sizes=(4.5, 1.8, 1.5)
    )
    s = parts([detected], [there])

    def error(metric, by, band):
        score = s[part_name(metric, by, band)]
        return pytest.approx(score.value, nan_ok=True), score.n

    assert error("position_rmse_m", "range", "0-20") == (np.sqrt((0.3**2 + 1.2**2) / 2), 2)
    assert error("position_rmse_m", "range", "20-40") == (1.6, 1)
    assert error("position_rmse_m", "points", "10-19") == (np.sqrt((1.2**2 + 1.6**2) / 2), 2)
    assert error("heading_rmse_deg", "category", "truck") == (np.sqrt((9 + 16) / 2), 2)
    assert error("heading_rmse_deg", "occlusion", "none") == (0.0, 1)
    assert error("size_rmse_m", "occlusion", "25-50") == (0.0, 4)
    for metric in ("position_rmse_m", "heading_rmse_deg", "size_rmse_m"):
        value, n = error(metric, "points", "5-9")
        assert (value, n) == (np.nan, 0)
        assert s[part_name(metric, "points", "5-9")].weight == 0


def test_false_alarms_by_their_own_range_and_category_and_in_every_band_of_the_rest() -> None:
    there = truth(
        [[10, 0], [30, 0]],
        categories=np.array([0, 2]),
        returns=[300, 12],
        occluded_fraction=np.array([0.0, 0.3]),
    )
    detected = detections([[10, 0], [30, 0], [30, 20]], scores=[0.5, 0.5, 0.9])
    s = parts([detected], [there])

    def values(metric, by, *bands):
        return [s[part_name(metric, by, band)].value for band in bands]

    assert values("ap", "range", "0-20", "20-40") == [1.0, 0.5]
    assert values("f1", "range", "0-20", "20-40") == [1.0, pytest.approx(2 / 3)]
    # The false one is called a car, and so is the lorry, which it is not: cars are found.
    assert values("ap", "category", "car", "truck") == [0.5, 1.0]
    assert values("f1", "category", "car", "truck") == [pytest.approx(2 / 3), 1.0]
    assert values("precision", "category", "car", "truck") == [0.5, 1.0]
    assert values("false_alarms_per_frame", "category", "car", "truck") == [1.0, 0.0]
    assert values("ap", "occlusion", "none", "25-50") == [0.5, 0.5]
    assert values("ap", "points", "10-19", "200+") == [0.5, 0.5]
    for by in ("occlusion", "points"):
        known = {split_name(name)[0] for name in s if split_name(name)[1] == by}
        assert not known & {"precision", "f1", "false_alarms_per_frame"}


def test_precision_by_score() -> None:
    s = parts(
        [detections([[10, 0], [40, 0], [50, 0]], scores=[0.95, 0.95, 0.1])], [truth([[10, 0]])]
    )
    assert s["precision by score: .9-1"].value == 0.5
    assert s["score_excess by score: .9-1"].value == pytest.approx(0.45)
    assert s["score_excess by score: .1-.2"].value == pytest.approx(0.1)


def test_bands_add_up_to_the_whole() -> None:
    rng = np.random.default_rng(3)
    frames, truths = [], []
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
        detected_xy = xy[rng.random(12) < 0.6] + rng.normal(0, 0.7, 2)
        centres = np.vstack([detected_xy, rng.uniform(-60, 60, (3, 2))])
        some = detections(
            centres,
            scores=rng.random(len(centres)),
            yaws=rng.normal(0, 0.3, len(centres)),
            sizes=rng.uniform(1, 5, 3),
        )
        frames.append(replace(some, categories=rng.integers(0, 6, len(centres)).astype(np.int8)))
    pairings = RULE.pairings(frames, truths)
    whole, s = (
        score_detections(frames, truths, pairings),
        score_detections_by_band(frames, truths, pairings),
    )
    for by in ("range", "category", "occlusion", "points"):
        rows = [s[part_name("detection_rate", by, band)] for band in BANDS[by].labels]
        assert sum(r.n for r in rows) == whole.detection_rate.n
        hits = sum(r.value * r.n for r in rows if r.n)
        assert hits == pytest.approx(whole.detection_rate.value * whole.detection_rate.n)
        for metric in ("position_rmse_m", "heading_rmse_deg", "size_rmse_m"):
            rows = [s[part_name(metric, by, band)] for band in BANDS[by].labels]
            all_of_it = getattr(whole, metric)
            assert sum(r.n for r in rows) == all_of_it.n
            squares = sum(r.value**2 * r.weight for r in rows if r.n)
            assert squares == pytest.approx(all_of_it.value**2 * all_of_it.weight)
        rows = [s[part_name("ap", by, band)] for band in BANDS[by].labels]
        assert sum(r.n for r in rows) == whole.ap.n
    for band in BANDS["category"].labels:
        recall, precision, f1 = (
            s[part_name(metric, "category", band)].value
            for metric in ("detection_rate", "precision", "f1")
        )
        if recall and precision:
            assert f1 == pytest.approx(2 * recall * precision / (recall + precision), nan_ok=True)
    for by in ("range", "category"):
        alarms = [s[part_name("false_alarms_per_frame", by, b)] for b in BANDS[by].labels]
        assert sum(a.value for a in alarms) == pytest.approx(whole.false_alarms_per_frame.value)
        for metric in ("f1", "precision"):
            rows = [s[part_name(metric, by, band)] for band in BANDS[by].labels]
            all_of_it = getattr(whole, metric)
            assert sum(r.weight for r in rows) == all_of_it.weight
            right = sum(r.value * r.weight for r in rows if r.weight)
            assert right == pytest.approx(all_of_it.value * all_of_it.weight)
    judged = [s[part_name("precision", "score", b)] for b in BANDS["score"].labels]
    assert sum(r.n for r in judged) == whole.precision.n


def test_one_band_of_all_is_the_whole() -> None:
    rng = np.random.default_rng(5)
    truths = [truth(rng.uniform(5, 13, (6, 2)), returns=15) for _ in range(20)]
    frames = [
        detections(t.centres[:4, :2] + rng.normal(0, 1.5, (4, 2)), scores=rng.random(4))
        for t in truths
    ]
    pairings = RULE.pairings(frames, truths)
    whole, s = (
        score_detections(frames, truths, pairings),
        score_detections_by_band(frames, truths, pairings),
    )
    of = {"category": "car", "occlusion": "none", "points": "10-19"}
    assert 0.1 < whole.ap.value < 0.9
    for by, band in of.items():
        assert s[part_name("ap", by, band)].value == pytest.approx(whole.ap.value)
    assert s[part_name("f1", "category", "car")].value == pytest.approx(whole.f1.value)


def test_nothing_there() -> None:
    s = parts([detections([])], [truth([])])
    assert all(score.n == 0 for name, score in s.items() if "frame" not in name)
    assert set(s) == set(parts([detections([[1, 0]])], [truth([[1, 0]])]))
