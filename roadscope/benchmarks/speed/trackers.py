"""How long trackers take for an update, by the number of targets.

In processor time, summed over threads: what one core needs for it, whatever else runs. `nearest`
has a filter for every target, each with its own small matrices; that is what it measures.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from time import process_time
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.speed.rows import SpeedRow
from roadscope.core import Category, Detections, Pose
from roadscope.trackers import TRACKERS, OfflineTracker, is_offline

COUNTS = (10, 50, 200, 500)
CROWD = 12
"""Targets that are all within one another's gates."""
PITCH_M = 0.25
"""Between neighbours: less than bodies allow, so that every detection may be of each."""
PERIOD_S = 0.1
UPDATES, LEAD_UPDATES = 60, 10
"""Updates, and how many of them are not timed: in these tracks are confirmed."""
AREA_M2 = 150.0
"""Road for each target: dense traffic."""
MISSED, CLUTTER, LOW_SCORES = 0.05, 0.05, 0.2
"""Shares of targets that are not detected, of detections of nothing, and of low scores."""


class TrackerFrame(NamedTuple):
    """What a tracker gets: detections in the ego frame, and the ego's pose."""

    detections: Detections
    ego_pose: Pose


def detected_traffic(count: int, frames: int = UPDATES) -> Iterator[TrackerFrame]:
    """Yield detections of cars that drive in both directions, and the moving ego's pose."""
    rng = np.random.default_rng(0)
    half = np.sqrt(AREA_M2 * count) / 2
    places = rng.uniform(-half, half, (count, 2))
    yaws = np.where(rng.random(count) < 0.5, 0.0, np.pi)
    speeds = rng.uniform(0, 15, count) * np.cos(yaws)
    for k in range(frames):
        moved = places + np.outer(k * PERIOD_S * speeds, [1, 0])
        detected = rng.random(count) >= MISSED
        clutter = rng.uniform(-half, half, (int(CLUTTER * count), 2))
        centres = np.concatenate([moved[detected], clutter])
        headings = np.concatenate([yaws[detected], rng.uniform(-np.pi, np.pi, len(clutter))])
        pose = Pose.planar(10 * k * PERIOD_S, 0.0, 0.0)
        detections = _detected(rng, centres, headings, k * PERIOD_S)
        yield TrackerFrame(detections.moved(pose.inverse(), "ego"), pose)


def _detected(
    rng: np.random.Generator, places: np.ndarray, yaws: np.ndarray, stamp_s: float
) -> Detections:
    """Return detections of cars at (N, 2) places of the world, with errors."""
    n = len(places)
    centres = np.column_stack([places, np.full(n, 0.75)]) + 0.1 * rng.standard_normal((n, 3))
    return Detections(
        centres=centres,
        sizes=np.array([4.5, 1.8, 1.5]) * rng.uniform(0.95, 1.05, (n, 3)),
        yaws=yaws + 0.05 * rng.standard_normal(n),
        categories=np.full(n, Category.CAR),
        scores=np.where(rng.random(n) < LOW_SCORES, 0.4, 0.9),
        frame="world",
        stamp_s=stamp_s,
    )


def detected_crowd(frames: int = UPDATES) -> Iterator[TrackerFrame]:
    """Yield detections of `CROWD` people who walk together, and the standing ego's pose."""
    rng = np.random.default_rng(0)
    across = int(np.sqrt(CROWD))
    start = PITCH_M * np.column_stack(np.divmod(np.arange(CROWD), across)) + [10.0, 0.0]
    for k in range(frames):
        places = start + [k * PERIOD_S, 0.0] + 0.1 * rng.standard_normal((CROWD, 2))
        detections = Detections(
            centres=np.column_stack([places, np.full(CROWD, 0.9)]),
            sizes=np.tile([0.6, 0.6, 1.8], (CROWD, 1)),
            yaws=np.zeros(CROWD),
            categories=np.full(CROWD, Category.PEDESTRIAN),
            scores=np.full(CROWD, 0.9),
            frame="ego",
            stamp_s=k * PERIOD_S,
        )
        yield TrackerFrame(detections, Pose.planar(0.0, 0.0, 0.0))


def measure_trackers(
    names: Sequence[str] | None = None, counts: Sequence[int] = COUNTS, frames: int = UPDATES
) -> list[SpeedRow]:
    """Measure whole updates: median, 90th and 99th percentile.

    Of offline trackers, whose updates are those of an online one, the pass at the end is measured.

    names: specs of trackers; None: all that are registered and need no other package. Those of
        others take up to seconds for an update.
    """
    rows: list[SpeedRow] = []
    episodes = {f"{count} targets": list(detected_traffic(count, frames)) for count in counts}
    episodes[f"{CROWD} crowded targets"] = list(detected_crowd(frames))
    for name in own_trackers() if names is None else names:
        for scene, episode in episodes.items():
            what = f"tracker {name}, {scene}"
            if is_offline(TRACKERS.resolve(name).factory):
                took_ms = timed_pass(name, episode)
                rows.append(SpeedRow(f"{what}, pass at the end", took_ms, "ms a frame"))
                continue
            percentiles = np.percentile(timed_updates(name, episode), [50, 90, 99]).tolist()
            for suffix, value in zip(("", ", p90", ", p99"), percentiles, strict=True):
                rows.append(SpeedRow(f"{what}{suffix}", value, "ms"))
    return rows


def own_trackers() -> list[str]:
    """Return the registered trackers that need no other package."""
    return [name for name in TRACKERS if TRACKERS.resolve(name).requirement is None]


def timed_pass(name: str, episode: Sequence[TrackerFrame]) -> float:
    """Return the ms that an offline tracker's pass over an episode takes for each of its frames."""
    tracker = TRACKERS.make(name)
    if not isinstance(tracker, OfflineTracker):
        raise ValueError(f"the tracker '{name}' has no pass at the end")
    tracker.reset()
    history = [tracker.update(detections, pose) for detections, pose in episode]
    # Short, for what is compiled.
    tracker.rescored(history[:LEAD_UPDATES])
    start = process_time()
    tracker.rescored(history)
    return (process_time() - start) * 1e3 / len(episode)


def timed_updates(name: str, episode: Sequence[TrackerFrame]) -> np.ndarray:
    """Run a tracker over an episode, once untimed before; return the ms of each update.

    Raises `ValueError` if it has no tracks at the end, for then there is nothing to time.
    """
    tracker = TRACKERS.make(name)
    for timed in (False, True):
        tracker.reset()
        times_ms = []
        for number, (detections, pose) in enumerate(episode if timed else episode[:LEAD_UPDATES]):
            start = process_time()
            tracks = tracker.update(detections, pose)
            if number >= LEAD_UPDATES:
                times_ms.append((process_time() - start) * 1e3)
    if not len(tracks):
        raise ValueError(f"the tracker '{name}' follows nothing")
    return np.array(times_ms)
