"""The experiments of Zhang 2017 with the paper's figures beside ours.

The paper drives a mesh of a Ford Fusion past a simulated HDL-32E (tables 1 and 2), and follows a
real car with a real one (table 3 and a figure); here both are simulated. Every figure is the mean
over seeds of one seed's value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.benchmarks.papers.reproduction import (
    FigureKey,
    ReproductionRow,
    over_seeds,
    summarise,
)
from roadscope.benchmarks.papers.zhang2017_claims import claims, following
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
from roadscope.envs.world.ford_saloon import CORNER_RADII_M

__all__ = ["note_of", "reproduce"]

FIRST_SEED = 20000
"""Test seeds, as in the suites; what was chosen by trying was chosen on seeds below."""
FOLLOWED_FRAMES = 17
"""Of each seed and distance; thirty seeds together have the paper's 500."""
BODIES = tuple(CORNER_RADII_M)
"""Sharp and rounded corners."""
VARIED_DRIVES = ("straight", "curve")
"""Drives that run again with other noise, and with a higher sensor."""
NOISE_FACTORS = (0.5, 2.0)
HIGH_M = 1.9
"""Height of a sensor on a car's roof, the other reading of where it stands."""


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
    return rows + claims(measured, BODIES)


def measure(seed: int) -> dict[FigureKey, float]:
    """Return every figure of every experiment and method with one seed."""
    warm_up()
    simulated = [
        run_methods(sense_drive(drive, seed, body=body), tuple(METHODS))
        for body in BODIES
        for drive in SIMULATED
    ]
    following_runs = [
        run_methods(
            sense_drive(following(metres), seed, body=body, frames=FOLLOWED_FRAMES), ON_EVERY_DRIVE
        )
        for body in BODIES
        for metres in FOLLOWED_M
    ]
    noisy = {
        factor: [
            run_methods(sense_drive(drive, seed, noise=factor), ON_EVERY_DRIVE)
            for drive in VARIED_DRIVES
        ]
        for factor in NOISE_FACTORS
    }
    high = [
        run_methods(sense_drive(drive, seed, sensor_height_m=HIGH_M), ON_EVERY_DRIVE)
        for drive in VARIED_DRIVES
    ]
    usual = (*simulated, *following_runs)
    kinds: dict[str, Sequence[DriveFigures]] = {
        body: [figures for figures in usual if figures.body == body] for body in BODIES
    }
    kinds |= {f"noise x{factor:g}": runs for factor, runs in noisy.items()}
    kinds[f"{HIGH_M} m"] = high
    return (
        _tables_1_and_2(simulated)
        | _following_figures(following_runs)
        | _noise_figures(noisy)
        | _high_figures(high)
        | _nees_figures(usual)
        | _turned_shares(kinds)
        | _frame_counts(usual, high)
        | _table_3(following_runs, usual)
        | _reading_figures(seed)
    )


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


def _tables_1_and_2(simulated: Sequence[DriveFigures]) -> dict[FigureKey, float]:
    figures: dict[FigureKey, float] = {}
    for each in simulated:
        table = RMSE.format(each.drive, each.body, SIMULATED[each.drive])
        figures |= _keyed(table, each.rmse)
        figures |= _keyed(BESIDE.format(each.drive, each.body), each.beside)
    return figures


def _keyed(experiment: str, rows: Mapping[str, Mapping[str, float]]) -> dict[FigureKey, float]:
    return {
        FigureKey(experiment, method, quantity): float(value)
        for method, row in rows.items()
        for quantity, value in row.items()
    }


def _following_figures(following_runs: Sequence[DriveFigures]) -> dict[FigureKey, float]:
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


def _noise_figures(noisy: Mapping[float, Sequence[DriveFigures]]) -> dict[FigureKey, float]:
    """Return the figures with other noise: no result may depend on a quiet sensor."""
    return {
        FigureKey(NOISE.format(column), method, f"{each.drive} x{factor:g}"): row[column]
        for column in (POSITION, HEADING)
        for factor, runs in noisy.items()
        for each in runs
        for method, row in each.rmse.items()
    }


def _high_figures(high: Sequence[DriveFigures]) -> dict[FigureKey, float]:
    """Return the figures from the roof of a car: the paper does not say where its sensor is."""
    figures: dict[FigureKey, float] = {}
    for each in high:
        figures |= _keyed(HIGH.format(each.drive, SIMULATED[each.drive]), each.rmse)
    return figures


def _nees_figures(runs: Iterable[DriveFigures]) -> dict[FigureKey, float]:
    """Return the NEES of ours by drive and number of frames."""
    return {
        FigureKey(NEES.format(each.body), each.drive, frames_name(frames)): each.nees[method]
        for each in runs
        for method, frames in OURS.items()
    }


def _turned_shares(kinds: Mapping[str, Sequence[DriveFigures]]) -> dict[FigureKey, float]:
    """Return the percentage of scored frames with a heading turned by 90 deg, by kind of runs."""
    figures: dict[FigureKey, float] = {}
    for kind, runs in kinds.items():
        for method in METHODS:
            with_method = [each for each in runs if method in each.beside]
            if with_method:
                shares = [each.beside[method][TURNED] for each in with_method]
                weights = np.array([each.frames - each.unscored for each in with_method])
                share = float(np.average(shares, weights=weights))
                figures[FigureKey(TURNED_FRAMES, method, kind)] = share
    return figures


def _frame_counts(
    runs: Iterable[DriveFigures], high: Iterable[DriveFigures]
) -> dict[FigureKey, float]:
    figures: dict[FigureKey, float] = {}
    named = [(each.drive, each) for each in runs] + [(f"{e.drive}, {HIGH_M} m", e) for e in high]
    for name, each in named:
        figures[FigureKey(COUNTS, name, FRAMES)] = each.frames
        figures[FigureKey(COUNTS, name, each.body)] = each.unscored
    return figures


def _table_3(
    following_runs: Sequence[DriveFigures], runs: Sequence[DriveFigures]
) -> dict[FigureKey, float]:
    """Return the times, those of the following experiment pooled, as in the paper."""
    rows = {}
    for method in ON_EVERY_DRIVE:
        times_ms = np.concatenate([each.times_ms[method] for each in following_runs])
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
    times_ms = each.times_ms[method]
    return float(times_ms.mean()) if len(times_ms) else 0.0


def _reading_figures(seed: int) -> dict[FigureKey, float]:
    """Return the errors with other readings of what the paper leaves open."""
    by_drive: dict[str, dict[str, dict[str, float]]] = {}
    for drive in SIMULATED:
        run = sense_drive(drive, seed)
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
