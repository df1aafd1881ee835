"""What every ground removal promises, whatever it is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_lidar import CALIBRATION, scan

from roadscope.detectors import Cloud
from roadscope.detectors.ground import GROUNDS

POSE = CALIBRATION.pose("lux")
CARS = [(22, 1, 4.6, 1.85, 1.5, 0.1), (12, -6, 4.6, 1.85, 1.5, 1.57)]

every = pytest.mark.parametrize("ground", GROUNDS.values(), ids=list(GROUNDS))


@every
@given(seed=st.integers(0, 2**32 - 1))
def test_order_of_the_returns_changes_nothing(ground, seed):
    sweep = scan(CARS, noise_m=0.03)
    order = np.random.default_rng(seed).permutation(len(sweep))
    shuffled = Cloud.of(sweep.select(order), POSE)
    assert np.array_equal(ground(shuffled), ground(Cloud.of(sweep, POSE)))


@every
def test_copies_change_nothing(ground):
    sweep = scan(CARS, noise_m=0.03)
    doubled = Cloud.of(sweep.select(np.repeat(np.arange(len(sweep)), 2)), POSE)
    assert np.array_equal(ground(doubled)[::2], ground(Cloud.of(sweep, POSE)))
    assert np.array_equal(ground(doubled)[::2], ground(doubled)[1::2])


@every
@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_returns(ground, count):
    mask = ground(Cloud.of(scan(CARS).select(np.arange(count)), POSE))
    assert mask.dtype == np.bool_
    assert mask.shape == (count,)


@every
def test_bodies_stand(ground):
    returns = Cloud.of(scan(CARS, noise_m=0.03), POSE)
    above = returns.points[:, 2] > 0.4
    assert above.sum() > 100
    assert ground(returns)[above].all()
