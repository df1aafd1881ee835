"""How loud a scan is."""

import copy

import numpy as np
import pytest
from toy_drive import ToyDrive

from roadscope.odometry import LARGEST_NOISE_M, LEAST_TRIPLES, excessive_noise, range_noise_m


def louder(scan, sigma_m):
    rng, spoilt = np.random.default_rng(0), copy.deepcopy(scan)
    ranges = np.linalg.norm(scan.points, axis=1, keepdims=True)
    spoilt.points[:] = scan.points * (1 + rng.normal(0, sigma_m, ranges.shape) / ranges)
    return spoilt


def in_order(scan, rows):
    other = copy.deepcopy(scan)
    for name in ("points", "ring", "column", "time_offset_s"):
        getattr(other, name)[:] = getattr(scan, name)[rows]
    return other


@pytest.mark.parametrize("sigma_m", [0.05, 0.2, 0.4])
def test_noise_is_found_in_any_order(sigma_m):
    scan = louder(ToyDrive(8.0, columns=1800).scan(0), sigma_m)
    assert range_noise_m(scan) == pytest.approx(sigma_m, rel=0.1)
    by_ring = np.lexsort((scan.column, scan.ring))
    assert range_noise_m(in_order(scan, by_ring)) == pytest.approx(range_noise_m(scan))
    assert bool(excessive_noise(scan)) == (sigma_m > LARGEST_NOISE_M)


def test_few_or_invalid_returns_give_no_noise():
    scan = louder(ToyDrive(8.0, columns=1800).scan(0), 0.3)
    few = copy.deepcopy(scan)
    few.points[LEAST_TRIPLES:] = np.nan
    assert range_noise_m(few) == 0.0
    assert excessive_noise(few) == ""
    half = copy.deepcopy(scan)
    half.points[::2] = np.nan
    half.points[: len(half) // 2] = scan.points[: len(half) // 2]
    assert range_noise_m(half) == pytest.approx(0.3, rel=0.1)
