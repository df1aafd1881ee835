"""What Zhang 2017 claims, and what is asked of ours, as yes or no.

Where the paper says that errors are close, half as much again is taken for close; its own two
figures for the curve differ by a third.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from roadscope.benchmarks.papers.reproduction import summarise
from roadscope.benchmarks.papers.zhang2017_drives import FOLLOWED_M
from roadscope.benchmarks.papers.zhang2017_errors import HEADING, LATERAL, LONGITUDINAL, POSITION
from roadscope.benchmarks.papers.zhang2017_methods import MULTI, OURS, RANSAC, SINGLE
from roadscope.benchmarks.papers.zhang2017_names import floor_name
from roadscope.benchmarks.papers.zhang2017_paper import PAPER, SIMULATED

CLOSE = 1.5
ALL = (LATERAL, LONGITUDINAL, HEADING, POSITION)
BOTH = (POSITION, HEADING)
BEATEN, FALLING, CONSISTENT = "beats paper", "more is better", "NEES"
NEAR, NEAR_TOLD = "twice floor", "twice told floor"
OF_EACH_DRIVE = (BEATEN, NEAR, NEAR_TOLD, FALLING, CONSISTENT)
"""What is asked of ours on each drive."""
LIMITS_MS = {SINGLE: 5.0, MULTI: 15.0, **dict.fromkeys(OURS, 40.0)}
"""Of processor time a frame. 40 ms is a third of what the paper's own multi frame takes, and leaves
room at 10 Hz; those of the paper's methods are twice what was measured."""
UNTURNED = "{}: none turned by 90 deg"
SURE, FREEDOM = 0.95, 3
MOST = max(OURS, key=lambda name: OURS[name])
Table = Mapping[tuple[str, str], Mapping[str, float]]
"""(drive, method) -> RMSE by column, of one body."""


def paper_claims(table: Table) -> dict[str, bool]:
    """Return the paper's claims on one body. Better is lower in every error it prints."""
    held = {}
    for drive in ("straight", "straight-past"):
        held[f"{drive}: multi better than single"] = _below(table, drive, (MULTI,), (SINGLE,))
        held[f"{drive}: multi better than RANSAC"] = _below(table, drive, (MULTI,), (RANSAC,))
    held["curve: single and multi close in position"] = _close(table, "curve", (SINGLE, MULTI))
    held["curve: both better than RANSAC"] = _below(table, "curve", (SINGLE, MULTI), (RANSAC,))
    held["curve worse than straight, all methods"] = all(
        table["curve", m][q] > table["straight", m][q] for m in (SINGLE, MULTI, RANSAC) for q in ALL
    )
    return held | _following(table)


def _following(table: Table) -> dict[str, bool]:
    near = [f"following-{metres}" for metres in FOLLOWED_M if metres <= 20]
    far = [f"following-{metres}" for metres in FOLLOWED_M if metres >= 30]
    growing = [table[drive, RANSAC][POSITION] for drive in far]
    return {
        "10 and 20 m: all three close in position": all(
            _close(table, drive, (SINGLE, MULTI, RANSAC)) for drive in near
        ),
        "from 30 m: both better than RANSAC": all(
            _below(table, drive, (SINGLE, MULTI), (RANSAC,), BOTH) for drive in far
        ),
        "from 30 m: multi better than single": all(
            _below(table, drive, (MULTI,), (SINGLE,), BOTH) for drive in far
        ),
        "from 30 m: RANSAC's position error grows": bool((np.diff(growing) > 0).all()),
    }


def our_claims(table: Table, least: Table) -> dict[str, dict[str, float]]:
    """Return by drive what is asked of ours on one body; NaN where it has no floor.

    least: has the floor that says where the paper's figures can be beaten at all.
    """
    return {
        drive: {
            BEATEN: float(_beaten(table, least, drive)),
            NEAR: _near_floor(table, drive, told=False),
            NEAR_TOLD: _near_floor(table, drive, told=True),
            FALLING: float(_falling(table, drive)),
        }
        for drive in dict.fromkeys(drive for drive, _ in table)
    }


def _beaten(table: Table, least: Table, drive: str) -> bool:
    """Whether our errors are below the paper's multi frame's, or within twice a floor above it.

    Of the following experiment the paper prints no figures: there its method has our seeds.
    """
    limits = PAPER[SIMULATED[drive], MULTI] if drive in SIMULATED else table[drive, MULTI]
    floors = least.get((drive, floor_name(OURS[MOST])), dict.fromkeys(BOTH, 0.0))
    return all(
        table[drive, MOST][q] < (limits[q] if floors[q] < limits[q] else 2 * floors[q])
        for q in BOTH
    )


def _falling(table: Table, drive: str) -> bool:
    """Whether each step to more frames lowers position and heading errors."""
    return all(
        table[drive, more][q] < table[drive, fewer][q]
        for fewer, more in zip(list(OURS), list(OURS)[1:], strict=False)
        for q in BOTH
    )


def _near_floor(table: Table, drive: str, *, told: bool) -> float:
    floors = {method: floor_name(frames, told=told) for method, frames in OURS.items()}
    pairs = [
        (table[drive, method], table[drive, name])
        for method, name in floors.items()
        if (drive, name) in table
    ]
    if not pairs:
        return np.nan
    return float(all(ours[q] < 2 * least[q] for ours, least in pairs for q in BOTH))


def consistent(values: Sequence[float], scored: float, frames: int) -> bool:
    """Whether the mean NEES of x, y and yaw, one value a seed, may well be the 3 that is expected.

    Of several seeds: whether 3 is within the 95 % interval of their mean (Student's t). Frames of
    one seed share scans and the view of the car, and errors at the edge of a silhouette are not
    normal; only seeds are independent. A single seed has its frames alone: see `band`.
    """
    row = summarise((CONSISTENT, ""), "", "1", values, None)
    if row.ours is None:
        return False
    if row.low is None or row.high is None:
        low, high = band(scored, frames)
        return low <= row.ours <= high
    return row.low <= FREEDOM <= row.high


def band(scored: float, frames: int) -> tuple[float, float]:
    """Return the 95 % band of the mean NEES of x, y and yaw over so many frames of one seed.

    frames: joined in each answer; only those that share none are counted as independent.
    """
    from scipy.special import chdtri

    freedom = FREEDOM * max(int(scored / frames), 1)
    tails = np.array([0.5 + SURE / 2, 0.5 - SURE / 2])
    low, high = chdtri(freedom, tails) * FREEDOM / freedom
    return float(low), float(high)


def times_claims(means_ms: Mapping[str, float], slowest_ms: Mapping[str, float]) -> dict[str, bool]:
    """Return whether the mean time of a frame is within its limit, following and on any drive."""
    held = {}
    for method, limit in LIMITS_MS.items():
        held[f"{method}: {limit:.0f} ms following"] = means_ms[method] <= limit
        held[f"{method}: {limit:.0f} ms on any drive"] = slowest_ms[method] <= limit
    return held


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
