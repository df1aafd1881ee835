"""How long trackers take for an update, by the number of targets.

In processor time, summed over threads: what one core needs for it, whatever else runs. `nearest`
has a filterpy filter for every target, each with its own small matrices; that is what it measures.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from time import process_time

import numpy as np

from roadscope.benchmarks.speed.rows import SpeedRow
from roadscope.core import Category, Detections, Pose
from roadscope.trackers import TRACKERS, OfflineTracker, is_offline

COUNTS = (10, 50, 200, 500)
CROWD = 12
"""Targets that are all within one another's gates."""
PITCH_M = 0.25
"""How far apart they stand: nearer than bodies allow, so that every detection may be of each."""
EVERY = ""
GOALS_MS: Mapping[tuple[str, str], float] = {
    (EVERY, "200 targets"): 1.0,
    ("jpda", "50 targets"): 2.0,
    ("jpda", "12 crowded targets"): 10.0,
}
"""What a whole update of a tracker, or of every one, may take in a scene: median and p90."""
PASS_UNIT = "ms a frame"
"""Of what is done once, after the last frame."""
PERIOD_S = 0.1
FRAMES, LEAD = 60, 10
"""Updates, and how many of them are not timed: until then tracks are confirmed."""
AREA_M2 = 150.0
"""Road for each target: dense traffic."""
MISSED, CLUTTER, UNSURE = 0.05, 0.05, 0.2
"""Shares of targets that are not detected, of detections of nothing, and of low scores."""

Seen = tuple[Detections, Pose]


def seen_traffic(count: int, frames: int = FRAMES, seed: int = 0) -> Iterator[Seen]:
    """Yield detections of cars driving along both ways, and the moving ego's pose."""
    rng = np.random.default_rng(seed)
    half = np.sqrt(AREA_M2 * count) / 2
    places = rng.uniform(-half, half, (count, 2))
    yaws = np.where(rng.random(count) < 0.5, 0.0, np.pi)
    speeds = rng.uniform(0, 15, count) * np.cos(yaws)
    for k in range(frames):
        there = places + np.outer(k * PERIOD_S * speeds, [1, 0])
        found = rng.random(count) >= MISSED
        nothing = rng.uniform(-half, half, (int(CLUTTER * count), 2))
        centres = np.concatenate([there[found], nothing])
        headings = np.concatenate([yaws[found], rng.uniform(-np.pi, np.pi, len(nothing))])
        pose = Pose.planar(10 * k * PERIOD_S, 0.0, 0.0)
        yield _detected(rng, centres, headings, k * PERIOD_S).moved(pose.inverse(), "ego"), pose


def _detected(
    rng: np.random.Generator, places: np.ndarray, yaws: np.ndarray, stamp_s: float
) -> Detections:
    """Put cars at (N, 2) places of the world, a little off."""
    n = len(places)
    centres = np.column_stack([places, np.full(n, 0.75)]) + 0.1 * rng.standard_normal((n, 3))
    return Detections(
        centres, np.array([4.5, 1.8, 1.5]) * rng.uniform(0.95, 1.05, (n, 3)),
        yaws + 0.05 * rng.standard_normal(n), np.full(n, Category.CAR),
        np.where(rng.random(n) < UNSURE, 0.4, 0.9), "world", stamp_s,
    )  # fmt: skip


def crowd(frames: int = FRAMES, seed: int = 0) -> Iterator[Seen]:
    """Yield detections of `CROWD` people who walk on together, and the standing ego's pose."""
    rng = np.random.default_rng(seed)
    across = int(np.sqrt(CROWD))
    start = PITCH_M * np.column_stack(np.divmod(np.arange(CROWD), across)) + [10.0, 0.0]
    for k in range(frames):
        places = start + [k * PERIOD_S, 0.0] + 0.1 * rng.standard_normal((CROWD, 2))
        yield Detections(
            np.column_stack([places, np.full(CROWD, 0.9)]), np.tile([0.6, 0.6, 1.8], (CROWD, 1)),
            np.zeros(CROWD), np.full(CROWD, Category.PEDESTRIAN), np.full(CROWD, 0.9), "ego",
            k * PERIOD_S,
        ), Pose.planar(0.0, 0.0, 0.0)  # fmt: skip


def scenes(counts: Sequence[int], frames: int) -> dict[str, list[Seen]]:
    """Return what trackers are measured on, by name."""
    traffic = {f"{count} targets": list(seen_traffic(count, frames)) for count in counts}
    return {**traffic, f"{CROWD} crowded targets": list(crowd(frames))}


def measure_trackers(
    names: Sequence[str] | None = None, counts: Sequence[int] = COUNTS, frames: int = FRAMES
) -> list[SpeedRow]:
    """Measure whole updates: median, 90th and 99th percentile, and who misses a goal.

    Of offline trackers, whose updates are those of an online one, the pass at the end is measured.

    names: specs of trackers; None: all that are registered and need no other package. Those of
        others take up to seconds for an update.
    """
    rows: list[SpeedRow] = []
    late: list[SpeedRow] = []
    episodes = scenes(counts, frames)
    for name in own_trackers() if names is None else names:
        for scene, episode in episodes.items():
            what = f"tracker {name}, {scene}"
            if is_offline(TRACKERS.resolve(name).factory):
                took_ms = timed_pass(name, episode)
                rows.append(SpeedRow(f"{what}, pass at the end", took_ms, PASS_UNIT))
                continue
            middle, most, worst = np.percentile(timed_updates(name, episode), [50, 90, 99]).tolist()
            goal_ms = goal(name, scene)
            unit = "ms" if goal_ms is None else f"ms of {goal_ms:g}"
            rows += [SpeedRow(what, middle, unit), SpeedRow(f"{what}, p90", most, unit)]
            rows.append(SpeedRow(f"{what}, p99", worst, "ms"))
            for value, tail in ((middle, ""), (most, ", p90")):
                if goal_ms is not None and value > goal_ms:
                    late.append(SpeedRow(f"too slow, {scene}: {name}{tail}", value, unit))
    return rows + late


def goal(name: str, scene: str) -> float | None:
    """Return the ms that an update may take, the lower where there are two; None without a goal."""
    found = [GOALS_MS[key] for key in ((name, scene), (EVERY, scene)) if key in GOALS_MS]
    return min(found, default=None)


def own_trackers() -> list[str]:
    """Return the registered trackers that need no other package."""
    return [name for name in TRACKERS if TRACKERS.resolve(name).requirement is None]


def timed_pass(name: str, episode: Sequence[Seen]) -> float:
    """Return the ms that an offline tracker's pass over an episode takes for each of its frames."""
    tracker = TRACKERS.make(name)
    if not isinstance(tracker, OfflineTracker):
        raise ValueError(f"the tracker '{name}' has no pass at the end")
    tracker.reset()
    history = [tracker.update(detections, pose) for detections, pose in episode]
    # Short, for what is compiled.
    tracker.rescored(history[:LEAD])
    start = process_time()
    tracker.rescored(history)
    return (process_time() - start) * 1e3 / len(episode)


def timed_updates(name: str, episode: Sequence[Seen]) -> np.ndarray:
    """Run a tracker over an episode, once untimed before; return the ms of each update.

    Raises `ValueError` if it follows nothing, for then there is nothing to time.
    """
    tracker = TRACKERS.make(name)
    for timed in (False, True):
        tracker.reset()
        times_ms = []
        for number, (detections, pose) in enumerate(episode if timed else episode[:LEAD]):
            start = process_time()
            tracks = tracker.update(detections, pose)
            if number >= LEAD:
                times_ms.append((process_time() - start) * 1e3)
    if not len(tracks):
        raise ValueError(f"the tracker '{name}' follows nothing")
    return np.array(times_ms)
