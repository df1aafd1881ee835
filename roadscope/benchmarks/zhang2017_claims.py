"""What Zhang 2017 claims, and what is asked of ours, as yes or no in one seed.

Where the paper says that errors are close, half as much again is taken for close; its own two
figures for the curve differ by a third.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from roadscope.benchmarks.zhang2017_drives import FOLLOWED_M
from roadscope.benchmarks.zhang2017_errors import HEADING, LATERAL, LONGITUDINAL, POSITION
from roadscope.benchmarks.zhang2017_methods import MULTI, OURS, RANSAC, SINGLE
from roadscope.benchmarks.zhang2017_paper import PAPER, SIMULATED

CLOSE = 1.5
ALL = (LATERAL, LONGITUDINAL, HEADING, POSITION)
BOTH = (POSITION, HEADING)
Table = Mapping[tuple[str, str], Mapping[str, float]]
"""(drive, method) -> RMSE by column, of one body in one seed."""


def paper_claims(table: Table) -> dict[str, bool]:
    """Return the paper's claims on one body."""
    held = {}
    for drive in ("straight", "straight-past"):
        held[f"{drive}: multi below single in all four errors"] = _below(
            table, drive, (MULTI,), (SINGLE,)
        )
        held[f"{drive}: multi below RANSAC in all four errors"] = _below(
            table, drive, (MULTI,), (RANSAC,)
        )
    held["curve: single and multi close in position"] = _close(table, "curve", (SINGLE, MULTI))
    held["curve: single and multi below RANSAC in all four errors"] = _below(
        table, "curve", (SINGLE, MULTI), (RANSAC,)
    )
    held["curve worse than straight, all errors and methods"] = all(
        table["curve", m][q] > table["straight", m][q] for m in (SINGLE, MULTI, RANSAC) for q in ALL
    )
    return held | _following(table)


def _following(table: Table) -> dict[str, bool]:
    near = [f"following-{metres}" for metres in FOLLOWED_M if metres <= 20]
    far = [f"following-{metres}" for metres in FOLLOWED_M if metres >= 30]
    growing = [table[drive, RANSAC][POSITION] for drive in far]
    return {
        "following at 10 and 20 m: the three close in position": all(
            _close(table, drive, (SINGLE, MULTI, RANSAC)) for drive in near
        ),
        "following from 30 m: single and multi below RANSAC": all(
            _below(table, drive, (SINGLE, MULTI), (RANSAC,), BOTH) for drive in far
        ),
        "following from 30 m: multi below single": all(
            _below(table, drive, (MULTI,), (SINGLE,), BOTH) for drive in far
        ),
        "following from 30 m: RANSAC's position error grows": bool((np.diff(growing) > 0).all()),
    }


def our_claims(table: Table, turned: float) -> dict[str, float]:
    """Return what is asked of ours on one body; NaN where a seed has no floor.

    turned: greatest share of frames turned by 90 degrees, over drives and our methods.
    """
    held: dict[str, float] = {}
    most = max(OURS, key=lambda name: OURS[name])
    for drive, number in SIMULATED.items():
        printed = PAPER[number, MULTI]
        held[f"{drive}: 7 frames below the paper's multi frame"] = all(
            table[drive, most][q] < printed[q] for q in BOTH
        )
    drives = list(dict.fromkeys(drive for drive, _ in table))
    for drive in drives:
        held[f"{drive}: more frames are better"] = _falling(table, drive)
    for drive in drives:
        held[f"{drive}: within twice the floor"] = _near_floor(table, drive)
    return held | {"no frame turned by 90 degrees on any drive": float(turned == 0)}


def _falling(table: Table, drive: str) -> bool:
    """Whether each step to more frames lowers position and heading errors."""
    return all(
        table[drive, more][q] < table[drive, fewer][q]
        for fewer, more in zip(list(OURS), list(OURS)[1:], strict=False)
        for q in BOTH
    )


def _near_floor(table: Table, drive: str) -> float:
    pairs = [
        (table[drive, method], table[drive, floor_name(frames)])
        for method, frames in OURS.items()
        if (drive, floor_name(frames)) in table
    ]
    if not pairs:
        return np.nan
    return float(all(ours[q] < 2 * least[q] for ours, least in pairs for q in BOTH))


def floor_name(frames: int) -> str:
    """Return the row of the information floor given so many frames."""
    return f"floor, {frames} frame{'s' if frames > 1 else ''}"


def _below(
    table: Table,
    drive: str,
    lower: Sequence[str],
    upper: Sequence[str],
    columns: Sequence[str] = ALL,
) -> bool:
    return all(
        table[drive, a][q] < table[drive, b][q] for a in lower for b in upper for q in columns
    )


def _close(table: Table, drive: str, methods: Sequence[str]) -> bool:
    values = [table[drive, method][POSITION] for method in methods]
    return max(values) < CLOSE * min(values)
