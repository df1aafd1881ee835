"""What a tracker promises, one by one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from roadscope.benchmarks.check.items import (
    TWO_SECONDS,
    Promise,
    PromiseError,
    begins,
    begun,
    has_method,
    left_alone,
    traffic_ready,
)
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.stack import STAMP_TOLERANCE_S, guarded, prints_aside
from roadscope.benchmarks.oracle import ORACLE
from roadscope.benchmarks.perceived import Perceived
from roadscope.core import Category, Detections, Pose, Tracks, TrackState
from roadscope.core.registry import Plugin
from roadscope.trackers.api import is_offline

PERIOD_S = 0.1
FRAMES = 20
FAR_M = 20.0
"""No road user is so far on after one frame."""
NEAR_M = 1.0
RING_M, RING_AT_M = 6.0, (20.0, 0.0)
"""Radius and middle of the circle that cars drive on."""
FIELDS = ("centres", "sizes", "yaws", "velocities", "covariances", "categories", "scores")

Seen = tuple[Detections, Pose | None]


def cars(seed: int = 0, posed: bool = False) -> Iterator[Seen]:
    """Yield four cars 12 m and more apart, one in ten not detected, from a moving ego or not."""
    rng = np.random.default_rng(seed)
    start = np.array([[10.0, -6.0], [25.0, 6.0], [40.0, -6.0], [-15.0, 6.0]])
    speed = np.array([[5.0, 0.0], [-4.0, 0.0], [0.0, 0.0], [6.0, 0.5]])
    for k in range(FRAMES):
        places = start + k * PERIOD_S * speed + 0.05 * rng.standard_normal((4, 2))
        pose = Pose.planar(0.8 * k, 0.1 * k, 0.01 * k) if posed else None
        seen = detected(places[rng.random(4) < 0.9], k * PERIOD_S)
        yield (seen if pose is None else seen.moved(pose.inverse(), "ego")), pose


def turning(first: int = 0) -> Iterator[Seen]:
    """Yield four cars on a circle, each of which ends where another one begins.

    first: number of the first frame; the cars begin at the same places whatever it is.
    """
    rng = np.random.default_rng(first)
    for k in range(FRAMES):
        angles = 0.3 + 0.5 * np.pi * (np.arange(4) + k / FRAMES)
        places = RING_AT_M + RING_M * np.column_stack([np.cos(angles), np.sin(angles)])
        noise = 0.05 * rng.standard_normal((4, 2))
        yield detected(places + noise, (first + k) * PERIOD_S), None


def detected(places: np.ndarray, stamp_s: float) -> Detections:
    """Return cars at (N, 2) places, ego frame."""
    n = len(places)
    return Detections(
        np.column_stack([places, np.full(n, 0.75)]), np.tile([4.6, 1.85, 1.5], (n, 1)),
        np.zeros(n), np.full(n, Category.CAR), np.full(n, 0.9), "ego", stamp_s,
    )  # fmt: skip


def updated(plugin: Plugin[Any], tracker: Any, seen: Seen) -> Tracks:
    """Call update; an answer that is not what the contract says is a fault."""
    detections, pose = seen
    tracks = guarded(plugin.spec, tracker.update, detections, pose)
    return sound("update", tracks, detections.stamp_s, posed=pose is not None)


def sound(method: str, tracks: Any, stamp_s: float, *, posed: bool) -> Tracks:
    """Refuse tracks of another moment or frame than asked for, and what are none.

    posed: whether the ego's pose was known.
    """
    if not isinstance(tracks, Tracks):
        raise PromiseError(f"{method} returned {type(tracks).__name__}, not roadscope.core.Tracks")
    if not abs(tracks.stamp_s - stamp_s) <= STAMP_TOLERANCE_S:
        raise PromiseError(
            f"{method}: tracks are stamped {round(tracks.stamp_s, 6)} s, their detections "
            f"{round(stamp_s, 6)} s; return the stamp of the detections"
        )
    possible = ("ego", "world") if posed else ("ego",)
    if tracks.frame not in possible:
        known = "with an ego pose" if posed else "without an ego pose"
        raise PromiseError(
            f"{method}: tracks in frame '{tracks.frame}' {known}; possible: {', '.join(possible)}"
        )
    return tracks


def told(plugin: Plugin[Any], tracker: Any, episode: Sequence[Seen]) -> list[Tracks]:
    """Run a tracker over an episode."""
    return [updated(plugin, tracker, seen) for seen in episode]


def methods(plugin: Plugin[Any]) -> str:
    """Look for reset and update."""
    has_method(plugin, "reset")
    has_method(plugin, "update", "detections", "ego_pose")
    if hasattr(plugin.factory, "rescored") and not is_offline(plugin.factory):
        return "its rescored is never called: the class does not say offline = True"
    return ""


def answers(plugin: Plugin[Any]) -> str:
    """Look at what comes back, with the ego's pose and without."""
    for posed in (False, True):
        told(plugin, begun(plugin), list(cars(posed=posed)))
    return ""


def nothing_seen(plugin: Plugin[Any]) -> str:
    """Look at frames without detections, at first and in between."""
    tracker = begun(plugin)
    if len(updated(plugin, tracker, (Detections.empty(0.0), None))):
        raise PromiseError("the first frame has no detections, yet there are tracks")
    for k in range(1, 8):
        places = np.array([[10.0, 0.0]]) if k % 3 else np.empty((0, 2))
        updated(plugin, tracker, (detected(places, k * PERIOD_S), None))
    return ""


def never_again(plugin: Plugin[Any]) -> str:
    """Look for ids that are given to something else: cars that flash up far apart."""
    tracker, last = begun(plugin), dict[int, np.ndarray]()
    for k in range(FRAMES):
        place = np.array([[40.0 * (k % 4) - 60.0, 40.0 * (k % 3) - 40.0]])
        seen = detected(place if k % 5 else np.empty((0, 2)), k * PERIOD_S)
        tracks = updated(plugin, tracker, (seen, None))
        for identity, centre in zip(tracks.ids.tolist(), tracks.centres, strict=True):
            jumped = np.linalg.norm(centre - last.get(identity, centre))
            if jumped > FAR_M:
                raise PromiseError(
                    f"id {identity} came back {jumped:.0f} m away, at {tracks.stamp_s:.1f} s; an "
                    "id belongs to one object and is never used again for another"
                )
            last[identity] = centre
    return ""


def one_identity(plugin: Plugin[Any]) -> str:
    """Look at whether a car that is seen all along keeps its id."""
    tracker, found = begun(plugin), list[int]()
    for k in range(FRAMES):
        place = np.array([[10.0 + 0.5 * k, 3.0]])
        tracks = updated(plugin, tracker, (detected(place, k * PERIOD_S), None))
        near = np.hypot(*(tracks.centres[:, :2] - place).T) < NEAR_M
        found += tracks.ids[near & (tracks.states != TrackState.TENTATIVE)].tolist()
    if not found:
        raise PromiseError(
            "a car at 5 m/s that is seen in every frame is never followed within 1 m"
        )
    if len(set(found)) > 1:
        raise PromiseError(
            f"a car at 5 m/s that is seen in every frame had the ids {sorted(set(found))}"
        )
    return ""


def any_order(plugin: Plugin[Any]) -> str:
    """Look at whether the order of detections matters."""
    rng, expected = np.random.default_rng(1), told(plugin, begun(plugin), list(cars()))
    mixed = [(d.select(rng.permutation(len(d))), pose) for d, pose in cars()]
    if words := difference(expected, told(plugin, begun(plugin), mixed)):
        raise PromiseError(f"the order of detections matters: in another order {words}")
    return ""


def input_left_alone(plugin: Plugin[Any]) -> str:
    """Look at whether detections and poses stay as they were."""
    tracker = begun(plugin)
    for seen in cars(posed=True):
        left_alone(
            partial(updated, plugin, tracker), seen,
            "update changed the detections or the pose it was given",
        )  # fmt: skip
    return ""


def repeats(plugin: Plugin[Any]) -> str:
    """Look at whether the same input gives the same tracks."""
    once, twice = (told(plugin, begun(plugin), list(cars(posed=True))) for _ in range(2))
    if words := difference(once, twice):
        raise PromiseError(f"the same input gives other tracks the second time: {words}")
    return ""


def forgets(plugin: Plugin[Any]) -> str:
    """Look at whether anything is left after reset.

    Once the clock goes on, and every car begins where another one ended and drives on like that:
    tracks that were kept are found again, their ids in another order. Once the clock starts anew.
    """
    for before, after in ((turning(), turning(FRAMES)), (cars(seed=5), cars())):
        episode, tracker = list(after), begun(plugin)
        earlier = told(plugin, tracker, list(before))
        guarded(plugin.spec, tracker.reset)
        found = told(plugin, tracker, episode)
        expected = told(plugin, begun(plugin), episode)
        words = difference(expected, found) or known_ids(earlier, expected, found)
        if not words and not in_order(expected, found):
            # Of ids that are drawn, five fresh instances do not agree.
            fresh = (told(plugin, begun(plugin), episode) for _ in range(5))
            if all(in_order(expected, again) for again in fresh):
                words = "ids are given in another order"
        if words:
            raise PromiseError(f"reset does not forget: after another episode {words}")
    return ""


def moving_ego(plugin: Plugin[Any]) -> str:
    """Look at whether tracks lie where things are while the ego drives."""
    tracker = begun(plugin)
    place = np.array([[30.0, 4.0, 0.75]])
    for k in range(FRAMES):
        pose = Pose.planar(1.0 * k, 0.0, 0.02 * k)
        tracks = updated(
            plugin, tracker, (detected(pose.inverse().apply(place)[:, :2], k * PERIOD_S), pose)
        )
    world = tracks if tracks.frame == "world" else tracks.moved(pose, "world")
    apart = np.hypot(*(world.centres[:, :2] - place[:, :2]).T)
    if not (apart < NEAR_M).any():
        nearest = f"{apart.min():.1f} m away" if len(apart) else "not there"
        raise PromiseError(
            f"a parked car passed at 10 m/s has its track {nearest}, in frame '{tracks.frame}'; "
            "ego_pose is world_from_ego, and detections come in the ego frame"
        )
    return ""


def two_seconds(plugin: Plugin[Any]) -> str:
    """Follow simulated traffic for two seconds, on perfect detections in any order."""
    from roadscope.benchmarks.jobs.ego_poses import track_told
    from roadscope.benchmarks.jobs.job import perceived_by, tracking_scores

    begin, episode, rule = perf_counter(), Episode(*TWO_SECONDS), Eligibility()
    seen = shuffled(perceived_by(ORACLE, episode, rule))
    with prints_aside():
        tracks, calls_ms = track_told(plugin.spec, seen, episode)
    scores = tracking_scores(tracks, calls_ms, seen, rule)
    if not any(map(len, tracks)):
        raise PromiseError("two seconds of a motorway with perfect detections: nothing is followed")
    return (
        f"HOTA {scores['hota'].value:.2f} on perfect detections of a motorway, "
        f"{scores['call_p50_ms'].value:.2g} ms an update, {perf_counter() - begin:.0f} s in all"
    )


def shuffled(perceived: Perceived) -> Perceived:
    """Put the detections of every frame in an order of its own: rows are no identities."""
    rng = np.random.default_rng(2)
    mixed = [found.select(rng.permutation(len(found))) for found in perceived.detections]
    return replace(perceived, detections=tuple(mixed))


def difference(expected: Sequence[Tracks], found: Sequence[Tracks]) -> str:
    """Say in which frame two runs differ, but for the names of tracks; empty where they agree."""
    names: dict[int, int] = {}
    for one, other in zip(expected, found, strict=True):
        when = f"at {one.stamp_s:.1f} s"
        if len(one) != len(other):
            return f"there are {len(other)} tracks instead of {len(one)} {when}"
        first, second = _by_place(one), _by_place(other)
        for field in FIELDS:
            if not np.allclose(getattr(one, field)[first], getattr(other, field)[second]):
                return f"the {field} of tracks differ {when}"
        for a, b in zip(one.ids[first].tolist(), other.ids[second].tolist(), strict=True):
            if names.setdefault(a, b) != b:
                return f"identities are mixed up {when}"
    return "" if len(set(names.values())) == len(names) else "two tracks become one"


def known_ids(
    earlier: Sequence[Tracks], expected: Sequence[Tracks], found: Sequence[Tracks]
) -> str:
    """Say which id of an earlier episode comes back; empty where all are new or as expected.

    Ids may begin anew or go on: those that begin anew are those of a fresh instance.
    """
    if all(a == b for a, b in _renamed(expected, found)):
        return ""
    known = {identity for tracks in earlier for identity in tracks.ids.tolist()}
    for tracks in found:
        if back := known.intersection(tracks.ids.tolist()):
            return f"its id {min(back)} comes back at {tracks.stamp_s:.1f} s"
    return ""


def in_order(expected: Sequence[Tracks], found: Sequence[Tracks]) -> bool:
    """Say whether ids of two runs that differ in nothing else follow one another alike."""
    second = [b for _, b in sorted(_renamed(expected, found))]
    return second == sorted(second)


def _renamed(expected: Sequence[Tracks], found: Sequence[Tracks]) -> set[tuple[int, int]]:
    """Return what each track is called in two runs that differ in nothing else."""
    return {
        names
        for one, other in zip(expected, found, strict=True)
        for names in zip(
            one.ids[_by_place(one)].tolist(), other.ids[_by_place(other)].tolist(), strict=True
        )
    }


def _by_place(tracks: Tracks) -> np.ndarray:
    return np.lexsort(np.round(tracks.centres.T, 6))


PROMISES = (
    *begins("update", methods),
    Promise("answers with tracks of the same moment", answers),
    Promise("takes frames without detections", nothing_seen),
    Promise("never uses an id again", never_again),
    Promise("keeps the id of what it follows", one_identity),
    Promise("the order of detections is irrelevant", any_order),
    Promise("leaves its input alone", input_left_alone),
    Promise("the same input gives the same tracks", repeats),
    Promise("reset forgets everything", forgets),
    Promise("follows what stands while the ego moves", moving_ego),
    Promise("follows two seconds of traffic", two_seconds, traffic_ready),
)
