"""The experiments of Zhang 2022 with the paper's figures beside ours.

Section 3.1 removes dynamic points of two scans 1 s apart. Section 3.2 localises the robot while it
stands, on a straight and on a loop, and then on a long route. A position is that of the LiDAR in
its frame of the first scan; nothing is aligned.

Seeds vary noise, doors and furniture, the IMU's biases, the people, and the traffic of the long
route.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice, product
from time import process_time
from types import MappingProxyType
from typing import BinaryIO, NamedTuple

import numpy as np

from roadscope.benchmarks.cache import read_or_make
from roadscope.benchmarks.drive_steps import drive, imu_mounting
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.papers.reproduction import (
    LESS_THAN_NONE,
    METRES_MORE,
    MILLISECONDS_MORE,
    NOT_CLAIMED,
    ClaimRange,
    FigureKey,
    Figures,
    Measured,
    Paper,
    ReproductionRow,
    Verdict,
    differences,
    judge,
    kept_path,
    summarise,
)
from roadscope.benchmarks.papers.zhang2022_removal import (
    AFTER,
    BEFORE,
    PRECISION,
    RECALL,
    REMOVAL,
    TIME_MS,
    measure_removal,
)
from roadscope.benchmarks.papers.zhang2022_scene import (
    LIDAR_FROM_IMU,
    LOOP,
    REMOVAL_CASES,
    STANDING,
    STRAIGHT,
    CorridorExperiment,
    CorridorSweep,
    sense_corridor,
)
from roadscope.core import ImuSamples, LidarScan, Pose
from roadscope.odometry import ODOMETRIES
from roadscope.odometry.lego.mapping import MappedOdometry, ScanToScan

# --------------------------------------------------------------------------------------------------
# Names of experiments, quantities and methods.

EXPERIMENTS: Mapping[str, CorridorExperiment] = MappingProxyType(
    {"standing": STANDING, "straight": STRAIGHT, "loop": LOOP}
)
"""Experiments 1 to 3 of section 3.2, in the corridor."""
LONG_ROUTE = "long route"
"""Experiment 4."""
OTHER_FIGURES = "{}, further figures"
"""Figures of an experiment that the paper prints of other experiments only."""
MEDIANS, LOST_M = "{}, medians and lost runs", 10.0
"""Title of these tables; a run is lost if it ends farther than this from the truth, metres."""
READING_FIGURES = "readings, {}"
"""Figures of an experiment with other readings of the paper."""

STD, MAX, MEAN, MIN, END = "std", "max", "mean", "min", "end error"
UNITS = {BEFORE: "count", AFTER: "count", PRECISION: "%", RECALL: "%", TIME_MS: ""}
"""Metres for the others. The name of the time is its unit."""

SCAN_TO_SCAN, WITH_MAP, LEGO_LOAM = "zhang2022", "zhang2022-map", "lego-loam"
"""The paper's chain from scan to scan, the same before LeGO-LOAM's map, and its rival."""
AS_PRINTED = "zhang2022-map, eq. 6 as printed"
"""The same with a map, the roughness summed over the whole cluster."""
METHODS = (
    SCAN_TO_SCAN,
    WITH_MAP,
    AS_PRINTED,
    "zhang2022-guarded",
    LEGO_LOAM,
    "loam",
    "lidar-inertial",
)
"""`zhang2022-guarded` and `lidar-inertial` are ours."""
PAPERS_METHODS = (SCAN_TO_SCAN, WITH_MAP, AS_PRINTED)
"""Readings of the paper's method that its claims are judged for."""
LOOP_CLOSING = ("zhang2022-loop", "lego-loam-loop")
"""Methods that close loops, in the experiments that have one, in the place of `loam`."""
SPECS = {"lidar-inertial": "lidar-inertial?imu=zed2", AS_PRINTED: f"{WITH_MAP}?roughness='cluster'"}
"""Specs of methods whose names are no specs. The first one knows the make of the IMU."""
OTHER_READINGS = {
    f"{WITH_MAP}?spacings=0": "epsilon as printed",
    AS_PRINTED: "eq. 6 as printed",
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
END_ERROR_EXPERIMENTS = ("straight", "loop")
"""Experiments of which the paper prints the end error alone."""
ROUTE_SCENARIO, ROUTE_RIG, ROUTE_DURATION_S = "racetrack-loop", "hdl64e-imu", 80.0
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

    The paper does not say whether its chain had a map: its figures stand beside all readings.
    """
    method = WITH_MAP if key.method in PAPERS_METHODS else key.method
    return PAPER.get(key._replace(method=method))


def unit_of(key: FigureKey) -> str:
    """Return the unit of a quantity; empty where its name says it."""
    return "" if LONG_ROUTE in key.experiment else UNITS.get(key.quantity, "m")


def note_of(experiment: str) -> str | None:
    """Return what must be known to read the tables of an experiment."""
    if LONG_ROUTE in experiment:
        return (
            "The paper's route is on KITTI with an HDL-64E. Here the same LiDAR drives a lap and a "
            "half of a racetrack in traffic, half a kilometre, so the paper's figures are of "
            "another length."
        )
    if experiment in EXPERIMENTS:
        return (
            "The paper describes odometry from scan to scan (zhang2022). Where it measures, it "
            "speaks of SLAM and of LeGO-LOAM's loops; zhang2022-map is the same method in front of "
            "LeGO-LOAM's map, and runs with eq. 6 as printed too, summed over the whole cluster in "
            "place of the neighbours on the ring. zhang2022-guarded is ours: where a prediction "
            "makes a third of all returns dynamic, and for the first motion, it matches all "
            "features, whatever their cluster; it measures displacements from above, and allows "
            "1 % of the range in place of 2 %. "
            "lidar-inertial knows the make of the IMU (imu=zed2)."
        )
    if experiment.endswith("lost runs"):
        return (
            f"A run that ends over {LOST_M:g} m away is lost; such runs set the means of the "
            "tables above."
        )
    if experiment.endswith("noise"):
        return "Range noise of the LiDAR and all errors of the IMU."
    if experiment.startswith("dynamic"):
        return (
            "The search angle of 5 deg bounds clusters, as the walls in the paper's figures "
            "suggest; one can also read that it bounds steps from return to return alone. A "
            "cluster is dynamic whose centre moved by more than 0.05 m + 0.5 m/s + 2 % of its "
            "range (+ the robot's own motion where the angle bounds links): the paper prints no "
            "threshold. Its numbers of points are of one pair of scans. The true speed is given "
            "at the earlier scan, as an odometry would know it from its steps; 'speed unknown' "
            "starts at rest. 'epsilon as printed': 0.02 m at every range."
        )
    return None


# --------------------------------------------------------------------------------------------------
# All experiments.


def rows(measured: Measured) -> list[ReproductionRow]:
    """Return the paper's figures beside ours; then medians and numbers of lost runs."""
    means = [
        summarise(key, unit_of(key), values, paper_figure(key)) for key, values in measured.items()
    ]
    return [*means, *_medians_and_lost(measured)]


def _medians_and_lost(measured: Measured) -> Iterator[ReproductionRow]:
    """Yield the median of the error over seeds and the number of runs that are lost.

    A lost run sets a mean and its interval. The error is the end error, and the mean one where the
    sensor stands.
    """
    for experiment in (*EXPERIMENTS, LONG_ROUTE):
        quantity = quantity_name(MEAN if experiment == "standing" else END, experiment)
        for key, values in measured.items():
            if key.experiment not in (experiment, OTHER_FIGURES.format(experiment)):
                continue
            finite = np.array(values)[np.isfinite(values)]
            table = MEDIANS.format(experiment)
            if key.quantity == quantity:
                median = FigureKey(table, key.method, f"median {quantity}")
                value = float(np.median(finite)) if len(finite) else None
                unit = unit_of(median)
                yield ReproductionRow(*median, unit, None, value, None, None, len(finite))
            if key.quantity == quantity_name(END, experiment):
                lost = FigureKey(table, key.method, f"runs that end over {LOST_M:g} m away")
                count = float((finite > LOST_M).sum())
                yield ReproductionRow(*lost, "count", None, count, None, None, len(finite))


# --------------------------------------------------------------------------------------------------
# Section 3.2: localisation.


class OdometrySweep(NamedTuple):
    """A sweep, what the IMU measured since the one before, and the true (4, 4) pose at its stamp.

    start_from_lidar: in the LiDAR's frame of the first sweep.
    """

    scan: LidarScan
    imu: ImuSamples | None
    start_from_lidar: np.ndarray


class OdometryRun(NamedTuple):
    """What one odometry made of a drive.

    estimated_m, true_m: (T, 3) positions of the LiDAR, in its frame of the first scan.
    calls_ms: (T,) time of each call.
    """

    estimated_m: np.ndarray
    true_m: np.ndarray
    calls_ms: np.ndarray

    @property
    def errors_m(self) -> np.ndarray:
        """(T,) distance of each position from the truth."""
        return np.asarray(np.linalg.norm(self.estimated_m - self.true_m, axis=1))

    def save(self, file: BinaryIO) -> None:
        """Write it as NumPy's archive."""
        np.savez(file, **self._asdict())

    @classmethod
    def load(cls, file: BinaryIO) -> OdometryRun:
        """Read what `save` wrote."""
        with np.load(file, allow_pickle=False) as arrays:
            return cls(**arrays)


def methods_of(experiment: str) -> tuple[str, ...]:
    """Return the methods that run in an experiment."""
    if experiment in READING_EXPERIMENTS:
        return METHODS
    return (*(method for method in METHODS if method != "loam"), *LOOP_CLOSING)


def measure_localisation(
    experiment: str, specs: Sequence[str], seed: int, scans: int | None = None
) -> Figures:
    """Return the figures of methods in an experiment; scans: the first so many, all if None."""
    figures: Figures = {}
    for spec, run in kept_runs(experiment, specs, seed, scans).items():
        figures |= printed_figures(experiment, spec, run)
        figures |= other_figures(experiment, spec, run)
    return figures


def measure_readings(experiment: str, seed: int, scans: int | None = None) -> Figures:
    """Return the figures of the chain before a map with other readings of the paper.

    scans: as of `measure_localisation`.
    """
    figures: Figures = {}
    names = {WITH_MAP: "as taken", **OTHER_READINGS}
    for spec, run in kept_runs(experiment, tuple(names), seed, scans).items():
        figures |= printed_figures(experiment, names[spec], run, READING_FIGURES)
    return figures


def measure_with_noise(experiment: str, name: str, seed: int, scans: int | None = None) -> Figures:
    """Return the figures of the paper's chain and its rival with half or double noise.

    No result may depend on quiet sensors. scans: as of `measure_localisation`.
    """
    figures: Figures = {}
    sweeps = islice(sense_corridor(EXPERIMENTS[experiment], seed, NOISE_FACTORS[name]), scans)
    for spec, run in run_odometries(sweeps, (*PAPERS_METHODS, LEGO_LOAM)).items():
        figures |= printed_figures(experiment, spec, run, f"{{}}, {name}")
    return figures


def kept_runs(
    experiment: str, specs: Sequence[str], seed: int, scans: int | None = None
) -> dict[str, OdometryRun]:
    """Return the runs of odometries over an experiment, by spec; they are kept for the figures.

    scans: as of `measure_localisation`.
    """
    paths = {spec: kept_path("zhang2022-run", experiment, spec, seed, scans) for spec in specs}
    missing = [spec for spec, path in paths.items() if not path.exists()]
    new_runs = _runs(experiment, missing, seed, scans) if missing else {}

    def make(spec: str) -> OdometryRun:
        return new_runs[spec] if spec in new_runs else _runs(experiment, [spec], seed, scans)[spec]

    return {
        spec: read_or_make(path, OdometryRun.load, partial(make, spec))
        for spec, path in paths.items()
    }


def _runs(
    experiment: str, specs: Sequence[str], seed: int, scans: int | None
) -> dict[str, OdometryRun]:
    if experiment in EXPERIMENTS:
        return run_odometries(islice(sense_corridor(EXPERIMENTS[experiment], seed), scans), specs)
    episode = Episode(ROUTE_SCENARIO, seed, ROUTE_RIG, ROUTE_DURATION_S)
    return run_odometries(islice(sense_route(episode), scans), specs, imu_mounting(episode))


def sense_route(episode: Episode) -> Iterator[OdometrySweep]:
    """Yield the sweeps of an episode."""
    start_from_world: np.ndarray | None = None
    for step in drive(episode):
        world_from_lidar = step.world_from_lidar.matrix
        if start_from_world is None:
            start_from_world = np.linalg.inv(world_from_lidar)
        yield OdometrySweep(step.scan, step.imu, start_from_world @ world_from_lidar)


def run_odometries(
    sweeps: Iterable[CorridorSweep | OdometrySweep],
    specs: Iterable[str],
    lidar_from_imu: Pose | None = LIDAR_FROM_IMU,
) -> dict[str, OdometryRun]:
    """Run odometries over the same sweeps, by spec.

    Those that match scans alike, and have other maps behind the match or none, share the match; its
    time counts for each of them.
    """
    odometries = {spec: ODOMETRIES.make(SPECS.get(spec, spec)) for spec in specs}
    estimated_m: dict[str, list[np.ndarray]] = {spec: [] for spec in odometries}
    calls_ms: dict[str, list[float]] = {spec: [] for spec in odometries}
    true_m = []
    for odometry in odometries.values():
        odometry.reset(lidar_from_imu)
    for sweep in sweeps:
        true_m.append(sweep.start_from_lidar[:3, 3])
        matches: dict[tuple[type, Hashable], tuple[ScanToScan, float]] = {}
        for spec, odometry in odometries.items():
            start = process_time()
            if isinstance(odometry, MappedOdometry):
                key = type(odometry), odometry.matching
                if key not in matches:
                    matched = odometry.match(sweep.scan, sweep.imu)
                    matches[key] = matched, process_time() - start
                matched, matching_s = matches[key]
                start = process_time() - matching_s
                estimate = odometry.take(sweep.scan, matched)
            else:
                estimate = odometry.update(sweep.scan, sweep.imu)
            calls_ms[spec].append(1e3 * (process_time() - start))
            estimated_m[spec].append(estimate.start_from_lidar.translation)
    return {
        spec: OdometryRun(np.array(places), np.array(true_m), np.array(calls_ms[spec]))
        for spec, places in estimated_m.items()
    }


def printed_figures(experiment: str, method: str, run: OdometryRun, title: str = "{}") -> Figures:
    """Return the figures that the paper prints of an experiment.

    title: of the table, with a place for the experiment's name.
    """
    end_alone = experiment in END_ERROR_EXPERIMENTS
    figures = {END: end_error(run)} if end_alone else spread(run)
    counted = run.calls_ms[min(UNCOUNTED_CALLS, len(run.calls_ms) - 1) :]
    return _keyed(experiment, method, figures | {TIME_MS: float(counted.mean())}, title)


def other_figures(experiment: str, method: str, run: OdometryRun) -> Figures:
    """Return the figures of an experiment that the paper prints of other experiments."""
    figures = spread(run) if experiment in END_ERROR_EXPERIMENTS else {END: end_error(run)}
    return _keyed(experiment, method, figures, OTHER_FIGURES)


def _keyed(experiment: str, method: str, figures: Mapping[str, float], title: str) -> Figures:
    return {
        FigureKey(title.format(experiment), method, quantity_name(quantity, experiment)): value
        for quantity, value in figures.items()
    }


def end_error(run: OdometryRun) -> float:
    """Return the error of the last position, metres."""
    return float(run.errors_m[-1])


def spread(run: OdometryRun) -> dict[str, float]:
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


def verdicts(measured: Measured) -> list[Verdict]:
    """Judge the paper's claims: what is removed, and errors and times below LeGO-LOAM's."""
    judged = []
    for case in REMOVAL_CASES:
        for quantity, claim in (
            (RECALL, f"case {case}: people who walk are removed (more than half of their returns)"),
            (PRECISION, f"{NOT_CLAIMED}case {case}: more than half of what is removed is people"),
        ):
            key = FigureKey(REMOVAL.format(case), "zhang2022, 1 s apart", quantity)
            judged.append(judge(claim, SCAN_TO_SCAN, "%", measured[key], ClaimRange(low=50.0)))
        printed = PAPER[key._replace(quantity=TIME_MS)]
        claim = f"case {case}: removal within {printed} ms"
        times_ms = measured[key._replace(quantity=TIME_MS)]
        judged.append(judge(claim, SCAN_TO_SCAN, "ms", times_ms, ClaimRange(high=printed)))
    for (experiment, quantity), method in product(CLAIMED, PAPERS_METHODS):
        own = FigureKey(experiment, method, quantity)
        unit = MILLISECONDS_MORE if quantity == TIME_MS else METRES_MORE
        more = differences(measured, own, own._replace(method=LEGO_LOAM))
        claim = f"{experiment}: {quantity.removesuffix(', m')} below LeGO-LOAM's"
        judged.append(judge(claim, method, unit, more, LESS_THAN_NONE))
    return judged


OWN = tuple(spec for spec in methods_of(LONG_ROUTE) if spec.startswith("zhang2022"))
RIVALS = tuple(spec for spec in methods_of(LONG_ROUTE) if spec not in OWN)
ROUTES = {
    f"{LONG_ROUTE}, the paper's": partial(measure_localisation, LONG_ROUTE, OWN),
    f"{LONG_ROUTE}, others": partial(measure_localisation, LONG_ROUTE, RIVALS),
}
"""Two parts, for two processes: sensing is the same for all methods of a part."""
NOISY = {
    f"{experiment}, {name}": partial(measure_with_noise, experiment, name)
    for experiment, name in product(NOISE_EXPERIMENTS, NOISE_FACTORS)
}
REPRODUCTION = Paper(
    parts={
        "removal": measure_removal,
        **ROUTES,
        **{name: partial(measure_localisation, name, methods_of(name)) for name in EXPERIMENTS},
        **{f"{name}, readings": partial(measure_readings, name) for name in READING_EXPERIMENTS},
        **NOISY,
    },
    rows=rows,
    verdicts=verdicts,
    note_of=note_of,
)
