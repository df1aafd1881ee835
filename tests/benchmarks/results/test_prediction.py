"""Which metrics of perception predict those of driving."""

import io
import json

import numpy as np
import pytest
from rich.console import Console

from roadscope.benchmarks.metrics import Score
from roadscope.benchmarks.report import prediction_note, prediction_rows, prediction_table
from roadscope.benchmarks.results import JobScores, predictions, results_of

STACKS = ("a", "b", "c", "d", "e")
RECALL, COLLIDED = [0.1, 0.3, 0.5, 0.7, 0.9], [0.5, 0.4, 0.3, 0.1, 0.2]


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


def predictions_of(scores):
    return {(each.metric, each.predicted): each for each in predictions(scores, "driving")}


def test_a_better_recall_with_fewer_collisions_is_a_correlation_of_one() -> None:
    scores = jobs([0.1, 0.3, 0.5, 0.7, 0.9], [0.5, 0.4, 0.3, 0.2, 0.1])
    both = predictions_of(scores)
    assert both["recall", "collided"].rho == pytest.approx(1.0)
    assert both["recall", "reward"].rho == pytest.approx(1.0)
    assert both["recall", "reward"].inputs == len(STACKS)
    reverse = predictions_of(jobs([0.9, 0.7, 0.5, 0.3, 0.1], [0.5, 0.4, 0.3, 0.2, 0.1]))
    assert reverse["recall", "collided"].rho == pytest.approx(-1.0)


def test_noise_widens_the_interval_and_one_seed_has_none() -> None:
    exact = predictions_of(jobs([0.1, 0.3, 0.5, 0.7, 0.9], [0.5, 0.4, 0.3, 0.2, 0.1]))
    noisy = predictions_of(jobs([0.1, 0.3, 0.5, 0.7, 0.9], [0.5, 0.4, 0.3, 0.2, 0.1], noise=0.5))
    one, other = (each["recall", "collided"].over_seeds for each in (exact, noisy))
    assert one == pytest.approx((1.0, 1.0))
    assert other[1] - other[0] > 0.1
    single = predictions_of(jobs([0.1, 0.3, 0.5, 0.7, 0.9], [0.5, 0.4, 0.3, 0.2, 0.1], seeds=1))
    assert single["recall", "collided"].over_seeds is None


@pytest.mark.parametrize("seeds", [2, 8])
def test_few_stacks_have_a_wide_interval_however_many_seeds(seeds) -> None:
    prediction = predictions_of(jobs(RECALL, COLLIDED, seeds=seeds))["recall", "collided"]
    assert prediction.rho == pytest.approx(0.9)
    # Bonett and Wright 2000: tanh(artanh(0.9) -+ 1.96 * sqrt((1 + 0.9**2 / 2) / 2)).
    assert prediction.over_inputs == pytest.approx((-0.1689, 0.9961), abs=1e-3)
    assert prediction.over_seeds == pytest.approx((0.9, 0.9))


def test_a_stack_without_a_value_is_not_counted() -> None:
    scores = jobs([0.1, 0.3, 0.5, 0.7, float("nan")], COLLIDED)
    assert predictions_of(scores)["recall", "collided"].inputs == len(STACKS) - 1


def test_both_intervals_are_printed_in_80_columns_and_kept_in_the_json() -> None:
    results = results_of(jobs(RECALL, COLLIDED), {"suite": "tiny"})
    rows = prediction_rows(results, "driving")
    assert ["collided", "recall", "0.90", "[-.17, 1.00]", "[.90, .90]"] in rows
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(prediction_table(results, "driving"))
    lines = console.export_text().splitlines()
    assert max(map(len, lines)) <= 80
    assert any(line.split()[:2] == ["collided", "recall"] for line in lines)
    assert "over stacks" in lines[0]
    assert "over stacks" in prediction_note(results, "driving")
    written_predictions = json.loads(results.to_json())["predictions"]
    assert {(each["metric"], each["predicted"]) for each in written_predictions} == {
        ("recall", "reward"),
        ("recall", "collided"),
    }
    assert all(
        len(each["over_inputs"]) == len(each["over_seeds"]) == 2 for each in written_predictions
    )


def test_nothing_is_said_where_nothing_varies_or_of_other_boards() -> None:
    alike = predictions_of(jobs([0.1, 0.3, 0.5, 0.7, 0.9], [0.2] * 5))
    assert ("recall", "collided") not in alike
    assert predictions(jobs([0.1] * 5, [0.2] * 5), "tracking") == []
