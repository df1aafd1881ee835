"""The experiments of Zhang 2022 with the paper's figures beside ours.

Seeds vary noise, doors and furniture, the IMU's biases, who walks where, and the traffic of the
long route. A position is that of the LiDAR in its frame of the first scan; nothing is aligned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import product
from time import process_time
from typing import Any

import numpy as np

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.nodes.poses import PoseNode
from roadscope.benchmarks.papers.reproduction import (
    YES_OR_NO,
    Key,
    ReproductionRow,
    over_seeds,
    summarise,
)
from roadscope.benchmarks.papers.zhang2022_paper import (
    CLAIMED,
    CLAIMS,
    END,
    FURTHER,
    MAX,
    MEAN,
    MIN,
    OURS,
    PEER,
    READING,
    READINGS,
    REMOVAL,
    ROUTE,
    SCANS,
    STD,
    WALKED,
    named,
    note_of,
    paper_figure,
    unit_of,
)
from roadscope.benchmarks.papers.zhang2022_plays import CASES, LOOP, STANDING, STRAIGHT
from roadscope.benchmarks.papers.zhang2022_removal import LIDAR_FROM_IMU, MS, removal
from roadscope.benchmarks.papers.zhang2022_scene import Shot, film
from roadscope.benchmarks.references import pose_source
from roadscope.odometry import ODOMETRIES
from roadscope.odometry.zhang import ZhangOdometry

__all__ = ["note_of", "reproduce"]

FIRST_SEED = 20000
"""Test seeds, as in the suites; what was chosen by trying was chosen on seeds 10000 to 19999."""
METHODS = (SCANS, OURS, PEER, "loam", "lidar-inertial")
"""The last is ours."""
LOOPING = ("zhang2022-loop", "lego-loam-loop")
"""Those that close loops, where there are any."""
IN_THE_CORRIDOR = {"lidar-inertial": "lidar-inertial?imu=zed2"}
"""Who is told of what make the robot's inertial unit is."""
PLAYS = dict(zip(WALKED, (STANDING, STRAIGHT, LOOP), strict=True))
SCENARIO, RIG, DURATION_S = "racetrack-loop", "hdl64e-imu", 80.0
ROUTE_SEEDS = 5
"""The long route takes minutes a seed."""
LINKS = {"windows": False}
REMOVALS: dict[str, tuple[int, dict[str, Any]]] = {
    "zhang2022, 1 s apart": (10, {}),
    "zhang2022, 0.1 s apart": (1, {}),
    "angle bounds links, 1 s": (10, LINKS),
    "angle bounds links, 0.1 s": (1, LINKS),
}
"""Scans between the two, and settings of another reading."""
NOISES = {"half noise": 0.5, "double noise": 2.0}
READ, ENDS = WALKED[:2], WALKED[1:]
"""Experiments that other readings are tried on; those of which the paper prints the end alone."""
NOISY, NOISY_SEEDS = WALKED[:2], 5
"""Experiments that are run once more with other noise of both sensors, and with how many seeds."""
UNCOUNTED = 20
"""Calls at the start whose time is not counted: they compile, maps some scans later too."""


def reproduce(
    seeds: int = 30, progress: Callable[[int, int], None] | None = None, *, jobs: int = 1
) -> list[ReproductionRow]:
    """Run all experiments and return the paper's figures beside ours.

    seeds: how many seeds stand behind every interval.
    progress: called with seeds done and seeds in all, after each.
    jobs: processes that share the seeds; all rows but the times are the same for any number.
    """
    numbers = range(FIRST_SEED, FIRST_SEED + seeds)
    measured = over_seeds(measure, numbers, progress, jobs=jobs)
    rows = [
        summarise(key[:2], key[2], unit_of(key), values, paper_figure(key))
        for key, values in measured.items()
    ]
    return rows + verdicts(measured)


def measure(seed: int) -> dict[Key, float]:
    """Measure every quantity of every experiment and method with one seed."""
    found: dict[Key, float] = {}
    for case, play in CASES.items():
        for name, (apart, settings) in REMOVALS.items():
            values = removal(play, seed, apart, ZhangOdometry(**settings))
            found |= {(REMOVAL.format(case), name, quantity): v for quantity, v in values.items()}
    for experiment, play in PLAYS.items():
        specs = (*methods_of(experiment), *(READINGS if experiment in READ else ()))
        for spec, (errors_m, calls_ms) in errors(film(play, seed), specs).items():
            place = (experiment, spec)
            if spec in READINGS:
                place = (READING.format(experiment), READINGS[spec])
            values = told(errors_m, calls_ms, experiment)
            found |= {(*place, q): v for q, v in values.items()}
            if spec not in READINGS:
                also = further(errors_m, experiment)
                found |= {(FURTHER.format(experiment), spec, q): v for q, v in also.items()}
            if spec == OURS and experiment in READ:
                found |= {(READING.format(experiment), "as taken", q): v for q, v in values.items()}
    if seed < FIRST_SEED + NOISY_SEEDS:
        found |= noisy(seed)
    if seed < FIRST_SEED + ROUTE_SEEDS:
        found |= long_route(seed)
    return found


def methods_of(experiment: str) -> tuple[str, ...]:
    """Return the methods that are measured in an experiment."""
    return METHODS if experiment in READ else (*METHODS, *LOOPING)


def long_route(seed: int) -> dict[Key, float]:
    """Measure every method on the long route."""
    found: dict[Key, float] = {}
    for spec in methods_of(ROUTE):
        node = PoseNode(pose_source(spec), Episode(SCENARIO, seed, RIG, DURATION_S))
        poses = node.compute(RunOptions())
        both = poses.trajectories
        start = np.linalg.inv(both.truth[0]) @ both.truth
        errors_m = np.linalg.norm(both.estimate[:, :3, 3] - start[:, :3, 3], axis=1)
        calls_ms = poses.times.processor_ms
        found |= {(ROUTE, spec, q): v for q, v in told(errors_m, calls_ms, ROUTE).items()}
        also = further(errors_m, ROUTE)
        found |= {(FURTHER.format(ROUTE), spec, q): v for q, v in also.items()}
    return found


def noisy(seed: int) -> dict[Key, float]:
    """Measure the paper's chain and its rival with other noise: nothing may hang on quiet ones."""
    return {
        (f"{experiment}, {name}", spec, quantity): value
        for experiment in NOISY
        for name, noise in NOISES.items()
        for spec, (errors_m, calls_ms) in errors(
            film(PLAYS[experiment], seed, noise), (SCANS, OURS, PEER)
        ).items()
        for quantity, value in told(errors_m, calls_ms, experiment).items()
    }


def errors(shots: Iterable[Shot], specs: Sequence[str]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return by odometry the error of each position, (T,) metres, and the time of each call, ms."""
    plugins = {spec: ODOMETRIES.make(IN_THE_CORRIDOR.get(spec, spec)) for spec in specs}
    off: dict[str, list[float]] = {spec: [] for spec in specs}
    took: dict[str, list[float]] = {spec: [] for spec in specs}
    for plugin in plugins.values():
        plugin.reset(LIDAR_FROM_IMU)
    for shot in shots:
        for spec, plugin in plugins.items():
            start = process_time()
            estimate = plugin.update(shot.scan, shot.imu)
            took[spec].append(1e3 * (process_time() - start))
            away = estimate.start_from_lidar.translation - shot.start_from_lidar[:3, 3]
            off[spec].append(float(np.linalg.norm(away)))
    return {spec: (np.array(off[spec]), np.array(took[spec])) for spec in specs}


def told(errors_m: np.ndarray, calls_ms: np.ndarray, experiment: str) -> dict[str, float]:
    """Return the figures that the paper prints of an experiment; the first pose has no error."""
    counted = calls_ms[min(UNCOUNTED, len(calls_ms) - 1) :]
    values = (
        at_the_end(errors_m, experiment) if experiment in ENDS else spread(errors_m, experiment)
    )
    return values | {MS: float(counted.mean())}


def further(errors_m: np.ndarray, experiment: str) -> dict[str, float]:
    """Return those that it prints of other experiments."""
    return spread(errors_m, experiment) if experiment in ENDS else at_the_end(errors_m, experiment)


def at_the_end(errors_m: np.ndarray, experiment: str) -> dict[str, float]:
    """Return the error of the last position, metres."""
    return {named(END, experiment): float(errors_m[-1])}


def spread(errors_m: np.ndarray, experiment: str) -> dict[str, float]:
    """Return standard deviation, maximum, mean and minimum of the positions' errors, metres."""
    later = errors_m[1:]
    return {
        named(STD, experiment): float(later.std()),
        named(MAX, experiment): float(later.max()),
        named(MEAN, experiment): float(later.mean()),
        named(MIN, experiment): float(later.min()),
    }


def verdicts(measured: dict[Key, list[float]]) -> list[ReproductionRow]:
    """Say which claims hold in the mean over seeds, and in what share of them."""
    rows = []
    for method, (experiment, quantity) in product((SCANS, OURS), CLAIMED):
        ours = np.array(measured[experiment, method, quantity])
        other = np.array(measured[experiment, PEER, quantity])
        place, n = (CLAIMS.format(method), f"{experiment}: {quantity}"), len(ours)
        holds = float(ours.mean() < other.mean())
        rows.append(ReproductionRow(*place, "holds", YES_OR_NO, None, holds, None, None, n))
        lower = [float(a < b) for a, b in zip(ours, other, strict=True)]
        rows.append(summarise(place, "share of seeds", "share", lower, None))
    return rows
