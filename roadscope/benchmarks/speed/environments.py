"""How fast an agent's motorway is reset and stepped, with the sensors of several rigs.

In processor time, summed over threads: what one core needs for it, whatever else runs.
"""

from __future__ import annotations

from functools import partial
from time import process_time

import numpy as np

from roadscope.benchmarks.speed.rows import SpeedRow, SpeedStep
from roadscope.envs.gym.highway import ScenarioEnv

RIGS = ("vlp16-imu", "hdl32e-imu", "wide")
"""LiDARs at 10 Hz: two with an IMU of 400 Hz, `wide` with a camera of 640 x 480 pixels at 20 Hz."""
SCENARIO, VEHICLES = "motorway", 50
SEEDS = range(18, 23)
"""Seeds of the timed episodes, training seeds; an untimed episode comes first."""
STEPS, IDLE = 5, 1
"""Steps of a second in each episode, and the action that changes nothing."""


def environment_steps() -> list[SpeedStep]:
    """Return a step for each rig."""
    return [SpeedStep(f"environment, {rig}", partial(measure_environment, rig)) for rig in RIGS]


def measure_environment(rig: str) -> list[SpeedRow]:
    """Return milliseconds of a reset, and how many times real time is; medians over episodes."""
    env = ScenarioEnv(SCENARIO, ego="agent", rig=rig, vehicles=VEHICLES)
    drive_episode(env, SEEDS[0] - 1)
    resets_s, factors = zip(*(drive_episode(env, seed) for seed in SEEDS), strict=True)
    env.close()
    name = f"{SCENARIO}, {VEHICLES} vehicles, {rig}"
    return [
        SpeedRow(f"reset, {name}", 1e3 * float(np.median(resets_s)), "ms"),
        SpeedRow(f"steps, {name}", float(np.median(factors)), "times real time"),
    ]


def drive_episode(env: ScenarioEnv, seed: int) -> tuple[float, float]:
    """Return the seconds of a reset, and how many are simulated in one of processor time."""
    begin_s = process_time()
    env.reset(seed=seed)
    reset_s = process_time()
    for _ in range(STEPS):
        _, _, terminated, truncated, info = env.step(IDLE)
        if terminated or truncated:
            break
    return reset_s - begin_s, info["time_s"] / (process_time() - reset_s)
