"""Bursts of lost measurements."""

from itertools import pairwise

import numpy as np
import pytest

from roadscope.envs.sensors import Gaps

SHARES, LENGTHS = (0.02, 0.05, 0.1, 0.2, 0.4), (2, 5, 10, 20, 40)


def lost(severity: int, seed: int = 3, count: int = 20_000, lengths=LENGTHS) -> np.ndarray:
    gaps = Gaps.of(SHARES[:severity], lengths[:severity], seed)
    return np.array([gaps.burst_start(k) is not None for k in range(count)])


@pytest.mark.parametrize("severity", range(1, 6))
def test_as_many_are_lost_as_the_share_says(severity: int) -> None:
    # About 200 independent bursts in 20 000 measurements: their share varies by a tenth.
    assert lost(severity).mean() == pytest.approx(SHARES[severity - 1], rel=0.3)


@pytest.mark.parametrize("lengths", [LENGTHS, (1, 2, 5, 10, 20), (1, 1, 1, 1, 1), (3, 1, 1, 1, 1)])
def test_more_severe_gaps_hold_the_milder_ones(lengths) -> None:
    ladder = [lost(n, count=3000, lengths=lengths) for n in range(1, 6)]
    for mild, severe in pairwise(ladder):
        assert not (mild & ~severe).any()


def test_gaps_are_bursts_and_need_no_order() -> None:
    gaps = Gaps.of(SHARES, LENGTHS, 3)
    there = [k for k in range(2000) if gaps.burst_start(k) is not None]
    assert there == sorted(k for k in reversed(range(2000)) if gaps.burst_start(k) is not None)
    runs = np.split(np.array(there), np.flatnonzero(np.diff(there) > 1) + 1)
    # The first may have begun before.
    assert min(len(run) for run in runs[1:-1]) >= LENGTHS[-1]


def test_seeds_differ_and_the_first_measurement_may_be_lost() -> None:
    assert not np.array_equal(lost(5, seed=1, count=500), lost(5, seed=2, count=500))
    first = [Gaps.of(SHARES, LENGTHS, seed).burst_start(0) is not None for seed in range(200)]
    assert 0.25 < np.mean(first) < 0.55
