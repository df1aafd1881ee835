"""What happens in each of Zhang 2022's experiments in the corridor.

The paper gives neither speeds nor numbers of people; these were fixed before anything was
measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from roadscope.benchmarks.papers.zhang2022_building import Way
from roadscope.benchmarks.papers.zhang2022_scene import ASIDE_M, PACE_M_S, Play, Walk

STRAIGHT_M = 18.035
APART = 10
"""Scans between the two of a removal: 1 s, as in the paper."""
Draw = Callable[[np.random.Generator], list[Walk]]


def walkers(count: int, sides: Sequence[int], between_m: tuple[float, float]) -> Draw:
    """Return what draws so many people who walk to and fro along sides of the corridor."""

    def draw(rng: np.random.Generator) -> list[Walk]:
        return [
            Walk(
                int(rng.choice(sides)), between_m,
                float(rng.choice((-1, 1)) * rng.uniform(*ASIDE_M)),
                float(rng.uniform(*PACE_M_S)), float(rng.uniform()),
            )
            for _ in range(count)
        ]  # fmt: skip

    return draw


CASES = {
    "1, still, one walker": Play(8.0, 0.0, 0.0, APART + 2, walkers(1, (0,), (4.0, 14.0))),
    "2, still, several": Play(8.0, 0.0, 0.0, APART + 2, walkers(4, (0,), (4.0, 14.0))),
    "3, moving at a corner": Play(21.0, 6.0, 1.0, 42, walkers(3, (0, 1), (2.0, 12.0))),
    "4, moving, straight": Play(4.0, 8.0, 1.0, 42, walkers(3, (0,), (4.0, 20.0))),
}
"""The last scan of each is compared with the one 1 s before."""
STANDING = Play(8.0, 0.0, 0.0, 100, walkers(4, (0,), (2.0, 20.0)))
STRAIGHT = Play(2.0, STRAIGHT_M, 1.0, 205, walkers(3, (0,), (2.0, 24.0)))
LOOP = Play(2.0, Way().length_m, 1.5, 530, walkers(6, (0, 1, 2, 3), (2.0, 12.0)))
