"""The experiments of Zhang 2017 with the paper's figures beside ours.

The paper drives a mesh of a Ford Fusion past a simulated HDL-32E, and follows a real car with a
real one; here both are simulated. Every figure is the mean over seeds of one seed's value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from roadscope.benchmarks.papers.reproduction import Key, ReproductionRow, over_seeds, summarise
from roadscope.benchmarks.papers.zhang2017_drives import FOLLOWED_M
from roadscope.benchmarks.papers.zhang2017_errors import HEADING, POSITION, TURNED
from roadscope.benchmarks.papers.zhang2017_methods import METHODS, OURS, REPEATED, SINGLE
from roadscope.benchmarks.papers.zhang2017_names import (
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
    SLOWEST,
    TIMES,
    TURNED_FRAMES,
    frames_name,
    note_of,
    paper_figure,
    unit_of,
)
from roadscope.benchmarks.papers.zhang2017_paper import HIGH_M, SIMULATED
from roadscope.benchmarks.papers.zhang2017_readings import compare
from roadscope.benchmarks.papers.zhang2017_scene import film
from roadscope.benchmarks.papers.zhang2017_taken import Taken, take, warm_up
from roadscope.benchmarks.papers.zhang2017_verdicts import verdicts
from roadscope.envs.world.ford_saloon import CORNER_RADII_M

__all__ = ["note_of", "reproduce"]

FIRST_SEED = 20000
"""Test seeds, as in the suites; what was chosen by trying was chosen on seeds below."""
FOLLOWED_FRAMES = 17
"""Of each seed and distance; thirty seeds together have the paper's 500."""
BODIES = tuple(CORNER_RADII_M)
NOISES = (0.5, 2.0)
APART = ("straight", "curve")
"""Drives that are run once more with other noise, and from a greater height."""
Values = dict[Key, float]


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
    return rows + verdicts(measured, BODIES)


def measure(seed: int) -> Values:
    """Measure every quantity of every experiment and method with one seed."""
    warm_up()
    simulated = [
        take(film(drive, seed, body=body), tuple(METHODS)) for body in BODIES for drive in SIMULATED
    ]
    followed = [
        take(
            film(f"following-{metres}", seed, body=body, frames=FOLLOWED_FRAMES),
            REPEATED,
        )
        for body in BODIES
        for metres in FOLLOWED_M
    ]
    noisy = {
        factor: [take(film(drive, seed, noise=factor), REPEATED) for drive in APART]
        for factor in NOISES
    }
    high = [take(film(drive, seed, sensor_height_m=HIGH_M), REPEATED) for drive in APART]
    kinds: dict[str, Sequence[Taken]] = {
        body: [taken for taken in (*simulated, *followed) if taken.body == body] for body in BODIES
    }
    kinds |= {f"noise x{factor:g}": runs for factor, runs in noisy.items()}
    kinds[f"{HIGH_M} m"] = high
    return (
        _tables(simulated)
        | _following(followed)
        | _noises(noisy)
        | _high(high)
        | _nees((*simulated, *followed))
        | _turned(kinds)
        | _counts((*simulated, *followed), high)
        | _times(followed, (*simulated, *followed))
        | _readings(seed)
    )


def _tables(simulated: Sequence[Taken]) -> Values:
    found: Values = {}
    for taken in simulated:
        name = RMSE.format(taken.drive, taken.body, SIMULATED[taken.drive])
        found |= _keyed(name, taken.rmse)
        found |= _keyed(BESIDE.format(taken.drive, taken.body), taken.beside)
    return found


def _keyed(experiment: str, rows: Mapping[str, Mapping[str, float]]) -> Values:
    return {
        (experiment, method, quantity): float(value)
        for method, row in rows.items()
        for quantity, value in row.items()
    }


def _following(followed: Sequence[Taken]) -> Values:
    return {
        (FOLLOWING.format(taken.body, quantity), method, _metres(taken)): row[quantity]
        for body in BODIES
        for quantity in (POSITION, HEADING)
        for taken in followed
        if taken.body == body
        for method, row in taken.rmse.items()
    }


def _metres(taken: Taken) -> str:
    return f"{taken.drive.removeprefix('following-')} m"


def _noises(noisy: Mapping[float, Sequence[Taken]]) -> Values:
    """Nothing may hang on a quiet sensor."""
    return {
        (NOISE.format(quantity), method, f"{taken.drive} x{factor:g}"): row[quantity]
        for quantity in (POSITION, HEADING)
        for factor, runs in noisy.items()
        for taken in runs
        for method, row in taken.rmse.items()
    }


def _high(high: Sequence[Taken]) -> Values:
    """From the roof of a car: the paper does not say where its sensor is."""
    found: Values = {}
    for taken in high:
        found |= _keyed(HIGH.format(taken.drive, SIMULATED[taken.drive]), taken.rmse)
    return found


def _nees(runs: Iterable[Taken]) -> Values:
    """Of ours, by drive and number of frames."""
    found: Values = {}
    for taken in runs:
        for method, frames in OURS.items():
            place = taken.drive, frames_name(frames)
            found[NEES.format(taken.body), *place] = taken.nees[method]
    return found


def _turned(kinds: Mapping[str, Sequence[Taken]]) -> Values:
    """Share of the scored frames of runs of one kind, by those methods that all runs have."""
    found: Values = {}
    for kind, runs in kinds.items():
        scored = np.array([taken.frames - taken.few for taken in runs])
        for method in METHODS:
            known = [method in taken.beside for taken in runs]
            if any(known):
                shares = [taken.beside[method][TURNED] for taken in runs if method in taken.beside]
                found[TURNED_FRAMES, method, kind] = float(
                    np.average(shares, weights=scored[known])
                )
    return found


def _counts(runs: Iterable[Taken], high: Iterable[Taken]) -> Values:
    found: Values = {}
    for name, taken in [(t.drive, t) for t in runs] + [(f"{t.drive}, 1.9 m", t) for t in high]:
        found[COUNTS, name, FRAMES] = taken.frames
        found[COUNTS, name, taken.body] = taken.few
    return found


def _times(followed: Sequence[Taken], runs: Sequence[Taken]) -> Values:
    """Pool the times of the following experiment, as the paper does; other drives by their mean."""
    rows = {}
    for method in REPEATED:
        values = np.concatenate([taken.spent[method] for taken in followed])
        rows[method] = {
            "median": float(np.median(values)),
            MEAN: float(values.mean()),
            "least": float(values.min()),
            "most": float(values.max()),
            SLOWEST: max(_mean_ms(taken, method) for taken in runs),
        }
    ratios = {m: {RATIO: row[MEAN] / rows[SINGLE][MEAN]} for m, row in rows.items()}
    return _keyed(TIMES, rows) | _keyed(RATIOS, ratios)


def _mean_ms(taken: Taken, method: str) -> float:
    values = taken.spent[method]
    return float(values.mean()) if len(values) else 0.0


def _readings(seed: int) -> Values:
    tried = {drive: compare(film(drive, seed)) for drive in SIMULATED}
    return {
        (READING.format(quantity), reading, drive): row[quantity]
        for quantity in (POSITION, HEADING)
        for drive, readings in tried.items()
        for reading, row in readings.items()
    }
