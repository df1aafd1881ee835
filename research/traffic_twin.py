"""Our traffic beside its slow twin of objects: whether both are equal, and the ratio of times."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable, Sequence
from time import process_time
from typing import NamedTuple

import numpy as np
from highway_env.envs.highway_env import HighwayEnv
from rich.console import Console
from rich.table import Table

from research.object_traffic import ObjectStage
from roadscope.core import Category
from roadscope.envs.gym import MotorwayEnv
from roadscope.envs.traffic.flow import DriverSetup, Flow
from roadscope.envs.traffic.mix import RoadUserBody, Size
from roadscope.envs.traffic.scenarios import SCENARIOS
from roadscope.envs.traffic.simulated import STEP_S, MotorwayTraffic, Stage, advance, play, straight
from roadscope.envs.traffic.timeline import Timeline

TWINS = tuple(
    name
    for name, each in SCENARIOS.items()
    if not (each.scripted or each.unseen or each.uneven or each.adversarial)
)
"""Scenarios that objects can play too; they know no rules of those who act against the ego."""
SEEDS, DURATION_S = 20, 20.0
VEHICLES = (50, 100, 200, 500)
REPEATS, FAST_STEPS, SLOW_STEPS = 7, 20, 2
"""Turns that are timed after a first one, and steps of kernels and of objects in each."""


class TwinRow(NamedTuple):
    """One scenario: recordings, those equal to the bit, and those with the same decisions.

    largest_m: largest distance between two places of a body in both. ratio: processor time of the
    objects in that of the kernels.
    """

    name: str
    recordings: int
    equal: int
    decided: int
    largest_m: float
    ratio: float


def compare(name: str, seeds: Sequence[int], duration_s: float) -> TwinRow:
    """Record a scenario with kernels and with objects, after a second that compiles the kernels."""
    build = builder(name)
    play(build(np.random.default_rng(0)), duration_s=1.0, style="bare")
    equal = decided = 0
    largest_m, times_s = 0.0, np.zeros(2)
    for seed in seeds:
        lines = []
        for column in range(2):
            stage = build(np.random.default_rng(seed))
            since_s = process_time()
            if column == 0:
                lines.append(play(stage, duration_s=duration_s, style="bare"))
            else:
                lines.append(ObjectStage(stage).play(duration_s=duration_s, style="bare"))
            times_s[column] += process_time() - since_s
        fast, slow = lines
        equal += fast == slow
        decided += same_decisions(fast, slow)
        if fast.axles.shape == slow.axles.shape:
            largest_m = max(largest_m, float(np.abs(fast.axles - slow.axles).max()))
    return TwinRow(name, len(seeds), equal, decided, largest_m, times_s[1] / times_s[0])


def play_both(draw: Callable[[], Stage], duration_s: float) -> tuple[Timeline, Timeline]:
    """Return the timelines of one stage by kernels and by objects."""
    fast = play(draw(), duration_s=duration_s, style="bare")
    return fast, ObjectStage(draw()).play(duration_s=duration_s, style="bare")


def pile_up(aside_m: float) -> Stage:
    """Build a motorway on which cars at 25 m/s meet a slow lorry and a standing car.

    aside_m: how far the first car is beside its lane.
    """
    traffic = MotorwayTraffic(31.0, 1.35, 50.0)
    flow = Flow(straight(np.random.default_rng(0), traffic).flow.roads)
    car = RoadUserBody(Category.CAR, Size(4.6, 1.9, 1.5))
    lorry = RoadUserBody(Category.TRUCK, Size(12.0, 2.5, 3.8))
    for body, lane, along_m, speed in (
        (car, 1, 100.0, 25.0),
        (lorry, 1, 114.0, 3.0),
        (car, 2, 98.0, 25.0),
    ):
        flow.add_driver(
            DriverSetup(body, ("0", "1", lane), along_m, speed, 25.0, lane_changes=True)
        )
    flow.park(("0", "1", 1), 125.0, car, reverse=True)
    flow.bodies["y"][0] += aside_m
    return Stage(flow, 0)


def builder(name: str) -> Callable[[np.random.Generator], Stage]:
    """Return the function that draws a scenario."""
    module, _, function = SCENARIOS[name].builder.partition(":")
    build: Callable[[np.random.Generator], Stage] = getattr(
        importlib.import_module(module), function
    )
    return build


def same_decisions(fast: Timeline, slow: Timeline) -> bool:
    """Return whether the same bodies are present and crash, and whether all are on the same lane.

    A body that chose another lane is more than a metre away.
    """
    return bool(
        np.array_equal(fast.present, slow.present)
        and np.array_equal(fast.crashed, slow.crashed)
        and np.abs(fast.axles - slow.axles).max() < 1.0
    )


def speed_of_scenarios(vehicles: int) -> tuple[float, float]:
    """Return milliseconds of processor time for a second of our motorway, kernels and objects."""
    reach_m = 45.0 * vehicles / 8
    traffic = MotorwayTraffic(31.0, 1.35, reach_m, length_m=3 * reach_m + 3e3, ego_m=reach_m + 50)
    fast = straight(np.random.default_rng(0), traffic)
    slow = ObjectStage(straight(np.random.default_rng(0), traffic))
    return _in_turn(lambda: advance(fast), slow.advance, STEP_S)


def speed_of_agents(vehicles: int) -> tuple[float, float]:
    """Return the same for an agent's motorway: the road alone, without actions and rewards."""
    config = {"vehicles_count": vehicles}
    ours, theirs = MotorwayEnv(config=config), HighwayEnv(config=config)
    dt = 1 / ours.config["simulation_frequency"]

    def step(env: HighwayEnv) -> None:
        env.road.act()
        env.road.step(dt)

    return _in_turn(lambda: step(ours), lambda: step(theirs), dt)


def _in_turn(
    fast: Callable[[], object], slow: Callable[[], object], dt: float
) -> tuple[float, float]:
    """Return medians of `REPEATS` turns, milliseconds for a second."""
    times_s: tuple[list[float], list[float]] = ([], [])
    for _ in range(REPEATS + 1):
        for each, step, steps in zip(times_s, (fast, slow), (FAST_STEPS, SLOW_STEPS), strict=True):
            since_s = process_time()
            for _ in range(steps):
                step()
            each.append((process_time() - since_s) / steps)
    first, second = (1e3 / dt * float(np.median(each[1:])) for each in times_s)
    return first, second


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare all simulated scenarios and time motorways."""
    parser = argparse.ArgumentParser("python -m research.traffic_twin", description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="recordings of each scenario")
    parser.add_argument("--duration", type=float, default=DURATION_S, help="of each, seconds")
    parser.add_argument("--scenarios", nargs="*", choices=TWINS, default=TWINS, help="their names")
    parser.add_argument("--vehicles", type=int, nargs="*", default=VEHICLES, help="on motorways")
    options = parser.parse_args(arguments)
    console = Console()
    table = Table("scenario", "recordings", "equal to the bit", "same decisions", "m", "ratio")
    for name in options.scenarios:
        row = compare(name, range(options.seeds), options.duration)
        table.add_row(row.name, *map(str, row[1:4]), f"{row.largest_m:.1e}", f"{row.ratio:.0f}")
    console.print(table)
    for title, measure in (("scenario", speed_of_scenarios), ("agent", speed_of_agents)):
        table = Table("vehicles", "kernels, ms a second", "objects, ms a second", "ratio")
        table.title = f"Motorway: {title}"
        for vehicles in options.vehicles:
            fast_ms, slow_ms = measure(vehicles)
            ratio = f"{slow_ms / fast_ms:.0f}"
            table.add_row(str(vehicles), f"{fast_ms:.2f}", f"{slow_ms:.0f}", ratio)
        console.print(table)


if __name__ == "__main__":
    main()
