import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope.odometry.clusters import LEAST, MOST, NOISE_M, limit_of, ring_roughness
from roadscope.odometry.loam import sweep_of


def ring_roughness_slowly(points, ring, column, labels, window_m):
    """Eq. 6, neighbour by neighbour."""
    rough = np.full(len(points), np.nan)
    for n in range(len(points)):
        own = np.flatnonzero(ring == ring[n])
        own = own[np.argsort(column[own], kind="stable")]
        at = int(np.flatnonzero(own == n)[0])
        sides = []
        for side in (own[:at][::-1], own[at + 1 :]):
            count = 0
            for m in side[:MOST]:
                far = np.linalg.norm(points[m] - points[n]) > window_m
                if labels[m] != labels[n] or (count >= LEAST and far):
                    break
                count += 1
            sides.append(count)
        if min(sides) >= LEAST:
            near = own[at - min(sides) : at + min(sides) + 1]
            total = np.linalg.norm((points[n] - points[near]).sum(axis=0))
            rough[n] = total / ((len(near) - 1) * np.linalg.norm(points[n]))
    return rough


@pytest.mark.slow
@given(st.integers(0, 1000), st.sampled_from([0.01, 0.3, 1.0]))
def test_equals_eq_6_summed_slowly(seed, window_m):
    rng = np.random.default_rng(seed)
    ring, column = np.repeat([0, 1, 2], 40), np.tile(np.arange(40), 3)
    points = np.column_stack([rng.normal(5, 0.1, 120), 0.05 * column, ring]) + rng.normal(
        0, 0.01, (120, 3)
    )
    labels = (column > rng.integers(5, 35)).astype(np.int64)
    mixed = rng.permutation(120)
    points, ring, column, labels = points[mixed], ring[mixed], column[mixed], labels[mixed]
    roughness_values = ring_roughness(sweep_of(points, ring, column), labels, window_m)
    slowly = ring_roughness_slowly(points, ring, column, labels, window_m)
    assert roughness_values == pytest.approx(slowly, nan_ok=True, abs=1e-9)


def test_a_corner_is_rougher_than_the_walls_beside_it():
    along = np.arange(-20, 21) * 0.05
    points = np.column_stack([5 - np.abs(along), along, np.zeros(41)])
    zeros = np.zeros(41, np.int64)
    roughness_values = ring_roughness(sweep_of(points, zeros, np.arange(41)), zeros)
    assert np.nanargmax(roughness_values) == 20
    assert roughness_values[10] == pytest.approx(0.0, abs=1e-12)


def test_the_limit_is_loams_far_away_and_noise_nearby():
    limits = limit_of(np.array([[1.5, 0, 0], [50.0, 0, 0]]))
    assert limits == pytest.approx([2 * NOISE_M / 1.5, 5e-3])
