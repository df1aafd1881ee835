"""How near our pose fit is to the information floor on the drives of Zhang 2017.

For each drive, body and number of frames: the RMSE of ours, the least RMSE of any estimator that
knows as much, and the least of one that also knows the corners' radius and the acceleration. Then
the NEES of ours beside that of the exact posterior, and what is asked of ours.

One seed takes about ten minutes on one core.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from research.information_floor import (
    KNOWS_ALL,
    KNOWS_AS_MUCH_AS_OURS,
    InformationFloor,
    Knowledge,
    floors,
)
from research.studies import measured_over_seeds, show, study_parser
from roadscope.benchmarks.papers.reproduction import (
    YES_OR_NO,
    Key,
    ReproductionRow,
    summarise,
)
from roadscope.benchmarks.papers.zhang2017 import APART, BODIES, FIRST_SEED, FOLLOWED_FRAMES, NOISES
from roadscope.benchmarks.papers.zhang2017_claims import BOTH, MOST, Table, limits_of
from roadscope.benchmarks.papers.zhang2017_drives import FOLLOWED_M
from roadscope.benchmarks.papers.zhang2017_errors import (
    errors,
    named_columns,
    nees,
    rmse,
    scored,
)
from roadscope.benchmarks.papers.zhang2017_methods import METHODS, MULTI, OURS, estimate
from roadscope.benchmarks.papers.zhang2017_names import (
    COUNTS,
    FRAMES,
    INSIDE,
    NEES,
    frames_name,
    unit_of,
)
from roadscope.benchmarks.papers.zhang2017_paper import SIMULATED
from roadscope.benchmarks.papers.zhang2017_scene import Run, film
from roadscope.benchmarks.papers.zhang2017_verdicts import inside_interval

DRAWS = 512
"""Samples of each round of the sampling. Chosen by hand."""
FLOOR, INFORMED_FLOOR = "floor, {}", "informed floor, {}"
KNOWLEDGE: Mapping[str, Knowledge] = {FLOOR: KNOWS_AS_MUCH_AS_OURS, INFORMED_FLOOR: KNOWS_ALL}
"""By the name of the row, with the number of frames to be filled in."""
RMSE_BESIDE = "{}, {} body: RMSE beside the floor"
EXACT_NEES = "NEES of the exact posterior, {} body"
EXACT_INSIDE = "3 within that of the exact posterior, {} body"
ASKED = "asked of ours beside the floor, {} body"
TWICE_FLOOR, TWICE_INFORMED_FLOOR = "twice floor", "twice informed floor"
BEATEN_OR_NEAR = "beats paper or near floor"
NOTES = {
    "straight, sharp body": "Floor: least RMSE of any estimator that knows as much as ours: the "
    "outline, but of the corners' radius and of the acceleration only how they are spread. "
    "Informed floor: that of an estimator that knows both.",
    "NEES of the exact": "NEES of the floor's posterior, for an estimator that knows as much as "
    "ours. Where it is not 3, no fit that knows no more can be asked for 3.",
    "asked of ours": "1: holds on the means over seeds, 0: does not. Twice floor: the RMSE of ours "
    "is below twice the floor with 1, 3 and 7 frames. Beats paper or near floor: ours of 7 frames "
    "is below the paper's multi frame in position and heading, or, where the floor is above that, "
    "below twice the floor.",
}


class ComparedRun(NamedTuple):
    """What ours and the floors make of one run: RMSE by method and column, NEES by method."""

    rmse: dict[str, dict[str, float]]
    nees: dict[str, float]


def compared_run(run: Run) -> ComparedRun:
    """Run ours and the paper's multi frame, and compute the floors of as many frames."""
    result = ComparedRun({}, {})
    for name in (MULTI, *OURS):
        poses, _ = estimate(METHODS[name], run)
        result.rmse[name], result.nees[name] = rmse(run, errors(run, poses)), nees(run, poses)
    for label, knowledge in KNOWLEDGE.items():
        by_frames = floors(run, tuple(OURS.values()), draws=DRAWS, knowledge=knowledge)
        for frames, least in by_frames.items():
            name = label.format(frames_name(frames))
            result.rmse[name] = floor_rmse(run, least, expected=knowledge.corners)
            result.nees[name] = floor_nees(run, least)
    return result


def floor_rmse(run: Run, least: InformationFloor, *, expected: bool = True) -> dict[str, float]:
    """Return the columns of tables 1 and 2 for a floor.

    expected: from the covariance of the posterior; otherwise from the error of its mean. Where the
    posterior covers other bodies than the run's, its covariance is a mean over all of them.
    """
    used = scored(run) & (least.shares > 0)
    squares = np.diagonal(least.covariances, axis1=1, axis2=2) if expected else least.errors**2
    return named_columns(squares[used].mean(axis=0) if used.any() else np.full(3, np.nan))


def floor_nees(run: Run, least: InformationFloor) -> float:
    """Return the mean NEES of a floor's posterior; NaN where no frame has any."""
    values = least.nees[scored(run)]
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else np.nan


def measure(seed: int) -> dict[Key, float]:
    """Measure every drive, body and noise with one seed."""
    values: dict[Key, float] = {}
    for body in BODIES:
        runs = [film(drive, seed, body=body) for drive in SIMULATED]
        runs += [
            film(f"following-{metres}", seed, body=body, frames=FOLLOWED_FRAMES)
            for metres in FOLLOWED_M
        ]
        for run in runs:
            compared = compared_run(run)
            values |= _rmse_values(run.drive.name, body, compared)
            values |= _nees_values(run, compared)
    for factor in NOISES:
        for drive in APART:
            compared = compared_run(film(drive, seed, noise=factor))
            values |= _rmse_values(f"{drive}, noise x{factor:g}", "sharp", compared)
    return values


def _rmse_values(place: str, body: str, compared: ComparedRun) -> dict[Key, float]:
    return {
        (RMSE_BESIDE.format(place, body), method, column): value
        for method, columns in compared.rmse.items()
        for column, value in columns.items()
    }


def _nees_values(run: Run, compared: ComparedRun) -> dict[Key, float]:
    drive, body = run.drive.name, run.body
    values: dict[Key, float] = {
        (COUNTS, drive, FRAMES): float(len(run.shots)),
        (COUNTS, drive, body): float((~scored(run)).sum()),
    }
    for method, frames in OURS.items():
        name = frames_name(frames)
        values[NEES.format(body), drive, name] = compared.nees[method]
        values[EXACT_NEES.format(body), drive, name] = compared.nees[FLOOR.format(name)]
    return values


def judged(measured: Mapping[Key, Sequence[float]]) -> list[ReproductionRow]:
    """Return rows of 1 (holds) and 0 for what is asked of ours, on the means over seeds."""
    held: dict[Key, float] = {}
    for body in BODIES:
        table = _table_of(measured, body)
        for drive in dict.fromkeys(drive for drive, _ in table):
            for claim, holds in asked_of_ours(table, drive).items():
                held[ASKED.format(body), drive, claim] = float(holds)
        for experiment, inside in ((NEES, INSIDE), (EXACT_NEES, EXACT_INSIDE)):
            for drive, windows in inside_interval(measured, body, experiment).items():
                for name, within in windows.items():
                    held[inside.format(body), drive, name] = float(within)
    return [summarise(key[:2], key[2], YES_OR_NO, [value], None) for key, value in held.items()]


def _table_of(measured: Mapping[Key, Sequence[float]], body: str) -> Table:
    """Return the mean RMSE of one body by drive and method."""
    drives = {
        RMSE_BESIDE.format(drive, body): drive
        for drive in (*SIMULATED, *(f"following-{metres}" for metres in FOLLOWED_M))
    }
    table: dict[tuple[str, str], dict[str, float]] = {}
    for (experiment, method, column), values in measured.items():
        if experiment in drives:
            table.setdefault((drives[experiment], method), {})[column] = float(np.mean(values))
    return table


def asked_of_ours(table: Table, drive: str) -> dict[str, bool]:
    """Return what is asked of ours on one drive, and whether it holds."""
    limits, least = limits_of(table, drive), table[drive, FLOOR.format(frames_name(OURS[MOST]))]
    return {
        TWICE_FLOOR: _within_twice(table, drive, FLOOR),
        TWICE_INFORMED_FLOOR: _within_twice(table, drive, INFORMED_FLOOR),
        BEATEN_OR_NEAR: all(
            table[drive, MOST][q] < (limits[q] if least[q] < limits[q] else 2 * least[q])
            for q in BOTH
        ),
    }


def _within_twice(table: Table, drive: str, label: str) -> bool:
    return all(
        table[drive, method][q] < 2 * table[drive, label.format(frames_name(frames))][q]
        for method, frames in OURS.items()
        for q in BOTH
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and print its tables."""
    options = study_parser("zhang2017_floor", __doc__, seeds=3).parse_args(arguments)
    measured = measured_over_seeds(measure, FIRST_SEED, options)
    rows = [
        summarise(key[:2], key[2], unit_of(key), values, None) for key, values in measured.items()
    ]
    show(rows + judged(measured), NOTES, options)


if __name__ == "__main__":
    main()
