"""Many states side by side find rays as likely as each alone, one ray after the other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_likelihoods import log_chances

from roadscope.detectors.pose.body_fit import AS_DRAWN, CHANCES
from roadscope.detectors.pose.body_kernels import EMPTY, HIT, MOST_PARTS, PASSED, POSE, Rays
from roadscope.detectors.pose.body_lane_chances import log_likelihoods, ray_chances
from roadscope.detectors.pose.body_model import BodyModel, Storey, drawn, saloon

ALL = np.arange(11), np.zeros(11)


def tower(rng, storeys):
    """A body of so many storeys, some with gaps between them, set back at random."""
    heights = np.sort(rng.uniform(0.1, 2.0, 2 * storeys)).reshape(-1, 2)
    # Between the axles, or well beyond them: just beyond, flanks are steeper than corners.
    backs = rng.choice([0.0, 1.6], (storeys, 2)) + rng.uniform(0.0, 0.2, (storeys, 2))
    return BodyModel(
        (4.5, 0.1), (1.8, 0.05), (0.0, rng.choice([0.1, 0.3])),
        tuple(
            Storey(*ends, *back, rng.uniform(0.7, 1.0), 0.02, 0.02)
            for ends, back in zip(heights, backs, strict=True)
        ),
        narrowing=tuple(rng.uniform(0.8, 1.0, 2)),
    )  # fmt: skip


def rays_about(rng, count=150):
    """Rays from low, from over the roof and from on top of a body 8 m away, past it or near it."""
    ways = rng.normal(0.3, 0.15, count)
    height, aim = rng.choice([0.05, 1.0, 6.0], count), rng.uniform(-0.3, 2.3, count)
    origin = np.column_stack([rng.choice([0.0, 0.0, 0.0, 7.5], count), 0 * height, height])
    kind = rng.choice([HIT, PASSED, EMPTY], count)
    reach = np.select([kind == HIT, kind == PASSED], [rng.normal(6, 1.5, count), 14.0], np.inf)
    slope = np.where(rng.random(count) < 0.1, 0.0, (aim - height) / rng.uniform(5.0, 10.0, count))
    return Rays(
        origin, np.column_stack([np.cos(ways), np.sin(ways)]), slope, reach, kind.astype(np.int64),
        rng.choice([0.02, 0.5], count), rng.choice([-0.5, -0.2, 0.0, 0.05], count),
        rng.choice([0.0, 1e-3, 0.02], count),
    )  # fmt: skip


def states_about(rng, count, turn):
    vectors = rng.standard_normal((count, 11))
    vectors[:, :2] = 8 * np.array([np.cos(0.3), np.sin(0.3)]) + 0.3 * vectors[:, :2]
    vectors[:, 3], vectors[:, 4] = 2 * vectors[:, 3], turn * vectors[:, 4]
    # A sharp body.
    vectors[0, 8] = -1.0
    return vectors


@pytest.mark.parametrize("turn", [0.0, 0.3, 3.0], ids=["straight", "turning", "spinning"])
@given(
    seed=st.integers(0, 2**32 - 1),
    storeys=st.integers(1, MOST_PARTS),
    count=st.sampled_from([1, 15, 40, 50, 97]),
    soft=st.sampled_from([1.0, 10.0]),
)
@settings(max_examples=30, deadline=None)
def test_every_lane_is_a_state_alone(turn, seed, storeys, count, soft) -> None:
    rng = np.random.default_rng(seed)
    model = tower(rng, storeys)
    vectors, rays = states_about(rng, count, turn), rays_about(rng)
    chances = AS_DRAWN._replace(edge_m=soft * AS_DRAWN.edge_m, height_m=soft * AS_DRAWN.height_m)
    alone = np.empty((count, len(rays.slope)))
    parts = model.parts(vectors[:, POSE:])
    log_chances(vectors[:, :POSE].copy(), parts, (rays, chances), alone)
    each = ray_chances(vectors, drawn(model), ALL, (rays, chances))
    assert np.log(each) == pytest.approx(alone, rel=1e-9, abs=1e-8)
    total = log_likelihoods(vectors, drawn(model), ALL, (rays, chances))
    assert total == pytest.approx(alone.sum(axis=1), rel=1e-9)


def test_what_is_not_free_is_as_it_was_fixed() -> None:
    rng = np.random.default_rng(0)
    model, rays, vectors = (
        saloon((4.5, 0.3), (1.8, 0.1)),
        rays_about(rng),
        states_about(rng, 9, 0.3),
    )
    free, told = np.array([4, 0, 7]), (rays, CHANCES)
    fixed = vectors[0].copy()
    vectors[:, [k for k in range(11) if k not in free]] = np.delete(fixed, free)
    some = log_likelihoods(vectors[:, free].copy(), drawn(model), (free, fixed), told)
    assert np.array_equal(some, log_likelihoods(vectors, drawn(model), ALL, told))
    assert len(log_likelihoods(vectors[:0], drawn(model), ALL, told)) == 0


def test_a_mirrored_scene_is_as_likely() -> None:
    rng = np.random.default_rng(1)
    model, rays, vectors = tower(rng, 3), rays_about(rng, 600), states_about(rng, 40, 0.3)
    flip = np.array([1.0, -1.0])
    other = rays._replace(origin=rays.origin * [1.0, -1.0, 1.0], direction=rays.direction * flip)
    turned = vectors.copy()
    turned[:, [1, 2, 4]] *= -1.0
    each = ray_chances(vectors, drawn(model), ALL, (rays, CHANCES))
    assert ray_chances(turned, drawn(model), ALL, (other, CHANCES)) == pytest.approx(each)
