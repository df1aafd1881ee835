import tomllib

import numpy as np

from research.fusion_weights import logistic_weights, multinomial_weights, source
from roadscope.fusion import OddsModel, SecondOrderModel, second_order, table


def test_logistic_weights_are_recovered() -> None:
    rng = np.random.default_rng(0)
    values = rng.standard_normal((20_000, 2))
    truth = np.array([-0.5, 1.5, -1.0])
    chances = 1 / (1 + np.exp(-OddsModel(truth).odds(values)))
    weights = logistic_weights(values, rng.random(len(values)) < chances)
    assert np.abs(weights - truth).max() < 0.08


def test_class_chances_follow_the_shares() -> None:
    rng = np.random.default_rng(1)
    values = rng.uniform(-1, 1, (8000, 1))
    label = np.where(rng.random(8000) < 0.8, (values[:, 0] > 0) * 2, 3)
    weights = multinomial_weights(second_order(values), label)
    model = SecondOrderModel(np.zeros(1), np.ones(1), weights)
    high, low = model.probabilities(np.array([[0.8], [-0.8]]))
    assert high[2] > 0.7
    assert low[0] > 0.7
    assert abs(high[3] - 0.2) < 0.05
    assert max(high[1], low[1]) < 0.01


def test_what_ships_is_read_as_it_was_written_and_says_where_it_is_from() -> None:
    shipped = dict(table())
    origin = shipped.pop("origin")
    assert "train seeds" in origin
    assert "noisy-camera" in origin
    assert tomllib.loads(source(shipped, origin)) == {"origin": origin, **shipped}
