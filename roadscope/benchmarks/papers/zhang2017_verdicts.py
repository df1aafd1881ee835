"""Which claims hold on the figures of all seeds, and in what share of single seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from roadscope.benchmarks.papers.reproduction import (
    YES_OR_NO,
    Key,
    ReproductionRow,
    summarise,
)
from roadscope.benchmarks.papers.zhang2017_claims import (
    BOTH,
    CONSISTENT,
    OF_EACH_DRIVE,
    UNTURNED,
    Table,
    consistent,
    our_claims,
    paper_claims,
    times_claims,
)
from roadscope.benchmarks.papers.zhang2017_drives import FOLLOWED_M
from roadscope.benchmarks.papers.zhang2017_methods import MULTI, OURS, RANSAC, SINGLE
from roadscope.benchmarks.papers.zhang2017_names import (
    COUNTS,
    FOLLOWING,
    FRAMES,
    INSIDE,
    MEAN,
    NEES,
    OF_ALL,
    OF_OURS,
    OF_PAPER,
    RMSE,
    SHARE_OF_SEEDS,
    SLOWEST,
    TIMES,
    TURNED_FRAMES,
    frames_name,
)
from roadscope.benchmarks.papers.zhang2017_paper import SIMULATED

HOLDS, SEEDS = "holds", "in single seeds"
Figures = Mapping[Key, float]


def verdicts(
    measured: Mapping[Key, Sequence[float]], bodies: Sequence[str]
) -> list[ReproductionRow]:
    """Return rows of 1 (holds) and 0 on the means over seeds, and shares of seeds that hold alone.

    measured: a value a seed, in the order of seeds.
    """
    seeds = max(map(len, measured.values()))
    whole = _judged(measured, bodies)
    shares: dict[Key, list[float]] = {}
    for i in range(seeds):
        single = {key: values[i : i + 1] for key, values in measured.items()}
        for key, held in _judged(single, bodies).items():
            if key[2] == HOLDS:
                shares.setdefault((*key[:2], SEEDS), []).append(held)
            elif key[2] in OF_EACH_DRIVE:
                shares.setdefault((key[0] + SHARE_OF_SEEDS, *key[1:]), []).append(held)
    rows = [summarise(key[:2], key[2], YES_OR_NO, [held], None) for key, held in whole.items()]
    rows += [summarise(key[:2], key[2], "share", held, None) for key, held in shares.items()]
    order = list(dict.fromkeys(experiment for experiment, _, _ in whole))
    return sorted(rows, key=lambda row: order.index(row.experiment.removesuffix(SHARE_OF_SEEDS)))


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def _judged(measured: Mapping[Key, Sequence[float]], bodies: Sequence[str]) -> dict[Key, float]:
    """Judge all claims on some seeds."""
    held: dict[Key, float] = {}
    figures = {key: _mean(values) for key, values in measured.items()}
    for body in bodies:
        table = table_of(figures, body)
        for claim, agreed in paper_claims(table).items():
            held[OF_PAPER.format(body), claim, HOLDS] = float(agreed)
        inside = inside_interval(measured, body, NEES)
        for drive, claims in our_claims(table).items():
            for claim, holds in claims.items():
                held[OF_OURS.format(body), drive, claim] = holds
            held[OF_OURS.format(body), drive, CONSISTENT] = float(all(inside[drive].values()))
        for drive, windows in inside.items():
            for name, within in windows.items():
                held[INSIDE.format(body), drive, name] = float(within)
    return held | _everywhere(figures)


def _everywhere(figures: Figures) -> dict[Key, float]:
    def timed(quantity: str) -> dict[str, float]:
        return {m: v for (e, m, q), v in figures.items() if e == TIMES and q == quantity}

    turned: dict[str, list[float]] = {}
    for (experiment, method, _), value in figures.items():
        if experiment == TURNED_FRAMES and method not in (SINGLE, MULTI, RANSAC):
            turned.setdefault(method, []).append(value)
    claims = {UNTURNED.format(method): not any(values) for method, values in turned.items()}
    claims |= times_claims(timed(MEAN), timed(SLOWEST))
    return {(OF_ALL, claim, HOLDS): float(holds) for claim, holds in claims.items()}


def inside_interval(
    measured: Mapping[Key, Sequence[float]], body: str, experiment: str
) -> dict[str, dict[str, bool]]:
    """Return by drive and window whether the NEES of an experiment is consistent with 3."""
    found: dict[str, dict[str, bool]] = {}
    for drive in (*SIMULATED, *(f"following-{metres}" for metres in FOLLOWED_M)):
        scored = _mean(measured[COUNTS, drive, FRAMES]) - _mean(measured[COUNTS, drive, body])
        found[drive] = {
            name: consistent(measured[experiment.format(body), drive, name], scored, frames)
            for frames in OURS.values()
            for name in (frames_name(frames),)
        }
    return found


def table_of(figures: Figures, body: str) -> Table:
    """Return the RMSE of one body by drive and method."""
    table: dict[tuple[str, str], dict[str, float]] = {}
    drives = {RMSE.format(drive, body, number): drive for drive, number in SIMULATED.items()}
    followed = {FOLLOWING.format(body, quantity): quantity for quantity in BOTH}
    for (experiment, method, quantity), value in figures.items():
        if experiment in drives:
            table.setdefault((drives[experiment], method), {})[quantity] = value
        elif experiment in followed:
            drive = f"following-{quantity.removesuffix(' m')}"
            table.setdefault((drive, method), {})[followed[experiment]] = value
    return table
