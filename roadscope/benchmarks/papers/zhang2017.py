"""The experiments of Zhang 2017 with the paper's figures beside ours.

The paper drives a mesh of a Ford Fusion past a simulated HDL-32E (tables 1 and 2), and follows a
real car with a real one (table 3 and a figure); here both are simulated. Every figure is the mean
over seeds of one seed's value.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from roadscope.benchmarks.papers.reproduction import (
    FigureKey,
    Figures,
    Measured,
    Paper,
    ReproductionRow,
    summarise,
)
from roadscope.benchmarks.papers.zhang2017_claims import claims, following, verdicts
from roadscope.benchmarks.papers.zhang2017_methods import (
    HEADING,
    METHODS,
    ON_EVERY_DRIVE,
    OURS,
    POSITION,
    READINGS,
    SINGLE,
    TURNED,
    errors,
    estimate,
    medians_and_shares,
    nees,
    rmse,
    scored,
)
from roadscope.benchmarks.papers.zhang2017_scene import FOLLOWED_M, SensedDrive, sense_drive
from roadscope.benchmarks.papers.zhang2017_tables import (
    BESIDE,
    COUNTS,
    FOLLOWING,
    FRAMES,
    HIGH,
    MEAN,
    NEES,
    NOISE,
    RATIO,
    RATIOS,
    READING,
    RMSE,
    SIMULATED,
    SLOWEST,
    TIMES,
    TURNED_FRAMES,
    frames_name,
    note_of,
    paper_figure,
    unit_of,
)
from roadscope.envs.world.saloon_body import CORNER_RADII_M

FOLLOWED_FRAMES = 17
"""Of each seed and distance; thirty seeds together have the paper's 500."""
BODIES = tuple(CORNER_RADII_M)
"""Sharp and rounded corners."""
VARIED_DRIVES = ("straight", "curve")
"""Drives that run again with other noise, and with a higher sensor."""
NOISE_FACTORS = (0.5, 2.0)
HIGH_M = 1.9
"""Height of a sensor on a car's roof, the other reading of where it stands."""


def rows(measured: Measured) -> list[ReproductionRow]:
    """Return the paper's figures beside ours, and which claims hold in how many seeds."""
    of_figures = [
        summarise(key, unit_of(key), values, paper_figure(key)) for key, values in measured.items()
    ]
    return of_figures + claims(measured, BODIES)


# --------------------------------------------------------------------------------------------------
# The parts of a seed. Each keeps the figures of its drives; all figures follow from these.

RUNS = "runs"
"""Experiment of the figures of single drives, which no table shows."""
SIMULATED_RUNS, FOLLOWING_RUNS, HIGH_RUNS, NOISY_RUNS = "simulated", "following", "high", "noise"


# frames: how many are taken from the beginning of each drive.


def measure_simulated(body: str, seed: int, frames: int | None = None) -> Figures:
    """Return the figures of all methods on the simulated drives of one body."""
    warm_up()
    runs = (sense_drive(drive, seed, body=body, frames=frames) for drive in SIMULATED)
    return _figures_of(SIMULATED_RUNS, (run_methods(run, tuple(METHODS)) for run in runs))


def measure_following(body: str, seed: int, frames: int = FOLLOWED_FRAMES) -> Figures:
    """Return the figures of the following experiment with one body."""
    warm_up()
    runs = (sense_drive(following(metres), seed, body=body, frames=frames) for metres in FOLLOWED_M)
    return _figures_of(FOLLOWING_RUNS, (run_methods(run, ON_EVERY_DRIVE) for run in runs))


def measure_with_noise(factor: float, seed: int, frames: int | None = None) -> Figures:
    """Return the figures with other noise: no result may depend on a quiet sensor."""
    warm_up()
    runs = (sense_drive(drive, seed, noise=factor, frames=frames) for drive in VARIED_DRIVES)
    return _figures_of(f"{NOISY_RUNS} {factor}", (run_methods(run, ON_EVERY_DRIVE) for run in runs))


def measure_from_roof(seed: int, frames: int | None = None) -> Figures:
    """Return the figures from the roof of a car: the paper does not say where its sensor is."""
    warm_up()
    runs = (
        sense_drive(drive, seed, sensor_height_m=HIGH_M, frames=frames) for drive in VARIED_DRIVES
    )
    return _figures_of(HIGH_RUNS, (run_methods(run, ON_EVERY_DRIVE) for run in runs))


def of_seed(figures: Figures) -> Figures:
    """Return every figure that follows from the drives of one seed."""
    simulated, follow, high = (
        _runs(figures, kind) for kind in (SIMULATED_RUNS, FOLLOWING_RUNS, HIGH_RUNS)
    )
    noisy = {factor: _runs(figures, f"{NOISY_RUNS} {factor}") for factor in NOISE_FACTORS}
    usual = (*simulated, *follow)
    kinds: dict[str, Sequence[DriveFigures]] = {
        body: [run for run in usual if run.body == body] for body in BODIES
    }
    kinds |= {f"noise x{factor:g}": runs for factor, runs in noisy.items()}
    kinds[f"{HIGH_M} m"] = high
    return (
        _tables_1_and_2(simulated)
        | _following_figures(follow)
        | _noise_figures(noisy)
        | _high_figures(high)
        | _nees_figures(usual)
        | _turned_shares(kinds)
        | _frame_counts(usual, high)
        | _table_3(follow, usual)
    )


def _figures_of(kind: str, runs: Iterable[DriveFigures]) -> Figures:
    """Return the figures of drives under names from which `_runs` reads them."""
    figures: Figures = {}
    for run in runs:
        name = f"{kind}|{run.drive}|{run.body}"
        figures[FigureKey(RUNS, name, "|frames")] = run.frames
        figures[FigureKey(RUNS, name, "|unscored")] = run.unscored
        for group, by_method in ((RMSE, run.rmse), (BESIDE, run.beside)):
            for method, columns in by_method.items():
                for column, value in columns.items():
                    key = FigureKey(RUNS, name, f"{group}|{method}|{column}")
                    figures[key] = float(value)
        for method, value in run.nees.items():
            figures[FigureKey(RUNS, name, f"{NEES}|{method}|")] = value
        for method, times_ms in run.times_ms.items():
            for k, time_ms in enumerate(times_ms.tolist()):
                figures[FigureKey(RUNS, name, f"{TIMES}|{method}|{k}")] = time_ms
    return figures


def _runs(figures: Figures, kind: str) -> list[DriveFigures]:
    """Return the drives of a kind that `_kept` wrote."""
    runs: dict[str, DriveFigures] = {}
    times_ms: dict[tuple[str, str], list[float]] = {}
    for (experiment, name, quantity), value in figures.items():
        if experiment != RUNS or not name.startswith(f"{kind}|"):
            continue
        if name not in runs:
            _, drive, body = name.split("|")
            frames, unscored = (
                round(figures[FigureKey(RUNS, name, what)]) for what in ("|frames", "|unscored")
            )
            runs[name] = DriveFigures(drive, body, frames, unscored, {}, {}, {}, {})
        group, method, *column = quantity.split("|")
        if group in (RMSE, BESIDE):
            tables = runs[name].rmse if group == RMSE else runs[name].beside
            tables.setdefault(method, {})[column[0]] = value
        elif group == NEES:
            runs[name].nees[method] = value
        elif group == TIMES:
            times_ms.setdefault((name, method), []).append(value)
    for (name, method), values in times_ms.items():
        runs[name].times_ms[method] = np.array(values)
    return list(runs.values())


# --------------------------------------------------------------------------------------------------
# All methods on one drive.


@dataclass(frozen=True, slots=True)
class DriveFigures:
    """What the methods make of one drive.

    frames, unscored: all frames, and those with too few returns to be scored.
    rmse: columns of tables 1 and 2 by method.
    beside: medians, and percentages of scored frames, by method.
    nees: by method that gives a covariance.
    times_ms: of each frame that was answered alone, by method.
    """

    drive: str
    body: str
    frames: int
    unscored: int
    rmse: dict[str, dict[str, float]]
    beside: dict[str, dict[str, float]]
    nees: dict[str, float]
    times_ms: dict[str, np.ndarray]


def run_methods(run: SensedDrive, methods: Sequence[str]) -> DriveFigures:
    """Run methods on a drive and return their figures."""
    unscored = int((~scored(run)).sum())
    figures = DriveFigures(run.drive.name, run.body, len(run.sweeps), unscored, {}, {}, {}, {})
    for name in methods:
        poses, figures.times_ms[name] = estimate(METHODS[name], run)
        errors_of_frames = errors(run, poses)
        figures.rmse[name] = rmse(run, errors_of_frames)
        figures.beside[name] = medians_and_shares(run, errors_of_frames)
        if np.isfinite(mean_nees := nees(run, poses)):
            figures.nees[name] = mean_nees
    return figures


@cache
def warm_up() -> None:
    """Compile everything, once a process, so that no frame's time contains it."""
    for drive in ("curve", "following-10"):
        run_methods(sense_drive(drive, 0, frames=4), tuple(METHODS))


# --------------------------------------------------------------------------------------------------
# Figures by experiment.


def _tables_1_and_2(simulated: Sequence[DriveFigures]) -> Figures:
    figures: Figures = {}
    for each in simulated:
        table = RMSE.format(each.drive, each.body, SIMULATED[each.drive])
        figures |= _keyed(table, each.rmse)
        figures |= _keyed(BESIDE.format(each.drive, each.body), each.beside)
    return figures


def _keyed(experiment: str, rows: Mapping[str, Mapping[str, float]]) -> Figures:
    return {
        FigureKey(experiment, method, quantity): float(value)
        for method, row in rows.items()
        for quantity, value in row.items()
    }


def _following_figures(following_runs: Sequence[DriveFigures]) -> Figures:
    return {
        FigureKey(FOLLOWING.format(each.body, column), method, _distance(each)): row[column]
        for body in BODIES
        for column in (POSITION, HEADING)
        for each in following_runs
        if each.body == body
        for method, row in each.rmse.items()
    }


def _distance(each: DriveFigures) -> str:
    return f"{each.drive.removeprefix('following-')} m"


def _noise_figures(noisy: Mapping[float, Sequence[DriveFigures]]) -> Figures:
    """Return the figures with other noise: no result may depend on a quiet sensor."""
    return {
        FigureKey(NOISE.format(column), method, f"{each.drive} x{factor:g}"): row[column]
        for column in (POSITION, HEADING)
        for factor, runs in noisy.items()
        for each in runs
        for method, row in each.rmse.items()
    }


def _high_figures(high: Sequence[DriveFigures]) -> Figures:
    """Return the figures from the roof of a car: the paper does not say where its sensor is."""
    figures: Figures = {}
    for each in high:
        figures |= _keyed(HIGH.format(each.drive, SIMULATED[each.drive]), each.rmse)
    return figures


def _nees_figures(runs: Iterable[DriveFigures]) -> Figures:
    """Return the NEES of ours by drive and number of frames."""
    return {
        FigureKey(NEES.format(each.body), each.drive, frames_name(frames)): each.nees[method]
        for each in runs
        for method, frames in OURS.items()
    }


def _turned_shares(kinds: Mapping[str, Sequence[DriveFigures]]) -> Figures:
    """Return the percentage of scored frames with a heading turned by 90 deg, by kind of runs."""
    figures: Figures = {}
    for kind, runs in kinds.items():
        for method in METHODS:
            with_method = [each for each in runs if method in each.beside]
            if with_method:
                shares = [each.beside[method][TURNED] for each in with_method]
                weights = np.array([each.frames - each.unscored for each in with_method])
                share = float(np.average(shares, weights=weights))
                figures[FigureKey(TURNED_FRAMES, method, kind)] = share
    return figures


def _frame_counts(runs: Iterable[DriveFigures], high: Iterable[DriveFigures]) -> Figures:
    figures: Figures = {}
    named = [(each.drive, each) for each in runs] + [(f"{e.drive}, {HIGH_M} m", e) for e in high]
    for name, each in named:
        figures[FigureKey(COUNTS, name, FRAMES)] = each.frames
        figures[FigureKey(COUNTS, name, each.body)] = each.unscored
    return figures


def _table_3(following_runs: Sequence[DriveFigures], runs: Sequence[DriveFigures]) -> Figures:
    """Return the times, those of the following experiment pooled, as in the paper."""
    rows = {}
    for method in ON_EVERY_DRIVE:
        times_ms = np.concatenate([each.times_ms.get(method, []) for each in following_runs])
        rows[method] = {
            "median": float(np.median(times_ms)),
            MEAN: float(times_ms.mean()),
            "least": float(times_ms.min()),
            "most": float(times_ms.max()),
            SLOWEST: max(_mean_ms(each, method) for each in runs),
        }
    ratios = {method: {RATIO: row[MEAN] / rows[SINGLE][MEAN]} for method, row in rows.items()}
    return _keyed(TIMES, rows) | _keyed(RATIOS, ratios)


def _mean_ms(each: DriveFigures, method: str) -> float:
    times_ms = each.times_ms.get(method, np.empty(0))
    return float(times_ms.mean()) if len(times_ms) else 0.0


def measure_readings(seed: int, frames: int | None = None) -> Figures:
    """Return the errors with other readings of what the paper leaves open."""
    by_drive: dict[str, dict[str, dict[str, float]]] = {}
    for drive in SIMULATED:
        run = sense_drive(drive, seed, frames=frames)
        by_drive[drive] = {
            name: rmse(run, errors(run, estimate(method, run)[0]))
            for name, method in READINGS.items()
        }
    return {
        FigureKey(READING.format(column), reading, drive): row[column]
        for column in (POSITION, HEADING)
        for drive, readings in by_drive.items()
        for reading, row in readings.items()
    }


REPRODUCTION = Paper(
    parts={
        **{f"{SIMULATED_RUNS}, {body}": partial(measure_simulated, body) for body in BODIES},
        **{f"{FOLLOWING_RUNS}, {body}": partial(measure_following, body) for body in BODIES},
        **{f"{NOISY_RUNS} {f}": partial(measure_with_noise, f) for f in NOISE_FACTORS},
        HIGH_RUNS: measure_from_roof,
        "readings": measure_readings,
    },
    of_seed=of_seed,
    hidden=frozenset({RUNS}),
    rows=rows,
    verdicts=partial(verdicts, bodies=BODIES),
    note_of=note_of,
)
