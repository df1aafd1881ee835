"""Scores pool by weight and power, and survive JSON."""

import json
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from roadscope.benchmarks.metrics import Score, mean, ratio, rms
from roadscope.benchmarks.results import merged

PARTS = st.lists(st.lists(st.floats(0, 100), min_size=1, max_size=8), min_size=1, max_size=6)


@given(PARTS)
def test_pooled_scores_are_those_of_all_samples(parts):
    """Of a mean, of a share and of a root mean square, which pool in different ways."""
    together = np.concatenate(parts)
    kinds = {
        "mean": lambda v: mean(sum(v), len(v), "m"),
        "share": lambda v: ratio(sum(x > 50 for x in v), len(v)),
        "rms": lambda v: rms(sum(x * x for x in v), len(v), "m"),
    }
    for kind, score in kinds.items():
        expected = score(together.tolist())
        pooled = merged([score(part) for part in parts])
        assert math.isclose(pooled.value, expected.value, rel_tol=1e-9, abs_tol=1e-9), kind
        assert pooled.n == expected.n


@given(
    st.floats(), st.sampled_from(["higher", "lower"]), st.integers(0, 9), st.sampled_from([1, 2])
)
def test_json_brings_the_score_back(value, better, n, power):
    score = Score(value, "m", better, n, power=power)
    back = Score.from_json(json.loads(json.dumps(score.to_json(), allow_nan=False)))
    finite = math.isfinite(value)
    assert back == score if finite else math.isnan(back.value)
    assert (back.least, back.most, back.weight, back.power) == (0.0, math.inf, 1.0, power)
