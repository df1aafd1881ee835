"""Which metrics of perception predict those of driving."""

import numpy as np
import pytest

from roadscope.benchmarks.metrics import Score
from roadscope.benchmarks.results import JobScores, predictions

STACKS = ("a", "b", "c", "d", "e")


def jobs(recall, collided, *, seeds=4, noise=0.0):
    """Scores of stacks with a given recall and share of collisions, each with two drivers."""
    rng = np.random.default_rng(0)
    return [
        JobScores(
            "driving",
            f"{driver} on {stack}",
            "motorway",
            seed,
            "clear",
            stack,
            {
                "recall": Score(recall[k] + noise * rng.standard_normal(), "1", "higher", 10),
                "collided": Score(collided[k], "1", "lower", 1),
                "reward": Score(1.0 - collided[k], "1", "higher", 1),
            },
            None,
        )
        for k, stack in enumerate(STACKS)
        for driver in ("idm", "emergency-brake")
        for seed in range(seeds)
    ]


def found(scores):
    return {(each.metric, each.predicted): each for each in predictions(scores, "driving")}


def test_a_better_recall_with_fewer_collisions_is_a_correlation_of_one() -> None:
    scores = jobs([0.1, 0.3, 0.5, 0.7, 0.9], [0.5, 0.4, 0.3, 0.2, 0.1])
    both = found(scores)
    assert both["recall", "collided"].rho == pytest.approx(1.0)
    assert both["recall", "reward"].rho == pytest.approx(1.0)
    assert both["recall", "reward"].inputs == len(STACKS)
    reverse = found(jobs([0.9, 0.7, 0.5, 0.3, 0.1], [0.5, 0.4, 0.3, 0.2, 0.1]))
    assert reverse["recall", "collided"].rho == pytest.approx(-1.0)


def test_noise_widens_the_interval_and_one_seed_has_none() -> None:
    exact = found(jobs([0.1, 0.3, 0.5, 0.7, 0.9], [0.5, 0.4, 0.3, 0.2, 0.1]))
    noisy = found(jobs([0.1, 0.3, 0.5, 0.7, 0.9], [0.5, 0.4, 0.3, 0.2, 0.1], noise=0.5))
    one, other = exact["recall", "collided"], noisy["recall", "collided"]
    assert one.low == one.high == pytest.approx(1.0)
    assert other.high - other.low > 0.1
    single = found(jobs([0.1, 0.3, 0.5, 0.7, 0.9], [0.5, 0.4, 0.3, 0.2, 0.1], seeds=1))
    assert np.isnan(single["recall", "collided"].low)


def test_nothing_is_said_where_nothing_varies_or_of_other_boards() -> None:
    alike = found(jobs([0.1, 0.3, 0.5, 0.7, 0.9], [0.2] * 5))
    assert ("recall", "collided") not in alike
    assert predictions(jobs([0.1] * 5, [0.2] * 5), "tracking") == []
