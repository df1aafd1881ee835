"""Our traffic equals its slow twin of objects."""

import numpy as np
import pytest

from research.traffic_twin import TWINS, builder, pile_up, play_both, same_decisions

QUICK = "roundabout"
EACH = [
    (name, 3.0) if name == QUICK else pytest.param(name, 20.0, marks=pytest.mark.slow)
    for name in TWINS
]


@pytest.mark.parametrize(("name", "duration_s"), EACH)
def test_states_and_decisions_are_those_of_objects(name, duration_s):
    build = builder(name)
    fast, slow = play_both(lambda: build(np.random.default_rng(7)), duration_s)
    assert same_decisions(fast, slow)
    np.testing.assert_allclose(fast.axles, slow.axles, atol=1e-9, rtol=0)
    np.testing.assert_allclose(fast.yaws, slow.yaws, atol=1e-9, rtol=0)
    np.testing.assert_allclose(fast.speeds, slow.speeds, atol=1e-9, rtol=0)
    np.testing.assert_array_equal(fast.sizes, slow.sizes)


@pytest.mark.parametrize("aside_m", [0.0, 1.7])
def test_collisions_are_those_of_objects(aside_m):
    fast, slow = play_both(lambda: pile_up(aside_m), 4.0)
    assert fast.crashed[-1].sum() >= 2
    assert not fast.crashed[0].any()
    np.testing.assert_array_equal(fast.crashed, slow.crashed)
    np.testing.assert_allclose(fast.axles, slow.axles, atol=1e-9, rtol=0)
    np.testing.assert_allclose(fast.yaws, slow.yaws, atol=1e-9, rtol=0)
