import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from roadscope.benchmarks.metrics import image_overlaps
from roadscope.detectors.camera import (
    AGREEING_IOU,
    TERM_COUNT,
    TRAITS,
    VOTING_IOU,
    Answers,
    BoxCalibration,
    averaged,
    distinct,
)


def slowly(
    boxes: np.ndarray, families: np.ndarray, heat: np.ndarray, chosen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Box by box, as the docstrings say."""
    chances, overlaps = 1 / (1 + np.exp(-heat)), image_overlaps(boxes, boxes)
    voted, traits = np.zeros((len(chosen), 4)), np.zeros((len(chosen), len(TRAITS)))
    for k, row in enumerate(chosen):
        alike = (families == families[row]) & (overlaps[row] > AGREEING_IOU)
        same = alike & (overlaps[row] > VOTING_IOU)
        voted[k] = np.average(boxes[same], axis=0, weights=(chances * overlaps[row])[same])
        traits[k, 7] = np.log(1 + chances[alike].sum())
        traits[k, 8] = np.average(overlaps[row][alike], weights=chances[alike])
    beside = image_overlaps(voted, voted)
    for k, row in enumerate(chosen):
        surer = [j for j in range(k) if families[chosen[j]] == families[row]]
        others = [j for j, o in enumerate(chosen) if families[o] != families[row]]
        for at, rivals in ((1, surer), (3, others)):
            if rivals and beside[k, rivals].max() > 0:
                best = rivals[int(beside[k, rivals].argmax())]
                traits[k, at] = beside[k, best]
                traits[k, at + 1] = beside[k, best] * (heat[chosen[best]] - heat[row])
        width, height = voted[k, 2:] - voted[k, :2]
        traits[k, 0], traits[k, 5], traits[k, 6] = heat[row], np.log(height), np.log(width / height)
    return voted, traits


@given(st.integers(0, 2**32 - 1), st.sampled_from([0, 1, 40]))
def test_what_is_around_a_box_is_that_of_its_definition(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(0, 40, (count, 2))
    boxes = np.concatenate([corners, corners + rng.uniform(10, 30, (count, 2))], axis=1)
    families, heat = rng.integers(0, 3, count), -np.sort(-rng.normal(0, 2, count)).round(1)
    distinct_rows = distinct(boxes, families, 0.6)
    expected = slowly(boxes, families, heat, distinct_rows)
    averages = averaged(Answers(boxes, families, heat), distinct_rows)
    for got, wanted in zip(averages, expected, strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9)


def test_without_a_calibration_scores_are_the_heat() -> None:
    traits = np.random.default_rng(0).uniform(-3, 3, (9, len(TRAITS)))
    scores = BoxCalibration().scores(traits, np.arange(9) % 3)
    np.testing.assert_allclose(scores, 1 / (1 + np.exp(-traits[:, 0])))


def test_scores_follow_the_terms_of_their_family() -> None:
    middles, spreads = np.arange(9.0), np.full(9, 2.0)
    weights = np.zeros((3, TERM_COUNT))
    weights[1, 0], weights[1, 2] = 0.5, 1.0
    # The last term is the square of the last trait.
    weights[2, -1] = 0.25
    traits = np.tile(middles, (3, 1))
    traits[1, 1] += 2.0
    traits[2, 8] += 400.0
    scores = BoxCalibration(middles, spreads, weights).scores(traits, np.arange(3))
    np.testing.assert_allclose(scores, 1 / (1 + np.exp([0.0, -1.5, -4.0])))
