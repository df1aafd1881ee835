"""The descent finds what a slow one in NumPy finds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.detectors.pose.body_descent import (
    AROUND,
    LIMIT,
    SHARES,
    SLACKS_M,
    STEPS,
    WIDTH,
    descend,
    misfits_of,
    slopes_of,
)
from roadscope.detectors.pose.body_fit import CHANCES, still_problem
from roadscope.detectors.pose.body_kernels import EMPTY, HIT, Rays
from roadscope.detectors.pose.body_model import BodyModel, Storey, saloon
from roadscope.detectors.pose.body_sampling import normal_points

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


def slow_descend(problem, vectors, slacks, around=AROUND):
    """Best vectors (S, D), covariances and costs; all starts side by side, nothing compiled."""
    free = problem.free
    precision = np.diag(1.0 / problem.prior[free] ** 2)
    steps = STEPS[free]
    least = np.full(len(vectors), np.inf)
    best, normals = vectors, np.empty((len(vectors), len(free), len(free)))
    for rounds_left, slack in zip(range(len(slacks), -1, -1), (*slacks, 0.0), strict=True):
        misfit, slope = slopes_of(problem, vectors, steps, slack)
        weight = 1.0 / (1.0 + (misfit / LIMIT) ** 2)
        weighted = slope * weight[:, :, None]
        normal = np.einsum("smd,sme->sde", weighted, slope) + precision
        normal += np.diag(1.0 / ((0.3 + slack) * 30.0 * steps) ** 2)
        off = vectors - problem.centre[free]
        if slack == 0.0:
            costs = slow_costs(problem, vectors, misfit)
            better = costs < least
            least = np.where(better, costs, least)
            best = np.where(better[:, None], vectors, best)
            normals[better] = normal[better]
        if rounds_left == 0:
            break
        pull = np.einsum("smd,sm->sd", weighted, misfit) + off @ precision
        inverse = np.linalg.inv(normal)
        step = np.einsum("sde,se->sd", inverse, pull)
        root = np.linalg.cholesky(inverse)
        places = normal_points(AROUND, len(free))[0, :around]
        spread = WIDTH * np.einsum("sde,te->tsd", root, places)
        shares = np.stack([vectors - share * step for share in SHARES])
        tried = np.concatenate([shares, vectors - step + spread])
        flat = tried.reshape(-1, vectors.shape[1])
        costs = slow_costs(problem, flat, misfits_of(problem, flat, slack))
        chosen = np.argmin(costs.reshape(len(tried), -1), axis=0)
        vectors = tried[chosen, np.arange(len(vectors))]
    return best, np.linalg.inv(normals), least


def slow_costs(problem, vectors, misfit):
    off = (vectors - problem.centre[problem.free]) / problem.prior[problem.free]
    return LIMIT**2 * np.log1p((misfit / LIMIT) ** 2).sum(axis=1) + (off**2).sum(axis=1)


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
    slow, _, slow_least = slow_descend(problem, starts, slacks)
    found = descend(problem, starts, slacks)
    # Equal candidates are told apart by rounding, and lead elsewhere from there on.
    assert found.costs.min() == pytest.approx(slow_least.min(), rel=0.02, abs=0.5)
    where = found.vectors[found.costs.argmin(), :3] - slow[slow_least.argmin(), :3]
    assert np.hypot(*where[:2]) < 0.05


def test_finds_the_brick() -> None:
    problem = still_problem(rays_on(20.0, 6.0, 0.5, 0), BRICK, CHANCES)
    start = np.zeros((1, len(problem.free)))
    start[0, :3] = 20.4, 5.7, 0.7
    found = descend(problem, start).vectors[0]
    assert found[:2] == pytest.approx((20.0, 6.0), abs=0.15)
    assert found[2] == pytest.approx(0.5, abs=np.radians(1.5))


def test_one_round_is_the_same_to_rounding() -> None:
    problem = still_problem(rays_on(20.0, 6.0, 0.5, 1), BRICK, CHANCES)
    start = np.zeros((2, len(problem.free)))
    start[:, :3] = [[20.1, 5.9, 0.55], [19.9, 6.1, 0.4]]
    for around in (0, AROUND):
        slow = slow_descend(problem, start, (0.05,), around)
        found = descend(problem, start, (0.05,), around=around)
        assert found.vectors == pytest.approx(slow[0], abs=1e-9)
        assert found.costs == pytest.approx(slow[2])
        assert found.covariances == pytest.approx(slow[1], rel=1e-6, abs=1e-12)
