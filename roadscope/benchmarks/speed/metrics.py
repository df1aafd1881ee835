"""How fast tracking metrics are, beside TrackEval and Stone Soup where these are installed.

All of it in processor time: what one core needs for it, whatever else runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from roadscope.benchmarks.metrics.matching import centre_distances
from roadscope.benchmarks.metrics.tracking.amota import amota
from roadscope.benchmarks.metrics.tracking.clear import clear
from roadscope.benchmarks.metrics.tracking.hota import hota
from roadscope.benchmarks.metrics.tracking.identity import identity
from roadscope.benchmarks.metrics.tracking.ospa import gospa, ospa
from roadscope.benchmarks.metrics.tracking.sequence import (
    TrackedSequence,
    similarity_by_distance,
)
from roadscope.benchmarks.speed.rows import SpeedRow, interleaved

FRAMES, OBJECTS = 1000, 30
SET_FRAMES = 200
"""Frames for OSPA and GOSPA: Stone Soup takes many milliseconds for each."""
SEED = 5
AREA_M, STEP_M, ERROR_M = 100.0, 0.5, 0.4
SEEN, FALSE_TRACKS, SWAPPED = 0.9, 2, 0.02
CUTOFF_M = 2.0
GOALS: Mapping[str, float] = {
    "HOTA, CLEAR and identity over TrackEval's": 5.0,
    "GOSPA over Stone Soup's": 100.0,
}
"""How many times as fast as theirs ours are at least."""


@dataclass(frozen=True, slots=True)
class Made:
    """Objects that wander and tracks that err, miss, swap and find what is not there.

    All of T frames: ids, (n, 2) positions in metres, and how sure tracks are, each always alike.
    """

    truth_ids: list[np.ndarray]
    truths: list[np.ndarray]
    track_ids: list[np.ndarray]
    tracks: list[np.ndarray]
    scores: list[np.ndarray]

    def distances(self) -> list[np.ndarray]:
        """Return (objects, tracks) metres of each frame."""
        return [centre_distances(g, t) for g, t in zip(self.truths, self.tracks, strict=True)]

    def similarities(self) -> list[np.ndarray]:
        """Return (objects, tracks) of each frame, 0.5 at 2 m."""
        return [similarity_by_distance(apart) for apart in self.distances()]


def made_sequence(frames: int = FRAMES, objects: int = OBJECTS) -> Made:
    """Return the same sequence each time."""
    rng = np.random.default_rng(SEED)
    made = Made([], [], [], [], [])
    sure = np.random.default_rng(SEED + 1).random(objects + FALSE_TRACKS)
    places, names = rng.uniform(0, AREA_M, (objects, 2)), np.arange(objects)
    for _ in range(frames):
        places = places + rng.normal(0, STEP_M, places.shape)
        if rng.random() < SWAPPED:
            names = rng.permutation(names)
        seen = rng.random(objects) < SEEN
        found = places[seen] + rng.normal(0, ERROR_M, (int(seen.sum()), 2))
        false = rng.uniform(0, AREA_M, (FALSE_TRACKS, 2))
        made.truth_ids.append(np.arange(objects))
        made.truths.append(places)
        made.track_ids.append(np.concatenate([names[seen], objects + np.arange(FALSE_TRACKS)]))
        made.tracks.append(np.concatenate([found, false]))
        made.scores.append(sure[made.track_ids[-1]])
    return made


def measure_metrics(
    repeats: int, frames: int = FRAMES, objects: int = OBJECTS, set_frames: int = SET_FRAMES
) -> list[SpeedRow]:
    """Measure all tracking metrics; the libraries do the same work in turns with ours.

    Where TrackEval or Stone Soup is missing so are its rows.
    """
    return [
        *_sequence_metrics(made_sequence(frames, objects), repeats),
        *_set_metrics(made_sequence(set_frames, objects), -(-repeats // 3)),
    ]


def _sequence_metrics(made: Made, repeats: int) -> list[SpeedRow]:
    """Measure HOTA, CLEAR and identity together, from similarities on; and each alone."""
    frames = made.truth_ids, made.track_ids, made.similarities()
    sequence = TrackedSequence.of(*frames, scores=made.scores)
    calls: dict[str, Callable[[], Any]] = {
        "record of a sequence": partial(TrackedSequence.of, *frames),
        "HOTA": partial(hota, sequence),
        "CLEAR": partial(clear, sequence),
        "identity": partial(identity, sequence),
        "AMOTA": partial(amota, sequence),
        "HOTA, CLEAR and identity": lambda: [f(sequence) for f in (hota, clear, identity)],
        "the same with the record": lambda: _three(frames),
    }
    metrics = import_trackeval()
    if metrics is not None:
        calls["TrackEval's HOTA, CLEAR and identity"] = _trackeval(metrics, sequence)
    times = interleaved(calls, repeats, process_time)
    of = f"{len(sequence)} frames, {sequence.distinct_objects} objects"
    rows = [SpeedRow(f"{name}, {of}", seconds * 1e3, "ms") for name, seconds in times.items()]
    if metrics is not None:
        theirs = times["TrackEval's HOTA, CLEAR and identity"]
        for name in ("HOTA, CLEAR and identity", "the same with the record"):
            rows += compared(f"{name} over TrackEval's", theirs / times[name])
        rows.append(_difference(metrics, sequence))
    return rows


def compared(name: str, ratio: float) -> list[SpeedRow]:
    """Return the row of a ratio with its goal, and who is too slow for it."""
    goal = GOALS.get(name)
    row = SpeedRow(name, ratio, "times" if goal is None else f"times of {goal:g}")
    late = goal is not None and ratio < goal
    return [row, SpeedRow(f"too slow: {name}", ratio, row.unit)] if late else [row]


def _three(frames: tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]) -> list[Any]:
    sequence = TrackedSequence.of(*frames)
    return [f(sequence) for f in (hota, clear, identity)]


def as_trackeval(sequence: TrackedSequence) -> dict[str, Any]:
    """Return a sequence as TrackEval's metrics take it."""
    return {
        "num_timesteps": len(sequence),
        "gt_ids": np.split(sequence.truths, sequence.truth_starts[1:-1]),
        "tracker_ids": np.split(sequence.tracks, sequence.track_starts[1:-1]),
        "similarity_scores": sequence.matrices(sequence.similarities),
        "num_gt_dets": len(sequence.truths),
        "num_tracker_dets": len(sequence.tracks),
        "num_gt_ids": sequence.distinct_objects,
        "num_tracker_ids": sequence.distinct_tracks,
    }


def _trackeval(metrics: Any, sequence: TrackedSequence) -> Callable[[], dict[str, Any]]:
    """Return a call of TrackEval's three metrics on what it makes of a sequence."""
    data = as_trackeval(sequence)
    quiet = {"PRINT_CONFIG": False}
    each = [metrics.HOTA(), metrics.CLEAR(quiet), metrics.Identity(quiet)]

    def run() -> dict[str, Any]:
        found: dict[str, Any] = {}
        for metric in each:
            found |= metric.eval_sequence(data)
        return found

    return run


def _difference(metrics: Any, sequence: TrackedSequence) -> SpeedRow:
    theirs = _trackeval(metrics, sequence)()
    ours = {
        "HOTA": hota(sequence).hota,
        "MOTA": clear(sequence).mota,
        "IDF1": identity(sequence).idf1,
    }
    largest = max(float(np.abs(theirs[name] - value).max()) for name, value in ours.items())
    return SpeedRow("largest difference to TrackEval's HOTA, MOTA, IDF1", largest, "1")


def _set_metrics(made: Made, repeats: int) -> list[SpeedRow]:
    """Measure OSPA and GOSPA from positions on."""
    calls: dict[str, Callable[[], Any]] = {
        "OSPA": lambda: ospa(_apart(made), CUTOFF_M),
        "GOSPA": lambda: gospa(_apart(made), CUTOFF_M),
    }
    soup = import_stone_soup()
    if soup is not None:
        calls["Stone Soup's GOSPA"] = _stone_soup(soup, made)
    times = interleaved(calls, repeats, process_time)
    frames = len(made.truths)
    of = f"{len(made.truths[0])} objects"
    rows = [
        SpeedRow(f"{name}, {of}", seconds / frames * 1e3, "ms a frame")
        for name, seconds in times.items()
    ]
    if soup is not None:
        ratio = times["Stone Soup's GOSPA"] / times["GOSPA"]
        theirs = np.array([v.value["distance"] for v in calls["Stone Soup's GOSPA"]().value])
        largest = float(np.abs(theirs - calls["GOSPA"]().distances).max())
        rows += compared("GOSPA over Stone Soup's", ratio)
        rows.append(SpeedRow("largest difference to Stone Soup's GOSPA", largest, "m"))
    return rows


def _apart(made: Made) -> TrackedSequence:
    return TrackedSequence.of(made.truth_ids, made.track_ids, distances_m=made.distances())


def _stone_soup(soup: tuple[Any, Any], made: Made) -> Callable[[], Any]:
    """Return a call of Stone Soup's GOSPA; its states are made beforehand."""
    metric, state = soup
    start = datetime(2000, 1, 1)
    truths, tracks = (
        [
            state(place.reshape(2, 1), timestamp=start + timedelta(seconds=t))
            for t, places in enumerate(frames)
            for place in places
        ]
        for frames in (made.truths, made.tracks)
    )
    ids = np.concatenate(made.track_ids), np.concatenate(made.truth_ids)
    return partial(metric(c=CUTOFF_M, p=1).compute_over_time, tracks, ids[0], truths, ids[1])


def import_trackeval() -> Any:
    """Return TrackEval's metrics, or None where they cannot be imported."""
    try:
        from trackeval import metrics
    except ImportError:
        return None
    return metrics


def import_stone_soup() -> tuple[Any, Any] | None:
    """Return Stone Soup's GOSPA and its states, or None where they cannot be imported."""
    try:
        from stonesoup.metricgenerator.ospametric import GOSPAMetric
        from stonesoup.types.state import State
    except ImportError:
        return None
    return GOSPAMetric, State
