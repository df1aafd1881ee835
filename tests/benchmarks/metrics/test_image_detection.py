from dataclasses import replace

import numpy as np
import pytest
from toy_boxes import image_detections, truth

from roadscope.benchmarks.metrics import PARKED, Labels, ParkedBoxes, labels_of, score_images
from roadscope.core import ImageDetections, Pose

CAR, CYCLIST, PERSON = 0, 5, 6


def labels(*rows: tuple[list[float], int, int, float]) -> Labels:
    """Rows of box, category, visible pixels, range."""
    boxes, categories, pixels, ranges = zip(*rows, strict=True) if rows else ((), (), (), ())
    return Labels(
        np.array(boxes, float).reshape(-1, 4),
        np.array(categories, np.int64),
        np.array(pixels, np.int64),
        np.zeros(len(rows)),
        np.array(ranges, float),
    )


def detections_of(*rows: tuple[list[float], int, float]) -> ImageDetections:
    boxes, categories, scores = zip(*rows, strict=True) if rows else ((), (), ())
    return image_detections(boxes, categories=categories, scores=scores)


A, B, C = [0.0, 0, 40, 30], [100.0, 100, 120, 150], [300.0, 10, 330, 20]


def test_a_label_at_the_end_of_a_range_is_in_the_next_one_alone() -> None:
    truth = labels((A, CAR, 500, 25.0), (B, CAR, 500, 50.0))
    scores = score_images([detections_of((A, CAR, 1.0), (B, CAR, 1.0))], [truth]).named()
    counts = [scores[f"ap50_{range_}"].n for range_ in ("near", "middle", "far")]
    assert counts == [0, 1, 1]


def test_perfect_detections_have_perfect_scores() -> None:
    truth = labels((A, CAR, 500, 10.0), (B, PERSON, 500, 30.0), (C, CYCLIST, 100, 70.0))
    scores = score_images(
        [detections_of((A, CAR, 1.0), (B, PERSON, 1.0), (C, CYCLIST, 1.0))], [truth]
    )
    for name in (
        "ap50",
        "ap",
        "ap50_near",
        "ap50_far",
        "detection_rate_cyclist",
        "category_accuracy",
        "ap50_16px",
    ):
        assert scores.named()[name].value == pytest.approx(1.0)
    assert scores.false_alarms.value == 0.0
    assert scores.calibration_error.value == 0.0
    assert scores.objects_per_image.value == 3.0
    assert scores.ap50_16px.n == 2
    assert np.isnan(scores.ap50_large.value)


def test_another_family_is_a_miss_and_a_false_alarm() -> None:
    scores = score_images([detections_of((B, CYCLIST, 0.9))], [labels((B, PERSON, 500, 9.0))])
    assert scores.detection_rate_pedestrian.value == 0.0
    assert scores.false_alarms_cyclist.value == 1.0
    assert scores.ap50.value == 0.0


def test_another_category_of_the_family_is_found_but_not_named() -> None:
    scores = score_images([detections_of((A, 2, 0.9))], [labels((A, CAR, 500, 9.0))])
    assert scores.detection_rate_vehicle.value == 1.0
    assert scores.category_accuracy.value == 0.0


def test_parked_and_hardly_visible_objects_do_not_count() -> None:
    truth = labels((A, PARKED, -1, 9.0), (B, PERSON, 5, 9.0), (C, CAR, 100, 9.0))
    scores = score_images([detections_of((A, CAR, 0.9), (B, PERSON, 0.9))], [truth])
    assert scores.false_alarms.value == 0.0
    assert scores.objects_per_image.value == 1.0
    assert scores.detection_rate.value == 0.0


def test_precision_by_how_much_is_hidden_asks_for_those_alone() -> None:
    truth = labels((A, CAR, 500, 9.0), (B, CAR, 500, 9.0), (C, CAR, 100, 9.0))
    truth = replace(truth, occluded=np.array([0.1, 0.3, 0.6]))
    scores = score_images([detections_of((A, CAR, 0.9), (C, CAR, 0.8))], [truth])
    assert scores.ap50_visible.value == pytest.approx(1.0)
    assert scores.ap50_partly.value == 0.0
    assert scores.ap50_largely.value == pytest.approx(1.0)
    assert [scores.named()[f"ap50_{n}"].n for n in ("visible", "partly", "largely")] == [1, 1, 1]


def test_unsure_detections_count_for_precision_alone() -> None:
    truth = labels((A, CAR, 500, 9.0))
    scores = score_images([detections_of((A, CAR, 0.3), (C, CAR, 0.2))], [truth])
    assert scores.ap50.value == pytest.approx(1.0)
    assert scores.detection_rate.value == 0.0
    assert scores.false_alarms.value == 0.0


def test_nothing_at_all_is_not_a_number() -> None:
    scores = score_images([detections_of()], [labels()])
    assert np.isnan(scores.ap50.value)
    assert scores.false_alarms.value == 0.0


def test_labels_are_of_visible_objects() -> None:
    scene = truth(
        [[3.0, 4, 1]] * 3,
        categories=np.array([CAR, PERSON, CAR]),
        returns=0,
        visible_pixels=np.array([90, 0, 90]),
        world_from_ego=Pose.planar(0.0, 0.0, 0.0),
        image_boxes=np.array([A, B, [5.0, 5, 5, 9]]),
    )
    made = labels_of(scene, ParkedBoxes(np.array([C]), np.array([40.0])))
    assert made.categories.tolist() == [CAR, PARKED]
    assert made.ranges_m.tolist() == [5.0, 40.0]
    assert made.eligible.tolist() == [True, False]


def test_objects_lost_in_fog_are_not_required() -> None:
    labelled = labels((A, CAR, 500, 30.0), (B, PERSON, 500, 130.0))
    assert labelled.in_air(0.0) == labelled
    assert labelled.in_air(3.0 / 100).eligible.tolist() == [True, False]
