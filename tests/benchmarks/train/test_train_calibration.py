import numpy as np
from toy_pictures import toy_pictures

from roadscope.benchmarks.train import PRIOR, PixelSize, fitted_calibration, logistic
from roadscope.detectors.camera import TRAITS, Peaks


def test_a_known_curve_is_found_again() -> None:
    rng = np.random.default_rng(0)
    terms = np.column_stack([np.ones(40000), rng.normal(0, 1, (40000, 2))])
    known = np.array([-1.2, 0.7, 0.4])
    right = rng.random(40000) < 1 / (1 + np.exp(-terms @ known))
    np.testing.assert_allclose(logistic(terms, right, np.zeros(3)), known, atol=0.05)


def test_what_is_found_has_no_slope_left() -> None:
    """At the weights that are most likely, prior included."""
    rng = np.random.default_rng(1)
    terms, start = rng.normal(0, 1, (300, 5)), rng.normal(0, 1, 5)
    right = rng.random(300) < 0.4
    weights = logistic(terms, right, start)
    slope = terms.T @ (right - 1 / (1 + np.exp(-terms @ weights))) - PRIOR * (weights - start)
    np.testing.assert_allclose(slope, 0, atol=1e-6)


def test_without_detections_heat_stays_as_it_is() -> None:
    start = np.array([0.0, 1.0])
    assert logistic(np.empty((0, 2)), np.empty(0, bool), start).tolist() == [0.0, 1.0]
    heat = np.zeros((3, len(TRAITS)))
    heat[:, 0] = [-1.0, 0.0, 2.0]
    scores = fitted_calibration([], []).scores(heat, np.arange(3))
    np.testing.assert_allclose(scores, 1 / (1 + np.exp([1.0, 0.0, -2.0])))


def test_each_family_has_its_own_curve() -> None:
    pictures = toy_pictures(0, 60, PixelSize(320, 640))
    peaks = [
        Peaks(
            # People are always right, cars never.
            x.boxes + np.where(x.families == 0, 1000.0, 0.0)[:, None],
            x.families,
            x.categories,
            np.zeros((len(x), len(TRAITS))),
        )
        for x in pictures.labels
    ]
    scores = fitted_calibration(peaks, pictures.labels).scores(
        np.zeros((3, len(TRAITS))), np.arange(3)
    )
    assert scores[0] < 0.25
    assert scores[2] > 0.75
    assert scores[1] == 0.5


def test_boxes_beside_surer_ones_are_worth_less_where_they_are_wrong() -> None:
    """As sure by the heat, but one of two shows again what the other shows."""
    pictures, rng = toy_pictures(1, 60, PixelSize(320, 640)), np.random.default_rng(1)
    peaks = []
    for x in pictures.labels:
        traits = np.zeros((2 * len(x), len(TRAITS)))
        traits[len(x) :, 1] = 0.4
        traits[:, 0] = rng.normal(0, 1, 2 * len(x))
        boxes = np.concatenate([x.boxes, x.boxes + 20.0])
        peaks.append(Peaks(boxes, np.tile(x.families, 2), np.tile(x.categories, 2), traits))
    worth = fitted_calibration(peaks, pictures.labels)
    alone, again = np.zeros((2, 1, len(TRAITS)))
    again[0, 1] = 0.4
    assert worth.scores(alone, np.zeros(1, int)) > 0.7
    assert worth.scores(again, np.zeros(1, int)) < 0.3
