"""How fast ours is beside other projects, where these are installed.

    python -m research.speed_peers [casting] [clustering] [metrics] [trackers]

`casting`: rays beside Open3D. `clustering`: DBSCAN beside scikit-learn's. `metrics`: tracking
metrics beside TrackEval's and Stone Soup's. `trackers`: those of norfair, Stone Soup and Roboflow,
each beside the one of ours that associates as it does. All parts by default. What is not installed
is left out, or has a row that says so.

Everything that is compared takes turns in one run, since shared machines change meanwhile. Casting
is in wall time of one thread, all else in processor time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from research.speed_casting import casting_steps
from research.speed_metrics import metrics_steps
from research.speed_stages import STAGE_FRAMES, STAGE_SCENE, points_above_ground
from research.studies import run_speed_study
from roadscope import TRACKERS
from roadscope.benchmarks.speed.detectors import driven_frames
from roadscope.benchmarks.speed.rows import SpeedRow, SpeedStep, interleaved
from roadscope.benchmarks.speed.trackers import COUNTS, LEAD_UPDATES, TrackerFrame, detected_traffic
from roadscope.detectors.clustering.density import density_labels

BESIDE: Mapping[str, str] = {
    "norfair": "greedy",
    "stonesoup-gnn": "gnn",
    "stonesoup-jpda": "jpda",
    "roboflow-sort": "gnn",
    "roboflow-bytetrack": "bytetrack",
    "roboflow-oc-sort": "oc-sort",
}
"""Trackers of others, and the one of ours that associates as they do."""
FRAMES = 30
MOST_S = 60.0
"""More targets are left out where all updates would take longer; their time is taken to grow with
the square of the number."""
CLUSTERED_RIG, CLUSTERED_POINTS = "hdl64e", 20_000
EPS_M, MIN_POINTS = 0.5, 10
"""Options of DBSCAN."""


def clustering_steps(repeats: int = 3) -> list[SpeedStep]:
    """Return the one step."""
    return [SpeedStep("DBSCAN", partial(measure_dbscan, repeats))]


def measure_dbscan(
    repeats: int, points: int = CLUSTERED_POINTS, rig: str = CLUSTERED_RIG
) -> list[SpeedRow]:
    """Run our DBSCAN and scikit-learn's by turns on the same returns above the ground."""
    frame = driven_frames(rig, STAGE_FRAMES, STAGE_SCENE)[-1]
    places = points_above_ground(frame).points[:points, :2].copy()
    name = f"{len(places)} points"
    ours = partial(density_labels, places, EPS_M, MIN_POINTS)
    DBSCAN = import_scikit_learn()
    if DBSCAN is None:
        seconds = interleaved({"ours": ours}, repeats, process_time)["ours"]
        missing = SpeedRow("scikit-learn", None, "is not installed: pip install scikit-learn")
        return [SpeedRow(f"DBSCAN, {name}", seconds * 1e3, "ms"), missing]
    theirs = partial(DBSCAN(eps=EPS_M, min_samples=MIN_POINTS).fit_predict, places)
    times = interleaved({"ours": ours, "theirs": theirs}, repeats, process_time)
    mismatched = float((ours() != theirs()).sum())
    return [
        SpeedRow(f"DBSCAN, {name}", times["ours"] * 1e3, "ms"),
        SpeedRow(f"scikit-learn's DBSCAN, {name}", times["theirs"] * 1e3, "ms"),
        SpeedRow(f"DBSCAN over scikit-learn's, {name}", times["theirs"] / times["ours"], "times"),
        SpeedRow(f"labels other than scikit-learn's, {name}", mismatched, f"of {len(places)}"),
    ]


def import_scikit_learn() -> Any:
    """Return the class DBSCAN, or None where scikit-learn cannot be imported."""
    try:
        from sklearn.cluster import DBSCAN
    except ImportError:
        return None
    return DBSCAN


def tracker_steps() -> list[SpeedStep]:
    """Return the one step."""
    return [SpeedStep("trackers of others", measure_trackers_of_others)]


def measure_trackers_of_others(
    names: Sequence[str] = tuple(BESIDE), counts: Sequence[int] = COUNTS, frames: int = FRAMES
) -> list[SpeedRow]:
    """Measure whole updates of each: median, and how many times as fast ours is.

    A tracker that is not installed, or would take too long, has a row that says why.
    """
    rows = []
    for name in names:
        if missing := TRACKERS.missing(name):
            rows.append(SpeedRow(f"tracker {name}", None, missing))
            continue
        rows += _rows_of(name, sorted(counts), frames)
    return rows


def _rows_of(name: str, counts: Sequence[int], frames: int) -> list[SpeedRow]:
    """Measure one tracker with more and more targets, as long as it does not take too long."""
    rows: list[SpeedRow] = []
    last_ms, last = 0.0, counts[0]
    for count in counts:
        what, expected_ms = f"tracker {name}, {count} targets", last_ms * (count / last) ** 2
        if frames * expected_ms > MOST_S * 1e3:
            reason = f"left out: an update would take about {expected_ms / 1e3:.2g} s"
            rows.append(SpeedRow(what, None, reason))
            continue
        ours = BESIDE[name]
        times = medians_in_turns(name, ours, list(detected_traffic(count, frames)))
        ratio = times.theirs_ms / times.ours_ms
        rows.append(SpeedRow(what, times.theirs_ms, "ms"))
        rows.append(SpeedRow(f"{ours} over {name}, {count} targets", ratio, "times"))
        last_ms, last = times.theirs_ms, count
    return rows


class UpdateTimes(NamedTuple):
    """Median milliseconds of an update, theirs and ours."""

    theirs_ms: float
    ours_ms: float


def medians_in_turns(theirs: str, ours: str, episode: Sequence[TrackerFrame]) -> UpdateTimes:
    """Return the median time of an update of two trackers, from the `LEAD_UPDATES`-th frame on."""
    if len(episode) <= LEAD_UPDATES:
        raise ValueError(
            f"an episode of more than {LEAD_UPDATES} frames is needed, got {len(episode)}"
        )
    trackers = [TRACKERS.make(name) for name in (theirs, ours)]
    times_ms: list[list[float]] = [[] for _ in trackers]
    for tracker in trackers:
        tracker.reset()
    for number, (detections, pose) in enumerate(episode):
        for tracker, own_ms in zip(trackers, times_ms, strict=True):
            start = process_time()
            tracker.update(detections, pose)
            if number >= LEAD_UPDATES:
                own_ms.append((process_time() - start) * 1e3)
    return UpdateTimes(*(float(np.median(own_ms)) for own_ms in times_ms))


PARTS: Mapping[str, Callable[[], list[SpeedStep]]] = {
    "casting": casting_steps,
    "clustering": clustering_steps,
    "metrics": metrics_steps,
    "trackers": tracker_steps,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    run_speed_study("speed_peers", __doc__, PARTS, arguments)


if __name__ == "__main__":
    main()
