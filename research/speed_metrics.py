"""How fast tracking metrics are, beside TrackEval and Stone Soup where these are installed.

All of it in processor time: what one core needs for it, whatever else runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from roadscope.benchmarks.metrics.matching import centre_distances
from roadscope.benchmarks.metrics.tracking.sequence import similarity_by_distance
from roadscope.benchmarks.speed.rows import SpeedRow, SpeedStep, interleaved
from roadscope.metrics import TrackedSequence, amota, clear, gospa, hota, identity, ospa

REPEATS = 7
FRAMES, OBJECTS = 1000, 30
SET_FRAMES = 200
"""Frames for OSPA and GOSPA: Stone Soup takes many milliseconds for each."""
SEED = 5
AREA_M, STEP_M, ERROR_M = 100.0, 0.5, 0.4
DETECTED, FALSE_TRACKS, SWAPPED = 0.9, 2, 0.02
"""Share of objects that have a track, number of false tracks, share of frames with new ids."""
CUTOFF_M = 2.0
GOALS: Mapping[str, float] = {
    "HOTA, CLEAR and identity over TrackEval's": 5.0,
    "GOSPA over Stone Soup's": 100.0,
}
"""How many times as fast as theirs ours are at least."""


@dataclass(frozen=True, slots=True)
class SimulatedSequence:
    """Objects that wander, and tracks with errors, misses, swapped ids and false tracks.

    Of all T frames: ids, (n, 2) positions in metres, and scores of tracks, the same in all frames.
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
        return [similarity_by_distance(distances) for distances in self.distances()]

    def as_tracked(self) -> TrackedSequence:
        """Return the sequence with similarities and scores."""
        frames = self.truth_ids, self.track_ids, self.similarities()
        return TrackedSequence.of(*frames, scores=self.scores)


def simulated_sequence(frames: int = FRAMES, objects: int = OBJECTS) -> SimulatedSequence:
    """Return the same sequence each time."""
    rng = np.random.default_rng(SEED)
    sequence = SimulatedSequence([], [], [], [], [])
    scores = np.random.default_rng(SEED + 1).random(objects + FALSE_TRACKS)
    places, names = rng.uniform(0, AREA_M, (objects, 2)), np.arange(objects)
    for _ in range(frames):
        places = places + rng.normal(0, STEP_M, places.shape)
        if rng.random() < SWAPPED:
            names = rng.permutation(names)
        detected = rng.random(objects) < DETECTED
        tracked = places[detected] + rng.normal(0, ERROR_M, (int(detected.sum()), 2))
        false = rng.uniform(0, AREA_M, (FALSE_TRACKS, 2))
        ids = np.concatenate([names[detected], objects + np.arange(FALSE_TRACKS)])
        sequence.truth_ids.append(np.arange(objects))
        sequence.truths.append(places)
        sequence.track_ids.append(ids)
        sequence.tracks.append(np.concatenate([tracked, false]))
        sequence.scores.append(scores[ids])
    return sequence


def metrics_steps() -> list[SpeedStep]:
    """Return the one step."""
    return [SpeedStep("tracking metrics", partial(measure_metrics, REPEATS))]


def measure_metrics(
    repeats: int, frames: int = FRAMES, objects: int = OBJECTS, set_frames: int = SET_FRAMES
) -> list[SpeedRow]:
    """Measure all tracking metrics; the libraries do the same work by turns with ours.

    A library that is not installed has no rows.
    """
    return [
        *_sequence_metrics(simulated_sequence(frames, objects), repeats),
        *_set_metrics(simulated_sequence(set_frames, objects), -(-repeats // 3)),
    ]


def _sequence_metrics(simulated: SimulatedSequence, repeats: int) -> list[SpeedRow]:
    """Measure HOTA, CLEAR and identity together, from similarities on; and each alone."""
    frames = simulated.truth_ids, simulated.track_ids, simulated.similarities()
    sequence = simulated.as_tracked()
    calls: dict[str, Callable[[], Any]] = {
        "record of a sequence": partial(TrackedSequence.of, *frames),
        "HOTA": partial(hota, sequence),
        "CLEAR": partial(clear, sequence),
        "identity": partial(identity, sequence),
        "AMOTA": partial(amota, sequence),
        "HOTA, CLEAR and identity": lambda: [f(sequence) for f in (hota, clear, identity)],
        "the same with the record": lambda: _three_with_record(
            simulated.truth_ids, simulated.track_ids, frames[2]
        ),
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
    """Return the row of a ratio with its goal, and one more where it misses the goal."""
    goal = GOALS.get(name)
    row = SpeedRow(name, ratio, "times" if goal is None else f"times of {goal:g}")
    late = goal is not None and ratio < goal
    return [row, SpeedRow(f"too slow: {name}", ratio, row.unit)] if late else [row]


def _three_with_record(
    truth_ids: list[np.ndarray], track_ids: list[np.ndarray], similarities: list[np.ndarray]
) -> list[Any]:
    sequence = TrackedSequence.of(truth_ids, track_ids, similarities)
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
        results: dict[str, Any] = {}
        for metric in each:
            results |= metric.eval_sequence(data)
        return results

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


def _set_metrics(simulated: SimulatedSequence, repeats: int) -> list[SpeedRow]:
    """Measure OSPA and GOSPA from positions on."""
    calls: dict[str, Callable[[], Any]] = {
        "OSPA": lambda: ospa(_with_distances(simulated), CUTOFF_M),
        "GOSPA": lambda: gospa(_with_distances(simulated), CUTOFF_M),
    }
    soup = import_stone_soup()
    if soup is not None:
        calls["Stone Soup's GOSPA"] = _stone_soup(soup, simulated)
    times = interleaved(calls, repeats, process_time)
    frames = len(simulated.truths)
    of = f"{len(simulated.truths[0])} objects"
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


def _with_distances(simulated: SimulatedSequence) -> TrackedSequence:
    return TrackedSequence.of(
        simulated.truth_ids, simulated.track_ids, distances_m=simulated.distances()
    )


def _stone_soup(soup: StoneSoupClasses, simulated: SimulatedSequence) -> Callable[[], Any]:
    """Return a call of Stone Soup's GOSPA; its states are made beforehand."""
    start = datetime(2000, 1, 1)
    truths, tracks = (
        [
            soup.state(place.reshape(2, 1), timestamp=start + timedelta(seconds=t))
            for t, places in enumerate(frames)
            for place in places
        ]
        for frames in (simulated.truths, simulated.tracks)
    )
    ids = np.concatenate(simulated.track_ids), np.concatenate(simulated.truth_ids)
    return partial(soup.gospa(c=CUTOFF_M, p=1).compute_over_time, tracks, ids[0], truths, ids[1])


def import_trackeval() -> Any:
    """Return TrackEval's metrics, or None where they cannot be imported."""
    try:
        from trackeval import metrics
    except ImportError:
        return None
    return metrics


class StoneSoupClasses(NamedTuple):
    """Stone Soup's classes of GOSPA and of a state."""

    gospa: Any
    state: Any


def import_stone_soup() -> StoneSoupClasses | None:
    """Return Stone Soup's classes, or None where they cannot be imported."""
    try:
        from stonesoup.metricgenerator.ospametric import GOSPAMetric
        from stonesoup.types.state import State
    except ImportError:
        return None
    return StoneSoupClasses(GOSPAMetric, State)
