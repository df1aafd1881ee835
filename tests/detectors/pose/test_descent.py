"""The compiled descent finds what the descent in NumPy finds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.detectors.pose.body_descent import SLACKS_M, descend
from roadscope.detectors.pose.body_fit import CHANCES, still_problem
from roadscope.detectors.pose.body_kernels import EMPTY, HIT, Rays
from roadscope.detectors.pose.body_model import BodyModel, Storey, saloon
from roadscope.detectors.pose.descent import descend_compiled

BRICK = BodyModel((4.5, 0.3), (1.8, 0.1), (0.0, 0.3), (Storey(0.15, 1.5),))


def rays_on(x, y, yaw, seed):
    """Rays of a sensor at the origin that fan over a brick of 4.5 x 1.8 m; some pass beside it."""
    rng = np.random.default_rng(seed)
    bearings = np.arctan2(y, x) + np.linspace(-2.8, 2.8, 40) / np.hypot(x, y)
    ways = np.column_stack([np.cos(bearings), np.sin(bearings)])
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    start, along = turn @ -np.array([x, y]), ways @ turn.T
    half = np.array([2.25, 0.9])
    with np.errstate(divide="ignore"):
        crossed = np.stack([(-half - start) / along, (half - start) / along])
    near, far = crossed.min(axis=0).max(axis=1), crossed.max(axis=0).min(axis=1)
    met = near < far
    reach = np.where(met, near + 0.02 * rng.standard_normal(len(near)), np.inf)
    count = len(near)
    return Rays(
        np.tile([0.0, 0.0, 1.0], (count, 1)), ways, np.full(count, -0.01), reach,
        np.where(met, HIT, EMPTY).astype(np.int64), np.full(count, 0.02), np.zeros(count),
        np.zeros(count),
    )  # fmt: skip


@pytest.mark.parametrize("slacks", [SLACKS_M, SLACKS_M[3:]])
@pytest.mark.parametrize("free", [np.arange(3), None])
@given(
    distance=st.floats(12, 50), bearing=st.floats(-3, 3), yaw=st.floats(-3, 3),
    seed=st.integers(0, 2**32 - 1), drawn=st.sampled_from([BRICK, saloon((4.5, 0.3), (1.8, 0.1))]),
)  # fmt: skip
@settings(max_examples=6, deadline=None)
def test_agrees_with_the_slow_reference(free, slacks, distance, bearing, yaw, seed, drawn) -> None:
    x, y = distance * np.cos(bearing), distance * np.sin(bearing)
    problem = still_problem(rays_on(x, y, yaw, seed), drawn, CHANCES, free)
    starts = np.zeros((2, len(problem.free)))
    starts[:, :3] = [[x + 0.2, y - 0.1, yaw + 0.1], [x - 0.3, y, yaw - 0.15]]
    slow = descend(problem, starts, slacks)
    vectors, costs = descend_compiled(problem, starts, slacks)
    # Equal candidates are told apart by rounding, and lead elsewhere from there on.
    assert costs.min() == pytest.approx(slow.costs.min(), rel=0.02, abs=0.5)
    where = vectors[costs.argmin(), :3] - slow.vectors[slow.costs.argmin(), :3]
    assert np.hypot(*where[:2]) < 0.05


def test_finds_the_brick() -> None:
    problem = still_problem(rays_on(20.0, 6.0, 0.5, 0), BRICK, CHANCES)
    start = np.zeros((1, len(problem.free)))
    start[0, :3] = 20.4, 5.7, 0.7
    vectors, _ = descend_compiled(problem, start)
    assert vectors[0, :2] == pytest.approx((20.0, 6.0), abs=0.15)
    assert vectors[0, 2] == pytest.approx(0.5, abs=np.radians(1.5))
