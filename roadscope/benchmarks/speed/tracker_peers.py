"""How long trackers of others take for an update, each beside the one of ours that does the same.

In processor time, as in `speed.trackers`. The two take turns on every frame, since shared machines
change meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from time import process_time

import numpy as np

from roadscope.benchmarks.speed.rows import SpeedRow
from roadscope.benchmarks.speed.trackers import COUNTS, LEAD, Seen, seen_traffic
from roadscope.trackers import TRACKERS

BESIDE: Mapping[str, str] = {
    "norfair": "greedy",
    "stonesoup-gnn": "gnn",
    "stonesoup-jpda": "jpda",
    "roboflow-sort": "gnn",
    "roboflow-bytetrack": "bytetrack",
    "roboflow-oc-sort": "oc-sort",
}
"""Trackers of others, and which of ours associates as they do."""
FRAMES = 30
MOST_S = 60.0
"""More targets are left out where all updates would take longer, their time growing with the
square of the number."""


def measure_peers(
    names: Sequence[str] = tuple(BESIDE), counts: Sequence[int] = COUNTS, frames: int = FRAMES
) -> list[SpeedRow]:
    """Measure whole updates of each: median, and how many times that of ours.

    Who is not installed, or would take too long, has a row without a figure that says why.
    """
    rows = []
    for name in names:
        if missing := TRACKERS.missing(name):
            rows.append(SpeedRow(f"tracker {name}", None, missing))
            continue
        rows += _of_one(name, sorted(counts), frames)
    return rows


def _of_one(name: str, counts: Sequence[int], frames: int) -> list[SpeedRow]:
    """Measure one with ever more targets, as long as it does not take too long."""
    rows: list[SpeedRow] = []
    last_ms, last = 0.0, counts[0]
    for count in counts:
        what, foretold_ms = f"tracker {name}, {count} targets", last_ms * (count / last) ** 2
        if frames * foretold_ms > MOST_S * 1e3:
            told = f"left out: an update would take about {foretold_ms / 1e3:.2g} s"
            rows.append(SpeedRow(what, None, told))
            continue
        theirs, ours = timed_in_turns((name, BESIDE[name]), list(seen_traffic(count, frames)))
        rows.append(SpeedRow(what, theirs, "ms", theirs / ours, BESIDE[name]))
        last_ms, last = theirs, count
    return rows


def timed_in_turns(names: Sequence[str], episode: Sequence[Seen]) -> list[float]:
    """Return the median ms of an update of each tracker, from the `LEAD`-th frame on."""
    if len(episode) <= LEAD:
        raise ValueError(f"an episode of more than {LEAD} frames is needed, got {len(episode)}")
    trackers = [TRACKERS.make(name) for name in names]
    times_ms: list[list[float]] = [[] for _ in trackers]
    for tracker in trackers:
        tracker.reset()
    for number, (detections, pose) in enumerate(episode):
        for tracker, own_ms in zip(trackers, times_ms, strict=True):
            start = process_time()
            tracker.update(detections, pose)
            if number >= LEAD:
                own_ms.append((process_time() - start) * 1e3)
    return [float(np.median(own_ms)) for own_ms in times_ms]
