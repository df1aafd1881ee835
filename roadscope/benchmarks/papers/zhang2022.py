"""The experiments of Zhang 2022 with the paper's figures beside ours.

Section 3.1 removes dynamic points of two scans 1 s apart. Section 3.2 localises the robot while it
stands, on a straight and on a loop, and then on a long route. A position is that of the LiDAR in
its frame of the first scan; nothing is aligned.

Seeds vary noise, doors and furniture, the IMU's biases, the people, and the traffic of the long
route.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from time import process_time
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.nodes.poses import PoseNode
from roadscope.benchmarks.papers.reproduction import (
    YES_OR_NO,
    FigureKey,
    ReproductionRow,
    over_seeds,
    summarise,
)
from roadscope.benchmarks.papers.zhang2022_scene import (
    LIDAR_FROM_IMU,
    LOOP,
    REMOVAL_CASES,
    SCANS_APART,
    STANDING,
    STRAIGHT,
    CorridorExperiment,
    CorridorSweep,
    sense_corridor,
)
from roadscope.benchmarks.references import pose_source
from roadscope.odometry import ODOMETRIES
from roadscope.odometry.loam.progress import ImuPrediction
from roadscope.odometry.zhang import ZhangOdometry, dynamic_returns

FIRST_SEED = 20000
"""Test seeds, as in the suites; what was chosen by trying was chosen on seeds 10000 to 19999."""

# --------------------------------------------------------------------------------------------------
# Names of experiments, quantities and methods.

REMOVAL = "dynamic points, case {}"
EXPERIMENTS: Mapping[str, CorridorExperiment] = MappingProxyType(
    {"standing": STANDING, "straight": STRAIGHT, "loop": LOOP}
)
"""Experiments 1 to 3 of section 3.2, in the corridor."""
LONG_ROUTE = "long route"
"""Experiment 4."""
OTHER_FIGURES = "{}, further figures"
"""Figures of an experiment that the paper prints of other experiments only."""
READINGS = "readings, {}"
CLAIMS = "claims: {} below lego-loam"

BEFORE, AFTER, PRECISION, RECALL = "before", "after", "precision", "recall"
STD, MAX, MEAN, MIN, END = "std", "max", "mean", "min", "end error"
TIME_MS = "ms"
UNITS = {BEFORE: "count", AFTER: "count", PRECISION: "%", RECALL: "%", TIME_MS: ""}
"""Metres for the others. The name of the time is its unit."""

SCAN_TO_SCAN, WITH_MAP, LEGO_LOAM = "zhang2022", "zhang2022-map", "lego-loam"
"""The paper's chain from scan to scan, the same before LeGO-LOAM's map, and its rival."""
METHODS = (SCAN_TO_SCAN, WITH_MAP, LEGO_LOAM, "loam", "lidar-inertial")
"""The last is ours."""
LOOP_CLOSING = ("zhang2022-loop", "lego-loam-loop")
"""Methods that close loops. The standing and the straight experiment have no loop."""
SPECS_IN_CORRIDOR = {"lidar-inertial": "lidar-inertial?imu=zed2"}
"""This method needs to know the make of the IMU."""
OTHER_READINGS = {
    f"{WITH_MAP}?roughness='cluster'": "eq. 6 as printed",
    f"{WITH_MAP}?windows=False": "angle bounds links",
    f"{WITH_MAP}?view=1.0": "own way allowed for",
    f"{WITH_MAP}?same_cluster=False": "any cluster's features",
    f"{WITH_MAP}?drop_dynamic=False": "nothing dropped",
}
"""Specs of other readings of the paper, and of the chain without a part, with their names."""
READING_EXPERIMENTS = ("standing", "straight")
"""Experiments on which the other readings run."""
NOISE_EXPERIMENTS = ("standing", "straight")
NOISE_FACTORS = {"half noise": 0.5, "double noise": 2.0}
"""Experiments that run again with other noise of both sensors, and the factors on it."""
NOISE_SEEDS = 5
"""How many of the seeds run them."""
END_ERROR_EXPERIMENTS = ("straight", "loop")
"""Experiments of which the paper prints the end error alone."""
ROUTE_SCENARIO, ROUTE_RIG, ROUTE_DURATION_S = "racetrack-loop", "hdl64e-imu", 80.0
ROUTE_SEEDS = 5
"""How many of the seeds drive the long route: it takes minutes a seed."""
UNCOUNTED_CALLS = 20
"""Calls at the start whose time is not counted: some compile code, for the map some later too."""

# --------------------------------------------------------------------------------------------------
# What the paper prints.

_REMOVAL_FIGURES = (
    {BEFORE: 20883, AFTER: 20053, TIME_MS: 10.7},
    {BEFORE: 20775, AFTER: 19192, TIME_MS: 10.5},
    {BEFORE: 21052, AFTER: 19738, TIME_MS: 11.6},
    {BEFORE: 22214, AFTER: 21594, TIME_MS: 11.9},
)
_LOCALISATION_FIGURES = {
    ("standing", WITH_MAP): {STD: 0.0077, MAX: 0.0489, MEAN: 0.0059, MIN: 0.0004, TIME_MS: 17.9},
    ("standing", LEGO_LOAM): {STD: 0.0182, MAX: 0.0962, MEAN: 0.0097, MIN: 0.0007, TIME_MS: 25.7},
    ("straight", WITH_MAP): {END: 0.4237},
    ("straight", LEGO_LOAM): {END: 0.5494},
    ("loop", WITH_MAP): {END: 0.1040},
    ("loop", LEGO_LOAM): {END: 0.1736},
    (LONG_ROUTE, WITH_MAP): {STD: 4.4878, MAX: 18.0254, MEAN: 8.0059, MIN: 0.1537, TIME_MS: 18.7},
    (LONG_ROUTE, LEGO_LOAM): {STD: 5.3717, MAX: 26.4013, MEAN: 12.2687, MIN: 0.1964, TIME_MS: 25.6},
}
"""Tables 3 and 4, and the end errors of section 3.2."""


def quantity_name(quantity: str, experiment: str) -> str:
    """Return a quantity's name in an experiment; on the long route, with the unit metres."""
    return f"{quantity}, m" if experiment == LONG_ROUTE and quantity != TIME_MS else quantity


PAPER: Mapping[FigureKey, float] = MappingProxyType(
    {
        FigureKey(REMOVAL.format(case), "zhang2022, 1 s apart", quantity): figure
        for case, figures in zip(REMOVAL_CASES, _REMOVAL_FIGURES, strict=True)
        for quantity, figure in figures.items()
    }
    | {
        FigureKey(experiment, method, quantity_name(quantity, experiment)): figure
        for (experiment, method), figures in _LOCALISATION_FIGURES.items()
        for quantity, figure in figures.items()
    }
)
CLAIMED = tuple(
    (experiment, quantity_name(quantity, experiment))
    for (experiment, method), figures in _LOCALISATION_FIGURES.items()
    if method == WITH_MAP
    for quantity in figures
)
"""Experiment and quantity of each figure that the paper has below LeGO-LOAM's."""


def paper_figure(key: FigureKey) -> float | None:
    """Return what the paper prints for a quantity, None where it prints nothing.

    The paper does not say whether its chain had a map: its figures stand beside both.
    """
    method = WITH_MAP if key.method == SCAN_TO_SCAN else key.method
    return PAPER.get(key._replace(method=method))


def unit_of(key: FigureKey) -> str:
    """Return the unit of a quantity; empty where its name says it."""
    return "" if LONG_ROUTE in key.experiment else UNITS.get(key.quantity, "m")


def note_of(experiment: str) -> str | None:
    """Return what must be known to read the tables of an experiment."""
    if experiment.startswith("claims"):
        return "'holds': in the mean over seeds. The paper compares with LeGO-LOAM."
    if LONG_ROUTE in experiment:
        return (
            "The paper drives KITTI with an HDL-64E; here the same LiDAR goes a lap and a half of "
            "a racetrack in traffic, half a kilometre, so that its figures are of another length. "
            "Of the first 5 seeds at most."
        )
    if experiment in EXPERIMENTS:
        return (
            "The paper's odometry goes from scan to scan (zhang2022) and it speaks of SLAM, and of "
            "LeGO-LOAM's loops, where it measures; zhang2022-map is the same chain before "
            "LeGO-LOAM's map. lidar-inertial knows the make of the IMU (imu=zed2)."
        )
    if experiment.endswith("noise"):
        return "Range noise of the LiDAR and all errors of the IMU, of the first 5 seeds at most."
    if experiment.startswith("dynamic"):
        return (
            "The search angle of 5 deg bounds clusters, as the walls in the paper's figures "
            "suggest; one can also read that it bounds steps from return to return alone. A "
            "cluster is dynamic whose centre moved by more than 0.05 m + 0.5 m/s + 1 % of its "
            "range (+ the robot's own motion where the angle bounds links): the paper prints no "
            "threshold. Its numbers of points are of one pair of scans."
        )
    return None


# --------------------------------------------------------------------------------------------------
# All experiments.


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
        summarise(key, unit_of(key), values, paper_figure(key)) for key, values in measured.items()
    ]
    return rows + claims(measured)


def measure(seed: int) -> dict[FigureKey, float]:
    """Return every figure of every experiment and method with one seed."""
    figures = measure_removal(seed)
    for experiment in EXPERIMENTS:
        figures |= measure_in_corridor(experiment, seed)
    if seed < FIRST_SEED + NOISE_SEEDS:
        figures |= measure_with_noise(seed)
    if seed < FIRST_SEED + ROUTE_SEEDS:
        figures |= measure_long_route(seed)
    return figures


# --------------------------------------------------------------------------------------------------
# Section 3.1: dynamic points of two scans 1 s apart.

TIMED_CALLS = 5
"""The time is the median of so many; one before them compiles and is not counted."""


class RemovalVariant(NamedTuple):
    """One way to run the removal.

    scans_apart: between the two scans, 0.1 s each. settings: of `ZhangOdometry`.
    """

    scans_apart: int
    settings: Mapping[str, Any]


_BOUNDED_LINKS = {"windows": False}
REMOVAL_VARIANTS = {
    "zhang2022, 1 s apart": RemovalVariant(SCANS_APART, {}),
    "zhang2022, 0.1 s apart": RemovalVariant(1, {}),
    "angle bounds links, 1 s": RemovalVariant(SCANS_APART, _BOUNDED_LINKS),
    "angle bounds links, 0.1 s": RemovalVariant(1, _BOUNDED_LINKS),
}


def measure_removal(seed: int) -> dict[FigureKey, float]:
    """Return the figures of all cases and variants."""
    return {
        FigureKey(REMOVAL.format(case), name, quantity): value
        for case, experiment in REMOVAL_CASES.items()
        for name, (scans_apart, settings) in REMOVAL_VARIANTS.items()
        for quantity, value in removal(
            experiment, seed, scans_apart, ZhangOdometry(**settings)
        ).items()
    }


def removal(
    experiment: CorridorExperiment,
    seed: int,
    scans_apart: int = SCANS_APART,
    rule: ZhangOdometry | None = None,
) -> dict[str, float]:
    """Return points before and after, precision and recall in per cent, and milliseconds.

    scans_apart: scans between the two. rule: a reading of the paper; None: the one taken.
    Precision is NaN where nothing was removed, recall where no walking person has returns.
    """
    sweeps = list(sense_corridor(experiment, seed))
    before, now = sweeps[-1 - scans_apart], sweeps[-1]
    motion = predicted_motion(sweeps, scans_apart)
    rule = ZhangOdometry() if rule is None else rule
    times_s = []
    for _ in range(1 + TIMED_CALLS):
        start = process_time()
        dynamic = dynamic_returns(rule, before.scan, now.scan, motion)
        # Both scans are clustered; an odometry keeps the clusters of the scan before.
        times_s.append((process_time() - start) / 2)
    right = float((dynamic & now.moving).sum())
    removed, moving = float(dynamic.sum()), float(now.moving.sum())
    return {
        BEFORE: float(len(dynamic)),
        AFTER: float(len(dynamic)) - removed,
        PRECISION: 100 * right / removed if removed else np.nan,
        RECALL: 100 * right / moving if moving else np.nan,
        TIME_MS: 1e3 * float(np.median(times_s[1:])),
    }


def predicted_motion(sweeps: Sequence[CorridorSweep], scans_apart: int) -> np.ndarray:
    """Return the (4, 4) motion by the IMU from an earlier sweep to the last (eq. 3).

    It starts with the true velocity at the earlier sweep, which an odometry knows from its steps.
    """
    imu = ImuPrediction(LIDAR_FROM_IMU)
    for sweep in sweeps:
        imu.add(sweep.imu)
    imu.velocity = sweeps[-1 - scans_apart].velocity
    return imu.motion(sweeps[-1 - scans_apart].scan.stamp_s, sweeps[-1].scan.stamp_s)


# --------------------------------------------------------------------------------------------------
# Section 3.2: localisation.


class OdometryErrors(NamedTuple):
    """What one odometry made of a drive.

    errors_m: (T,) distance of each position from the truth. calls_ms: (T,) time of each call.
    """

    errors_m: np.ndarray
    calls_ms: np.ndarray


def methods_of(experiment: str) -> tuple[str, ...]:
    """Return the methods that run in an experiment."""
    return METHODS if experiment in READING_EXPERIMENTS else (*METHODS, *LOOP_CLOSING)


def measure_in_corridor(experiment: str, seed: int) -> dict[FigureKey, float]:
    """Return the figures of all methods, and of other readings, in an experiment."""
    with_readings = experiment in READING_EXPERIMENTS
    specs = (*methods_of(experiment), *(OTHER_READINGS if with_readings else ()))
    figures: dict[FigureKey, float] = {}
    for spec, run in run_odometries(sense_corridor(EXPERIMENTS[experiment], seed), specs).items():
        if spec in OTHER_READINGS:
            figures |= printed_figures(experiment, OTHER_READINGS[spec], run, READINGS)
            continue
        figures |= printed_figures(experiment, spec, run)
        figures |= other_figures(experiment, spec, run)
        if spec == WITH_MAP and with_readings:
            figures |= printed_figures(experiment, "as taken", run, READINGS)
    return figures


def measure_with_noise(seed: int) -> dict[FigureKey, float]:
    """Return the figures of the paper's chain and its rival with half and double noise.

    No result may depend on quiet sensors.
    """
    figures: dict[FigureKey, float] = {}
    for experiment, (name, noise) in product(NOISE_EXPERIMENTS, NOISE_FACTORS.items()):
        sweeps = sense_corridor(EXPERIMENTS[experiment], seed, noise)
        for spec, run in run_odometries(sweeps, (SCAN_TO_SCAN, WITH_MAP, LEGO_LOAM)).items():
            figures |= printed_figures(experiment, spec, run, f"{{}}, {name}")
    return figures


def measure_long_route(seed: int) -> dict[FigureKey, float]:
    """Return the figures of all methods on the long route."""
    figures: dict[FigureKey, float] = {}
    episode = Episode(ROUTE_SCENARIO, seed, ROUTE_RIG, ROUTE_DURATION_S)
    for spec in methods_of(LONG_ROUTE):
        poses = PoseNode(pose_source(spec), episode).compute(RunOptions())
        trajectories = poses.trajectories
        start_from_lidar = np.linalg.inv(trajectories.truth[0]) @ trajectories.truth
        offsets = trajectories.estimate[:, :3, 3] - start_from_lidar[:, :3, 3]
        run = OdometryErrors(np.linalg.norm(offsets, axis=1), poses.times.processor_ms)
        figures |= printed_figures(LONG_ROUTE, spec, run)
        figures |= other_figures(LONG_ROUTE, spec, run)
    return figures


def run_odometries(
    sweeps: Iterable[CorridorSweep], specs: Sequence[str]
) -> dict[str, OdometryErrors]:
    """Run odometries over sweeps and return the errors by spec."""
    odometries = {spec: ODOMETRIES.make(SPECS_IN_CORRIDOR.get(spec, spec)) for spec in specs}
    errors_m: dict[str, list[float]] = {spec: [] for spec in specs}
    calls_ms: dict[str, list[float]] = {spec: [] for spec in specs}
    for odometry in odometries.values():
        odometry.reset(LIDAR_FROM_IMU)
    for sweep in sweeps:
        for spec, odometry in odometries.items():
            start = process_time()
            estimate = odometry.update(sweep.scan, sweep.imu)
            calls_ms[spec].append(1e3 * (process_time() - start))
            offset = estimate.start_from_lidar.translation - sweep.start_from_lidar[:3, 3]
            errors_m[spec].append(float(np.linalg.norm(offset)))
    return {
        spec: OdometryErrors(np.array(errors_m[spec]), np.array(calls_ms[spec])) for spec in specs
    }


def printed_figures(
    experiment: str, method: str, run: OdometryErrors, title: str = "{}"
) -> dict[FigureKey, float]:
    """Return the figures that the paper prints of an experiment.

    title: of the table, with a place for the experiment's name.
    """
    end_alone = experiment in END_ERROR_EXPERIMENTS
    figures = {END: end_error(run)} if end_alone else spread(run)
    counted = run.calls_ms[min(UNCOUNTED_CALLS, len(run.calls_ms) - 1) :]
    return _keyed(experiment, method, figures | {TIME_MS: float(counted.mean())}, title)


def other_figures(experiment: str, method: str, run: OdometryErrors) -> dict[FigureKey, float]:
    """Return the figures of an experiment that the paper prints of other experiments."""
    figures = spread(run) if experiment in END_ERROR_EXPERIMENTS else {END: end_error(run)}
    return _keyed(experiment, method, figures, OTHER_FIGURES)


def _keyed(
    experiment: str, method: str, figures: Mapping[str, float], title: str
) -> dict[FigureKey, float]:
    return {
        FigureKey(title.format(experiment), method, quantity_name(quantity, experiment)): value
        for quantity, value in figures.items()
    }


def end_error(run: OdometryErrors) -> float:
    """Return the error of the last position, metres."""
    return float(run.errors_m[-1])


def spread(run: OdometryErrors) -> dict[str, float]:
    """Return standard deviation, maximum, mean and minimum of the errors, metres.

    The first position has no error and is left out.
    """
    later = run.errors_m[1:]
    return {
        STD: float(later.std()),
        MAX: float(later.max()),
        MEAN: float(later.mean()),
        MIN: float(later.min()),
    }


# --------------------------------------------------------------------------------------------------
# The paper's claims.


def claims(measured: Mapping[FigureKey, Sequence[float]]) -> list[ReproductionRow]:
    """Return which figures are below LeGO-LOAM's, in the mean over seeds and in what share."""
    rows = []
    for method, (experiment, quantity) in product((SCAN_TO_SCAN, WITH_MAP), CLAIMED):
        ours = np.array(measured[FigureKey(experiment, method, quantity)])
        theirs = np.array(measured[FigureKey(experiment, LEGO_LOAM, quantity)])
        holds = FigureKey(CLAIMS.format(method), f"{experiment}: {quantity}", "holds")
        below = float(ours.mean() < theirs.mean())
        rows.append(ReproductionRow(*holds, YES_OR_NO, None, below, None, None, len(ours)))
        shares = [float(a < b) for a, b in zip(ours, theirs, strict=True)]
        rows.append(summarise(holds._replace(quantity="share of seeds"), "share", shares))
    return rows
