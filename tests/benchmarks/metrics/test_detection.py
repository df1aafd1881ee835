import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_boxes import detections, truth

from roadscope.benchmarks import Eligibility
from roadscope.benchmarks.metrics import score_detections

RULE = Eligibility(range_m=(0.0, 60.0), min_returns=10)


def score(detected, truths, parked=None):
    return score_detections(detected, truths, RULE.pairings(detected, truths, parked))


def test_a_case_by_hand() -> None:
    # Frame 1: two of three objects found, one false alarm. Frame 2: one of one, none false.
    truths = [truth([[10, 0], [20, 0], [30, 0]]), truth([[10, 0]])]
    frames = [detections([[10, 1], [20, 0.5], [40, 0]]), detections([[10.5, 0]])]
    s = score(frames, truths)
    assert s.detection_rate.value == 3 / 4
    assert s.detection_rate.n == 4
    assert s.precision.value == 3 / 4
    assert s.f1.value == 3 / 4
    assert s.false_alarms_per_frame.value == 0.5
    assert s.objects_per_frame.value == 2.0
    assert s.position_rmse_m.value == pytest.approx(math.sqrt((1 + 0.25 + 0.25) / 3))


def test_size_and_heading_errors_of_matches() -> None:
    frames = [detections([[10, 0]], yaws=math.pi + 0.1, sizes=(4.0, 2.0, 9.0))]
    s = score(frames, [truth([[10, 0]])])
    assert s.heading_rmse_deg.value == pytest.approx(math.degrees(0.1))
    assert s.size_rmse_m.value == pytest.approx(math.sqrt((0.5**2 + 0.2**2) / 2))
    assert s.heading_flips.value == 0.0


def test_position_errors_along_and_across_the_object() -> None:
    there = truth([[10, 0], [0, 20]], yaws=np.array([math.pi / 2, 0.0]))
    frames = [detections([[10.3, 0.4], [0.5, 20]], yaws=[0.1, 0.0])]
    s = score(frames, [there])
    assert s.longitudinal_rmse_m.value == pytest.approx(math.sqrt((0.4**2 + 0.5**2) / 2))
    assert s.lateral_rmse_m.value == pytest.approx(math.sqrt(0.3**2 / 2))
    both = math.hypot(s.longitudinal_rmse_m.value, s.lateral_rmse_m.value)
    assert s.position_rmse_m.value == pytest.approx(both)
    assert s.heading_flips.value == 0.5


def test_categories_of_matches() -> None:
    there = truth([[10, 0], [20, 0], [30, 0]], categories=np.array([0, 2, 0]))
    s = score([detections([[10, 0], [20, 0], [40, 0]])], [there])
    assert s.category_accuracy.value == 0.5
    assert s.category_accuracy.n == 2


def test_average_precision_by_overlap() -> None:
    # Overlaps of 1, 3.4 / 5.6 = 0.61 and 0; boxes are 4.5 m long.
    there = truth([[10, 0], [20, 0], [30, 0]])
    s = score([detections([[10, 0], [21.1, 0], [30, 1.9]], scores=[0.9, 0.8, 0.7])], [there])
    assert s.ap_20.value == 1.0
    assert s.ap_iou_50.value == pytest.approx(67 / 101)
    assert s.ap_iou_70.value == pytest.approx(34 / 101)


def test_near_what_does_not_count_a_box_is_ignored_by_overlap_too() -> None:
    there = truth([[10, 0], [20, 0]], returns=[100, 3])
    boxes = detections([[10, 0], [20, 1.9], [30, 6]], scores=[0.5, 0.9, 0.8])
    s = score([boxes], [there], np.array([[30.0, 5.0]]))
    assert s.ap_iou_70.value == 1.0


def test_objects_with_few_returns_far_off_or_of_other_families_do_not_count() -> None:
    some = truth([[10, 0], [20, 0], [70, 0], [30, 0]], returns=[100, 9, 100, 100])
    walker = truth(
        some.centres[:, :2], returns=some.lidar_returns, categories=np.array([0, 0, 0, 6])
    )
    blind = score([detections([[10, 0]])], [walker])
    assert blind.detection_rate.value == 1.0
    assert blind.detection_rate.n == 1
    seeing_all = score([detections(walker.centres[:, :2])], [walker])
    assert seeing_all.precision.value == 1.0
    assert seeing_all.false_alarms_per_frame.value == 0.0


def test_a_parked_car_is_neither_right_nor_wrong() -> None:
    frames = [detections([[10, 0], [20, 5]])]
    s = score(frames, [truth([[10, 0]])], np.array([[20.0, 6.0]]))
    assert s.precision.value == s.detection_rate.value == 1.0


def test_nothing_found_and_nothing_there() -> None:
    s = score([detections([])], [truth([])])
    assert math.isnan(s.detection_rate.value)
    assert math.isnan(s.precision.value)
    assert s.false_alarms_per_frame.value == 0.0


@given(st.integers(1, 5), st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_the_truth_itself_scores_perfectly(n, seed) -> None:
    xy = np.random.default_rng(seed).uniform(-40, 40, (n, 2))
    s = score([detections(xy)], [truth(xy)]).named()
    for name in ("detection_rate", "precision", "f1", "ap", "ap_05", "ap_iou_70"):
        assert s[name].value == 1.0
    for name in (
        "false_alarms_per_frame",
        "position_rmse_m",
        "heading_rmse_deg",
        "size_rmse_m",
        "heading_flips",
        "calibration_error",
    ):
        assert s[name].value == pytest.approx(0.0, abs=1e-9)


@given(st.integers(0, 5), st.integers(0, 5), st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_order_of_detections_and_objects_does_not_matter(n, m, seed) -> None:
    rng = np.random.default_rng(seed)
    boxes = detections(rng.uniform(-5, 5, (n, 2)), scores=rng.random(n), yaws=rng.uniform(-3, 3, n))
    real = truth(rng.uniform(-5, 5, (m, 2)), returns=rng.integers(5, 20, m))
    there = rng.permutation(m)
    shuffled = truth(
        real.centres[there, :2], ids=real.ids[there], returns=real.lidar_returns[there]
    )
    a = score([boxes], [real]).named()
    b = score([boxes.select(rng.permutation(n))], [shuffled]).named()
    for name in a:
        assert a[name].value == pytest.approx(b[name].value, nan_ok=True), name
