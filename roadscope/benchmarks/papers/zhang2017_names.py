"""Names, units, printed figures and notes of the experiments."""

from __future__ import annotations

from roadscope.benchmarks.papers.reproduction import Key
from roadscope.benchmarks.papers.zhang2017_errors import BESIDE_UNITS, HEADING, UNITS
from roadscope.benchmarks.papers.zhang2017_methods import SINGLE
from roadscope.benchmarks.papers.zhang2017_paper import NOTES, PAPER, PAPER_TIMES
from roadscope.benchmarks.papers.zhang2017_readings import NOTE as READINGS_NOTE

RMSE = "{}, {} body ({})"
"""Drive, body, table."""
BESIDE = "{}, {} body: beside RMSE"
FOLLOWING = "following, {} body: {} RMSE"
NOISE = "half and double noise, sharp body: {} RMSE"
HIGH = "{}, sharp body, sensor at 1.9 m ({})"
READING = "readings of the paper: {} RMSE"
NEES = "NEES, {} body"
INSIDE = "3 within the NEES's 95 % interval, {} body"
TURNED_FRAMES = "frames turned by 90 deg, percent of those scored"
COUNTS = "frames, and those not scored for having fewer than 3 returns"
TIMES, RATIOS = "table 3, time a frame while following", "table 3, ratios"
RATIO = "mean over single frame's"
MEAN, SLOWEST, FRAMES = "mean", "slowest drive", "frames"
OF_PAPER, OF_OURS = "claims of the paper, {} body", "asked of ours, {} body"
OF_ALL, SHARE_OF_SEEDS = "asked on all drives", ": share of seeds"


def frames_name(frames: int) -> str:
    """Return how so many frames are called."""
    return f"{frames} frame{'s' if frames > 1 else ''}"


def note_of(experiment: str) -> str | None:
    """Return what must be known to read an experiment's table."""
    if experiment == READING.format(HEADING):
        return READINGS_NOTE
    if experiment.endswith(SHARE_OF_SEEDS):
        return None
    return next((note for part, note in NOTES.items() if part in experiment), None)


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
    return None


def unit_of(key: Key) -> str:
    """Return the unit in which a quantity is given."""
    experiment, _, quantity = key
    if experiment == COUNTS:
        return "count"
    if experiment == TURNED_FRAMES:
        return "%"
    if experiment == TIMES:
        return "ms"
    if experiment.endswith(" RMSE") and ": " in experiment and "beside" not in experiment:
        return "deg" if f": {HEADING} " in experiment else "m"
    return {**UNITS, **BESIDE_UNITS}.get(quantity, "1")
