"""The experiments of Zhang 2017 with the paper's figures beside ours.

The paper drives a mesh of a Ford Fusion past a simulated HDL-32E, and follows a real car with a
real one; here both are simulated. Every figure is the mean over seeds of one seed's RMSE.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from roadscope.benchmarks.reproduction import ReproductionRow, summarise
from roadscope.benchmarks.zhang2017_claims import floor_name, our_claims, paper_claims
from roadscope.benchmarks.zhang2017_drives import FOLLOWED_M
from roadscope.benchmarks.zhang2017_errors import (
    HEADING,
    MEDIAN_HEADING,
    MEDIAN_POSITION,
    POSITION,
    TURNED,
    UNITS,
    errors,
    floor_rmse,
    rmse,
    scored,
    typical,
)
from roadscope.benchmarks.zhang2017_floor import floor
from roadscope.benchmarks.zhang2017_methods import (
    METHODS,
    OURS,
    REPEATED,
    SINGLE,
    estimate,
)
from roadscope.benchmarks.zhang2017_paper import NOTES, PAPER, PAPER_TIMES, SIMULATED
from roadscope.benchmarks.zhang2017_scene import Run, film
from roadscope.envs.world.ford_fusion import CORNER_RADII_M

FIRST_SEED = 20000
"""Test seeds, as in the suites; what was chosen by trying was chosen on seeds below."""
FLOOR_SEEDS, FLOOR_DRAWS = 3, 512
"""The floor is a computed expectation and takes minutes: it is computed for the first seeds."""
FOLLOWED_FRAMES = 17
"""Of each seed and distance; thirty seeds together have the paper's 500."""
BODIES = tuple(CORNER_RADII_M)
NOISES = {"half": 0.5, "double": 2.0}
HIGH_M = 1.9
"""Height of a sensor on a car's roof, the other reading of where it stands."""
TIMES, RATIOS = "table 3, time a frame while following", "table 3, ratios"
RATIO = "median time over single frame's"
CLAIMS = "claims, {} body"

Key = tuple[str, str, str]
"""Experiment, method, quantity."""
Rows = dict[tuple[str, str], dict[str, float]]
"""(drive, method) -> RMSE by column."""


def reproduce(
    seeds: int = 30, progress: Callable[[int, int], None] | None = None, *, jobs: int = 1
) -> list[ReproductionRow]:
    """Run all experiments and return the paper's figures beside ours.

    seeds: how many seeds stand behind every interval, except the floor's.
    progress: called with seeds done and seeds in all, after each.
    jobs: processes that share the seeds; all rows but the times are the same for any number.
    """
    if seeds < 1:
        raise ValueError(f"at least one seed is needed, got {seeds}")
    measured: dict[Key, list[float]] = {}
    for done, values in enumerate(_all_seeds(seeds, jobs), start=1):
        for key, value in values.items():
            measured.setdefault(key, []).append(value)
        if progress is not None:
            progress(done, seeds)
    return [
        summarise((experiment, method), quantity, unit_of(key), values, paper_figure(key))
        for key, values in measured.items()
        for experiment, method, quantity in (key,)
    ]


def note_of(experiment: str) -> str | None:
    """Return what must be known to read an experiment's table."""
    return next((note for word, note in NOTES.items() if word in experiment), None)


def measure(seed: int) -> dict[Key, float]:
    """Measure every quantity of every experiment and method with one seed."""
    found: dict[Key, float] = {}
    times: dict[str, list[np.ndarray]] = {}
    claims: dict[Key, float] = {}
    for body in BODIES:
        table: Rows = {}
        turned = 0.0
        for drive, number in SIMULATED.items():
            run = film(drive, seed, body=body)
            medians, _ = _take(run, table, tuple(METHODS))
            turned = max(turned, *(medians[m][TURNED] for m in OURS))
            name = f"{drive}, {body} body ({number})"
            found |= _keyed(name, {m: row for (d, m), row in table.items() if d == drive})
            found |= _keyed(f"{drive}, {body} body, beside RMSE", medians)
            found |= _counted(name, run)
        for metres in FOLLOWED_M:
            run = film(f"following-{metres}", seed, body=body, frames=FOLLOWED_FRAMES)
            medians, spent = _take(run, table)
            turned = max(turned, *(medians[m][TURNED] for m in OURS))
            for method, values in spent.items():
                times.setdefault(method, []).append(values)
        found |= _following(table, body)
        claims |= _keyed(CLAIMS.format(body), {"the paper's": paper_claims(table)})
        claims |= _keyed(CLAIMS.format(body), {"ours": our_claims(table, turned)})
    return found | _noises(seed) | _high(seed) | _times(times) | claims


def _take(
    run: Run, table: Rows, methods: Sequence[str] = REPEATED, *, floors: bool = True
) -> tuple[dict[str, dict[str, float]], dict[str, np.ndarray]]:
    """Add every method's and, in the first seeds, the floor's RMSE; return medians and times."""
    medians, times = {}, {}
    for name in methods:
        poses, times[name] = estimate(METHODS[name], run)
        found = errors(run, poses)
        table[run.drive.name, name] = rmse(run, found)
        medians[name] = typical(run, found)
    if floors and FIRST_SEED <= run.seed < FIRST_SEED + FLOOR_SEEDS:
        for frames in OURS.values():
            least = floor(run, frames, draws=FLOOR_DRAWS)
            table[run.drive.name, floor_name(frames)] = floor_rmse(run, least)
    return medians, times


def _keyed(experiment: str, rows: Mapping[str, Mapping[str, float]]) -> dict[Key, float]:
    return {
        (experiment, method, quantity): float(value)
        for method, row in rows.items()
        for quantity, value in row.items()
    }


def _counted(experiment: str, run: Run) -> dict[Key, float]:
    few = int((~scored(run)).sum())
    counts = {"frames": len(run.shots), "fewer than 3 returns, not scored": few}
    return _keyed(experiment, {"the drive": counts})


def _following(table: Rows, body: str) -> dict[Key, float]:
    return {
        (f"following, {body} body: {quantity} RMSE", method, f"{metres} m"): row[quantity]
        for quantity in (POSITION, HEADING)
        for metres in FOLLOWED_M
        for (drive, method), row in table.items()
        if drive == f"following-{metres}"
    }


def _noises(seed: int) -> dict[Key, float]:
    """Once more with other range noise: nothing may hang on a quiet sensor."""
    found: dict[Key, float] = {}
    for drive in SIMULATED:
        for name, factor in NOISES.items():
            if drive == "straight-past":
                continue
            table: Rows = {}
            _take(film(drive, seed, noise=factor), table)
            for (_, method), row in table.items():
                for quantity in (POSITION, HEADING):
                    experiment = f"half and double noise, sharp body: {quantity} RMSE"
                    found[experiment, method, f"{drive}, {name}"] = row[quantity]
    return dict(sorted(found.items(), key=lambda item: item[0][0], reverse=True))


def _high(seed: int) -> dict[Key, float]:
    """Once more from the roof of a car: the paper does not say where its sensor is."""
    found: dict[Key, float] = {}
    for drive in ("straight", "curve"):
        run = film(drive, seed, sensor_height_m=HIGH_M)
        table: Rows = {}
        _take(run, table, floors=False)
        name = f"{drive}, sharp body, sensor at {HIGH_M} m ({SIMULATED[drive]})"
        found |= _keyed(name, {method: row for (_, method), row in table.items()})
        found |= _counted(name, run)
    return found


def _times(spent: dict[str, list[np.ndarray]]) -> dict[Key, float]:
    rows = {}
    pooled = {method: np.concatenate(values) for method, values in spent.items()}
    for method, values in pooled.items():
        rows[method] = {
            "median": float(np.median(values)),
            "mean": float(values.mean()),
            "least": float(values.min()),
            "most": float(values.max()),
        }
    single = rows[SINGLE]["median"]
    ratios = {
        m: {"median time over single frame's": row["median"] / single} for m, row in rows.items()
    }
    return _keyed(TIMES, rows) | _keyed(RATIOS, ratios)


def paper_figure(key: Key) -> float | None:
    """Return what the paper prints for a quantity, None where it prints nothing."""
    experiment, method, quantity = key
    for (table, of), row in PAPER.items():
        if experiment.endswith(f"({table})") and method == of:
            return row[quantity]
    if experiment == TIMES and method in PAPER_TIMES:
        return PAPER_TIMES[method].get(quantity)
    if experiment == RATIOS and method in PAPER_TIMES:
        return round(PAPER_TIMES[method]["mean"] / PAPER_TIMES[SINGLE]["mean"], 3)
    return 1.0 if experiment.startswith("claims") and method == "the paper's" else None


def unit_of(key: Key) -> str:
    """Return the unit in which a quantity is given."""
    experiment, method, quantity = key
    if experiment.startswith("claims"):
        return "share"
    if method == "the drive":
        return "count"
    if experiment.startswith("table 3"):
        return "ms" if experiment == TIMES else "1"
    units = {**UNITS, MEDIAN_POSITION: "m", MEDIAN_HEADING: "deg"}
    if quantity in units:
        return units[quantity]
    if experiment.endswith("RMSE") and not experiment.endswith("beside RMSE"):
        return "deg" if f": {HEADING} " in experiment else "m"
    return "share"


def _all_seeds(seeds: int, jobs: int) -> Iterator[dict[Key, float]]:
    numbers: Sequence[int] = range(FIRST_SEED, FIRST_SEED + seeds)
    if jobs == 1:
        yield from map(measure, numbers)
        return
    from joblib import Parallel, delayed

    yield from Parallel(n_jobs=jobs, return_as="generator")(
        delayed(measure)(seed) for seed in numbers
    )
