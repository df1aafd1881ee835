"""Vehicles cut in before the ego, and change places before it."""

from __future__ import annotations

import numpy as np

from roadscope.core import Category
from roadscope.envs.traffic.mix import EGO, MOTORCYCLES, Body
from roadscope.envs.traffic.script_cast import Cast, any_car, any_van, timeline_of, times_until
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.timeline import Timeline

LANE_M = 3.5
LANES = (LANE_M, 0.0, -LANE_M)
DURATION_S = 12.0


def cut_ins(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive on the middle lane of three.

    Two cars ahead change sides, their ways crossing 5 m apart; a van overtakes and cuts in; a
    motorcycle pulls out from behind the ego and passes on the right; one more car overtakes.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    times = times_until(DURATION_S if duration_s is None else duration_s)
    return timeline_of(_cast(rng), times, lanes=LANES, width_m=LANE_M, style="motorway")


def _cast(rng: np.random.Generator) -> Cast:
    """Places ahead are of rear axles, from the ego's."""
    ego = Motion(0.0, 0.0, float(rng.uniform(12.0, 15.0)))
    together, weaving = float(rng.uniform(0.5, 1.5)), float(rng.uniform(4.3, 5.0))
    near = float(rng.uniform(22.0, 26.0))
    far = near + float(rng.uniform(10.5, 12.5))
    across = 2 * LANE_M
    to_right = _beside(ego, rng, near, LANE_M, ((together, weaving, -across),))
    to_left = _beside(ego, rng, far, -LANE_M, ((together, weaving, across),))
    return (
        (ego, EGO),
        (to_right, any_car(rng)),
        (to_left, any_car(rng)),
        (_cutting_in(ego, rng), any_van(rng)),
        (_pulling_out(ego, rng), Body(Category.MOTORCYCLE, MOTORCYCLES[2])),
        (_passing(ego, rng), any_car(rng)),
        (_beside(ego, rng, float(rng.uniform(-40.0, -34.0)), 0.0), any_car(rng)),
        (_beside(ego, rng, float(rng.uniform(-32.0, -26.0)), -LANE_M), any_van(rng)),
    )


def _beside(
    ego: Motion, rng: np.random.Generator, ahead_m: float, left_m: float,
    lane_changes: tuple[tuple[float, float, float], ...] = (),
) -> Motion:  # fmt: skip
    """Drive as fast as the ego."""
    left_m += float(rng.uniform(-0.2, 0.2))
    return Motion(ahead_m, left_m, ego.speed, lane_changes=lane_changes)


def _cutting_in(ego: Motion, rng: np.random.Generator) -> Motion:
    """Overtake on the left, go over to the ego's lane as soon as there is room, slow down."""
    surplus, behind = float(rng.uniform(6.0, 7.5)), float(rng.uniform(18.0, 24.0))
    beside = (behind + 7.5) / surplus
    return Motion(
        -behind, LANE_M, ego.speed + surplus,
        ((beside, 3.0, 0.3 - surplus),), ((beside, 3.5, -LANE_M),),
    )  # fmt: skip


def _pulling_out(ego: Motion, rng: np.random.Generator) -> Motion:
    behind, start = float(rng.uniform(9.0, 12.0)), float(rng.uniform(1.0, 2.0))
    return Motion(
        -behind, float(rng.uniform(-0.4, 0.4)), ego.speed,
        ((start + 1.0, 3.0, float(rng.uniform(2.5, 3.5))),), ((start, 3.0, -LANE_M + 0.3),),
    )  # fmt: skip


def _passing(ego: Motion, rng: np.random.Generator) -> Motion:
    """Stay on the left, slower than who cuts in; never up to who changed over to the left."""
    return Motion(
        float(rng.uniform(-48.0, -42.0)), LANE_M, ego.speed + float(rng.uniform(5.0, 5.8)),
        ((8.0, 3.0, -5.0),),
    )  # fmt: skip
