"""Names, units, printed figures, claims and notes of Zhang 2022's experiments."""

from __future__ import annotations

from roadscope.benchmarks.papers.reproduction import Key
from roadscope.benchmarks.papers.zhang2022_plays import CASES
from roadscope.benchmarks.papers.zhang2022_removal import AFTER, BEFORE, MS, PRECISION, RECALL

REMOVAL = "dynamic points, case {}"
WALKED = ("standing", "straight", "loop")
ROUTE, READING, CLAIMS = "long route", "readings, {}", "claims: {} below lego-loam"
FURTHER = "{}, further figures"
STD, MAX, MIN, MEAN, END = "std", "max", "min", "mean", "end error"
SCANS, OURS, PEER = "zhang2022", "zhang2022-map", "lego-loam"
"""The paper's chain from scan to scan, the same before LeGO-LOAM's map, and its rival."""
READINGS = {
    f"{OURS}?roughness='cluster'": "eq. 6 as printed",
    f"{OURS}?windows=False": "angle bounds links",
    f"{OURS}?view=1.0": "own way allowed for",
    f"{OURS}?same_cluster=False": "any cluster's features",
    f"{OURS}?drop_dynamic=False": "nothing dropped",
}
"""Specs of other readings and of parts left out, by what they are called."""


def named(quantity: str, experiment: str) -> str:
    """Return a quantity's name in an experiment; large errors carry their unit there."""
    return f"{quantity}, m" if experiment == ROUTE and quantity != MS else quantity


_REMOVED = ((20883, 20053, 10.7), (20775, 19192, 10.5), (21052, 19738, 11.6), (22214, 21594, 11.9))
_LOCALISED = {
    (WALKED[0], OURS): {STD: 0.0077, MAX: 0.0489, MEAN: 0.0059, MIN: 0.0004, MS: 17.9},
    (WALKED[0], PEER): {STD: 0.0182, MAX: 0.0962, MEAN: 0.0097, MIN: 0.0007, MS: 25.7},
    (WALKED[1], OURS): {END: 0.4237},
    (WALKED[1], PEER): {END: 0.5494},
    (WALKED[2], OURS): {END: 0.1040},
    (WALKED[2], PEER): {END: 0.1736},
    (ROUTE, OURS): {STD: 4.4878, MAX: 18.0254, MEAN: 8.0059, MIN: 0.1537, MS: 18.7},
    (ROUTE, PEER): {STD: 5.3717, MAX: 26.4013, MEAN: 12.2687, MIN: 0.1964, MS: 25.6},
}
"""Tables 3 and 4, and the end errors of section 3.2."""
PAPER: dict[Key, float] = {
    (REMOVAL.format(case), "zhang2022, 1 s apart", quantity): figure
    for case, row in zip(CASES, _REMOVED, strict=True)
    for quantity, figure in zip((BEFORE, AFTER, MS), row, strict=True)
} | {
    (*place, named(quantity, place[0])): v
    for place, row in _LOCALISED.items()
    for quantity, v in row.items()
}
CLAIMED = tuple(
    (experiment, named(quantity, experiment))
    for (experiment, method), row in _LOCALISED.items()
    if method == OURS
    for quantity in row
)
UNITS = {BEFORE: "count", AFTER: "count", PRECISION: "%", RECALL: "%", MS: ""}


def paper_figure(key: Key) -> float | None:
    """Return what the paper prints for a quantity, None where it prints nothing.

    It does not say whether its chain had a map: its figures stand beside both.
    """
    experiment, method, quantity = key
    return PAPER.get((experiment, OURS if method == SCANS else method, quantity))


def unit_of(key: Key) -> str:
    """Return the unit in which a quantity is given; milliseconds are named by the quantity."""
    return "" if ROUTE in key[0] else UNITS.get(key[2], "m")


def note_of(experiment: str) -> str | None:
    """Return what must be known to read the tables of an experiment."""
    if experiment.startswith("claims"):
        return "'holds': in the mean over seeds. The paper compares with LeGO-LOAM."
    if ROUTE in experiment:
        return (
            "The paper drives KITTI with an HDL-64E; here the same LiDAR goes a lap and a half of "
            "a racetrack in traffic, half a kilometre, so that its figures are of another length. "
            "Of the first 5 seeds at most."
        )
    if experiment in WALKED:
        return (
            "The paper's odometry goes from scan to scan (zhang2022) and it speaks of SLAM, and of "
            "LeGO-LOAM's loops, where it measures; zhang2022-map is the same chain before "
            "LeGO-LOAM's map. lidar-inertial is told of what make the IMU is (imu=zed2)."
        )
    if experiment.endswith("noise"):
        return "Range noise of the LiDAR and all errors of the IMU, of the first 5 seeds at most."
    if experiment.startswith("dynamic"):
        return (
            "The search angle of 5 deg bounds clusters, as the walls in the paper's figures "
            "suggest; one can also read that it bounds steps from return to return alone. A "
            "cluster is dynamic whose centre moved 0.05 m + 0.5 m/s, in links the own way more, "
            "and 1 % of its range: the paper prints no threshold. What it says of points is of "
            "one pair of scans."
        )
    return None
