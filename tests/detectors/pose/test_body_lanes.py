"""Many states side by side say to the bit what each says alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_misfits import misfits

from roadscope.detectors.pose.body_descent import LIMIT, SLACKS_M, space_of
from roadscope.detectors.pose.body_descent_kernels import Rules, descended, lowest
from roadscope.detectors.pose.body_fit import CHANCES, still_problem
from roadscope.detectors.pose.body_kernels import EMPTY, HIT, PASSED, POSE, Rays
from roadscope.detectors.pose.body_lane_misfits import lane_misfits
from roadscope.detectors.pose.body_lanes import LANES, PARTS, draw, even, lay, new_room, stand
from roadscope.detectors.pose.body_model import BodyModel, Storey, drawn, saloon

BODIES = (
    saloon((4.5, 0.3), (1.8, 0.1)),
    BodyModel((4.5, 0.3), (1.8, 0.1), storeys=(Storey(0.0, 2.0),)),
    BodyModel((12.0, 0.8), (2.5, 0.1), (0.0, 0.3), (Storey(0.15, 3.1),), narrowing=(0.9, 0.8)),
)


def rays_about(rng, count=60, bearing=0.3):
    """Rays of a sensor at the origin around something 20 m away, near its surface and beside."""
    ways = bearing + rng.uniform(-0.3, 0.3, count)
    # As exact as a toy scene: a ray along an axis of the body.
    ways[0] = 0.0
    kind = rng.choice([HIT, PASSED, EMPTY], count)
    reach = np.select([kind == HIT, kind == PASSED], [rng.normal(19, 1.5, count), 35.0], np.inf)
    return Rays(
        np.tile([0.0, 0.0, 1.4], (count, 1)), np.column_stack([np.cos(ways), np.sin(ways)]),
        rng.uniform(-0.08, 0.05, count), reach, kind.astype(np.int64),
        np.full(count, 0.03), rng.uniform(-0.05, 0.05, count), rng.choice([0.0, 1e-3], count),
    )  # fmt: skip


def states_about(rng, count, turn, bearing=0.3):
    vectors = rng.standard_normal((count, 11))
    vectors[:, :3] *= 0.4
    vectors[:, :2] += 20 * np.array([np.cos(bearing), np.sin(bearing)])
    vectors[:, 3], vectors[:, 4] = 10 + vectors[:, 3], turn * vectors[:, 4]
    # A sharp body, and one that stands square to the first ray.
    vectors[0, 8], vectors[-1, 2] = -1.0, 0.0
    return vectors


def lanes_of(vectors, model, rays, noise_m):
    """Parts (K, P, 16) and misfits (K, M) from the lanes."""
    body, count = drawn(model), len(vectors)
    room = new_room(len(model.storeys))
    out, lanes = np.empty((len(rays.slope), LANES)), even(count)
    lay(vectors, np.arange(11), np.zeros(11), room)
    turns = stand(lanes, room)
    draw(body, lanes, room)
    lane_misfits(rays, noise_m, (lanes, turns), body.storeys, (room, out))
    told = room[PARTS:].reshape(len(model.storeys), 16, LANES)[:, :, :count]
    return np.moveaxis(told, 2, 0), out[:, :count].T


@pytest.mark.parametrize("model", BODIES, ids=["saloon", "brick", "lorry"])
@pytest.mark.parametrize("turn", [0.0, 0.3])
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, LANES))
@settings(max_examples=15, deadline=None)
def test_every_lane_is_a_state_alone(model, turn, seed, count) -> None:
    rng = np.random.default_rng(seed)
    vectors, rays = states_about(rng, count, turn), rays_about(rng)
    parts, alone = model.parts(vectors[:, POSE:]), np.empty((count, len(rays.slope)))
    misfits(vectors[:, :POSE].copy(), parts, rays, (0.03, 0.036), alone)
    lane_parts, lane_misfit = lanes_of(vectors, model, rays, (0.03, 0.036))
    assert np.array_equal(lane_parts, parts)
    # Where a body has turned by then is found by a series, exact but for the last bits.
    assert np.allclose(lane_misfit, alone, rtol=1e-9 if turn else 0.0, atol=1e-9 if turn else 0.0)
    assert (alone != 0).any()


@pytest.mark.parametrize("model", BODIES, ids=["saloon", "brick", "lorry"])
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 6), ways=st.sampled_from([1, 2]))
@settings(max_examples=5, deadline=None)
def test_the_lowest_are_those_of_the_descent(model, seed, count, ways) -> None:
    rng = np.random.default_rng(seed)
    rays = rays_about(rng)
    problem = still_problem(rays, model, CHANCES)
    starts = states_about(rng, count, 0.0)[:, problem.free].copy()
    asked = drawn(model), space_of(problem, around=8, ways=ways), (rays, Rules(LIMIT, 0.006))
    slacks = np.array([*SLACKS_M[4:], 0.0])
    best, _, costs = descended(starts, slacks, *asked)
    only, least = lowest(starts, slacks, *asked)
    assert np.array_equal(only, best)
    assert np.array_equal(least, costs)
    for row, vector in enumerate(best):
        alone, _, _ = descended(starts[row : row + 1], slacks, *asked)
        assert np.array_equal(alone[0], vector)
