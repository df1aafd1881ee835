"""The promises of trackers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from roadscope.benchmarks.boards.tracking import tracking_scores
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.kinds import TRACKER
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.nodes.detections import DetectionNode
from roadscope.benchmarks.nodes.tracks import track
from roadscope.benchmarks.records import CallTimes, EpisodeDetections, EpisodeTracks
from roadscope.benchmarks.references import detection_source
from roadscope.core import Category, Detections, Pose, Tracks, TrackState
from roadscope.core.answers import check_rescored, check_tracks
from roadscope.testing.shared import figure_in_words, input_promise, start_promises
from roadscope.testing.subject import Instance, Promise, PromiseError, Subject

PERIOD_S = 0.1
FRAMES = 20
FAR_M = 20.0
"""Greater than any road user's motion from one frame to the next."""
NEAR_M = 1.0
"""A track within this distance of a car is that of the car; chosen by hand."""
RING_M, RING_AT_M = 6.0, (20.0, 0.0)
"""Radius and middle of the circle on which cars drive."""
FRESH_INSTANCES = 5
"""Fresh instances whose ids are compared: random ids do not have the same order in all of them."""
FIELDS = ("centres", "sizes", "yaws", "velocities", "covariances", "categories", "scores")
SCENE = Episode("motorway", 0, "lux", 2.0)
"""Traffic, one of the training seeds, sensors, seconds."""
RULE = Eligibility()
REFERENCE = "existence"
UNLINKED = "new ids in every frame"
"""The lower mark: true boxes, each with an id of its own."""
LEAST_OF_UNLINKED = 2.0
"""A tracker is broken if its HOTA is less than this many times that of `UNLINKED`.

Chosen by hand: row numbers as ids have 1.9 times as much, `nearest` has 5 times.
"""


@dataclass(frozen=True, slots=True)
class TrackerInput:
    """What a tracker gets in one frame: detections, and the ego's pose or None."""

    detections: Detections
    ego_pose: Pose | None = None


def parallel_cars(seed: int = 0, *, posed: bool = False) -> list[TrackerInput]:
    """Return frames with four cars at least 12 m from each other; one in ten is not detected.

    posed: whether the ego drives and its poses are known.
    """
    rng = np.random.default_rng(seed)
    start = np.array([[10.0, -6.0], [25.0, 6.0], [40.0, -6.0], [-15.0, 6.0]])
    velocity = np.array([[5.0, 0.0], [-4.0, 0.0], [0.0, 0.0], [6.0, 0.5]])
    ticks = []
    for k in range(FRAMES):
        places = start + k * PERIOD_S * velocity + 0.05 * rng.standard_normal((4, 2))
        detections = cars(places[rng.random(4) < 0.9], k * PERIOD_S)
        if posed:
            pose = Pose.planar(0.8 * k, 0.1 * k, 0.01 * k)
            ticks.append(TrackerInput(detections.moved(pose.inverse(), "ego"), pose))
        else:
            ticks.append(TrackerInput(detections))
    return ticks


def circling_cars(first: int = 0) -> list[TrackerInput]:
    """Return frames with four cars on a circle; each ends where another one begins.

    first: number of the first frame, which decides the stamps; the positions are always the same.
    """
    rng = np.random.default_rng(first)
    ticks = []
    for k in range(FRAMES):
        angles = 0.3 + 0.5 * np.pi * (np.arange(4) + k / FRAMES)
        places = RING_AT_M + RING_M * np.column_stack([np.cos(angles), np.sin(angles)])
        places += 0.05 * rng.standard_normal((4, 2))
        ticks.append(TrackerInput(cars(places, (first + k) * PERIOD_S)))
    return ticks


def cars(places: np.ndarray, stamp_s: float) -> Detections:
    """Return detections of cars at (N, 2) places, frame `ego`."""
    n = len(places)
    return Detections(
        np.column_stack([places, np.full(n, 0.75)]),
        np.tile([4.6, 1.85, 1.5], (n, 1)),
        np.zeros(n),
        np.full(n, Category.CAR),
        np.full(n, 0.9),
        "ego",
        stamp_s,
    )


def update(instance: Instance, tick: TrackerInput) -> Tracks:
    """Return the tracks of a frame."""
    answer = instance.call("update", tick.detections, tick.ego_pose)
    posed = tick.ego_pose is not None
    return check_tracks(answer, stamp_s=tick.detections.stamp_s, posed=posed)


def update_all(instance: Instance, ticks: Iterable[TrackerInput]) -> list[Tracks]:
    """Return the tracks of consecutive frames."""
    return [update(instance, tick) for tick in ticks]


def tracks_of_fresh_instance(subject: Subject, ticks: Sequence[TrackerInput]) -> list[Tracks]:
    """Return the tracks of a fresh instance."""
    with subject.started() as instance:
        return update_all(instance, ticks)


def answers(subject: Subject) -> str:
    """Run it with the ego's pose and without, and have every answer checked."""
    for posed in (False, True):
        tracks_of_fresh_instance(subject, parallel_cars(posed=posed))
    if "rescored" in subject.traits.methods and not subject.traits.offline:
        return "its rescored is never called: the class does not say offline = True"
    return ""


def no_detections(subject: Subject) -> str:
    """Refuse tracks before the first detection, and run frames without detections in between."""
    with subject.started() as instance:
        if len(update(instance, TrackerInput(Detections.empty(0.0)))):
            raise PromiseError("the first frame has no detections, yet there are tracks")
        for k in range(1, 8):
            places = np.array([[10.0, 0.0]]) if k % 3 else np.empty((0, 2))
            update(instance, TrackerInput(cars(places, k * PERIOD_S)))
    return ""


def unique_ids(subject: Subject) -> str:
    """Refuse ids that pass to another object: each car appears for one frame, far from the last."""
    last: dict[int, np.ndarray] = {}
    with subject.started() as instance:
        for k in range(FRAMES):
            place = np.array([[40.0 * (k % 4) - 60.0, 40.0 * (k % 3) - 40.0]])
            places = place if k % 5 else np.empty((0, 2))
            tracks = update(instance, TrackerInput(cars(places, k * PERIOD_S)))
            for identity, centre in zip(tracks.ids.tolist(), tracks.centres, strict=True):
                jumped_m = np.linalg.norm(centre - last.get(identity, centre))
                if jumped_m > FAR_M:
                    raise PromiseError(
                        f"id {identity} came back {jumped_m:.0f} m away, at "
                        f"{tracks.stamp_s:.1f} s; an id belongs to one object and is never used "
                        "again for another"
                    )
                last[identity] = centre
    return ""


def one_id(subject: Subject) -> str:
    """Refuse a tracker that changes the id of a car that is detected in every frame."""
    ids: list[int] = []
    with subject.started() as instance:
        for k in range(FRAMES):
            place = np.array([[10.0 + 0.5 * k, 3.0]])
            tracks = update(instance, TrackerInput(cars(place, k * PERIOD_S)))
            near = np.hypot(*(tracks.centres[:, :2] - place).T) < NEAR_M
            ids += tracks.ids[near & (tracks.states != TrackState.TENTATIVE)].tolist()
    if not ids:
        raise PromiseError("a car at 5 m/s, detected in every frame, has no track within 1 m")
    if len(set(ids)) > 1:
        raise PromiseError(f"a car at 5 m/s, detected in every frame, had ids {sorted(set(ids))}")
    return ""


def order(subject: Subject) -> str:
    """Refuse a tracker whose tracks depend on the order of detections."""
    rng, ticks = np.random.default_rng(1), parallel_cars()
    mixed = [
        replace(tick, detections=tick.detections.select(rng.permutation(len(tick.detections))))
        for tick in ticks
    ]
    if words := difference(
        tracks_of_fresh_instance(subject, ticks), tracks_of_fresh_instance(subject, mixed)
    ):
        raise PromiseError(f"the order of detections matters: in another order {words}")
    return ""


def repeats(subject: Subject) -> str:
    """Refuse a tracker that answers the same input differently the second time."""
    ticks = parallel_cars(posed=True)
    if words := difference(
        tracks_of_fresh_instance(subject, ticks), tracks_of_fresh_instance(subject, ticks)
    ):
        raise PromiseError(f"the same input gives other tracks the second time: {words}")
    return ""


def forgets(subject: Subject) -> str:
    """Refuse a tracker whose answers after a reset depend on what was before it.

    In the first case the clock continues, and every car begins where another one ended: tracks
    that survive the reset match the new cars, and change the order of ids. In the second case the
    clock starts again at 0.
    """
    episodes = ((circling_cars(), circling_cars(FRAMES)), (parallel_cars(seed=5), parallel_cars()))
    for before, after in episodes:
        with subject.started() as instance:
            earlier = update_all(instance, before)
            instance.call("reset")
            answered = update_all(instance, after)
        expected = tracks_of_fresh_instance(subject, after)
        words = difference(expected, answered) or repeated_ids(
            earlier, expected=expected, answered=answered
        )
        if not words and not in_order(expected, answered):
            fresh = (tracks_of_fresh_instance(subject, after) for _ in range(FRESH_INSTANCES))
            if all(in_order(expected, again) for again in fresh):
                words = "ids are given in another order"
        if words:
            raise PromiseError(f"reset does not forget: after another episode {words}")
    return ""


def moving_ego(subject: Subject) -> str:
    """Refuse a tracker that loses a parked car while the ego drives."""
    place = np.array([[30.0, 4.0, 0.75]])
    with subject.started() as instance:
        for k in range(FRAMES):
            pose = Pose.planar(1.0 * k, 0.0, 0.02 * k)
            detections = cars(pose.inverse().apply(place)[:, :2], k * PERIOD_S)
            tracks = update(instance, TrackerInput(detections, pose))
    world = tracks if tracks.frame == "world" else tracks.moved(pose, "world")
    distances_m = np.hypot(*(world.centres[:, :2] - place[:, :2]).T)
    if not (distances_m < NEAR_M).any():
        nearest = f"{distances_m.min():.1f} m away" if len(distances_m) else "not there"
        raise PromiseError(
            f"a parked car passed at 10 m/s has its track {nearest}, in frame '{tracks.frame}'; "
            "ego_pose is world_from_ego, and detections come in the ego frame"
        )
    return ""


def compare(subject: Subject) -> str:
    """Track two seconds of perfect detections; refuse a tracker near the lower mark."""
    tracks = track(subject.spec, true_boxes(), options=subject.options)
    if not any(map(len, tracks.tracks)):
        raise PromiseError("two seconds of a motorway with perfect detections: there is no track")
    hota, beside = _hota(tracks), _standards()
    words = figure_in_words("HOTA on perfect detections of a motorway", hota, beside=beside)
    if hota < LEAST_OF_UNLINKED * beside[UNLINKED]:
        raise PromiseError(
            f"{words}: ids do not stay with objects; the row of a detection is no identity"
        )
    return words


@cache
def true_boxes() -> EpisodeDetections:
    """Return the true boxes of the scene, in random order in every frame."""
    rng = np.random.default_rng(2)
    boxes = DetectionNode(detection_source("oracle"), SCENE, RULE).compute(RunOptions())
    mixed = tuple(each.select(rng.permutation(len(each))) for each in boxes.detections)
    return replace(boxes, detections=mixed)


@cache
def _standards() -> dict[str, float]:
    """Return the HOTA of `REFERENCE` and of `UNLINKED`."""
    reference = track(TRACKER.registry.resolve(REFERENCE), true_boxes())
    boxes = true_boxes().detections
    ends = np.cumsum([len(each) for each in boxes])
    tracks = tuple(
        Tracks.of(each, np.arange(end - len(each), end))
        for each, end in zip(boxes, ends, strict=True)
    )
    unlinked = EpisodeTracks(tracks, CallTimes.zero(len(tracks)))
    return {REFERENCE: _hota(reference), UNLINKED: _hota(unlinked)}


def _hota(tracks: EpisodeTracks) -> float:
    return float(np.nan_to_num(tracking_scores(tracks, true_boxes(), RULE)["hota"].value))


def difference(expected: Sequence[Tracks], answered: Sequence[Tracks]) -> str:
    """Return how and when two runs differ, apart from the values of ids; empty if they do not."""
    id_map: dict[int, int] = {}
    for one, other in zip(expected, answered, strict=True):
        when = f"at {one.stamp_s:.1f} s"
        if len(one) != len(other):
            return f"there are {len(other)} tracks instead of {len(one)} {when}"
        first, second = _by_place(one), _by_place(other)
        for field in FIELDS:
            if not np.allclose(getattr(one, field)[first], getattr(other, field)[second]):
                return f"the {field} of tracks differ {when}"
        for a, b in zip(one.ids[first].tolist(), other.ids[second].tolist(), strict=True):
            if id_map.setdefault(a, b) != b:
                return f"identities are mixed up {when}"
    return "" if len(set(id_map.values())) == len(id_map) else "two tracks become one"


def repeated_ids(
    earlier: Sequence[Tracks], *, expected: Sequence[Tracks], answered: Sequence[Tracks]
) -> str:
    """Return which id of an earlier episode comes back; empty if none does.

    Ids may begin again, and are then those of a fresh instance, or continue with new ones.
    """
    if all(a == b for a, b in _renamed(expected, answered)):
        return ""
    earlier_ids = {identity for tracks in earlier for identity in tracks.ids.tolist()}
    for tracks in answered:
        if back := earlier_ids.intersection(tracks.ids.tolist()):
            return f"its id {min(back)} comes back at {tracks.stamp_s:.1f} s"
    return ""


def in_order(expected: Sequence[Tracks], answered: Sequence[Tracks]) -> bool:
    """Return whether the ids of two runs that are otherwise equal have the same order."""
    second = [b for _, b in sorted(_renamed(expected, answered))]
    return second == sorted(second)


def _renamed(expected: Sequence[Tracks], answered: Sequence[Tracks]) -> set[tuple[int, int]]:
    """Return the pair of ids of each track in two runs that are otherwise equal."""
    return {
        names
        for one, other in zip(expected, answered, strict=True)
        for names in zip(
            one.ids[_by_place(one)].tolist(), other.ids[_by_place(other)].tolist(), strict=True
        )
    }


def _by_place(tracks: Tracks) -> np.ndarray:
    return np.lexsort(np.round(tracks.centres.T, 6))


# --------------------------------------------------------------------------------------------------
# Offline trackers, whose `rescored` gets the tracks of a whole episode


def rescore(instance: Instance, history: Sequence[Tracks]) -> tuple[Tracks, ...]:
    """Return the tracks that `rescored` answers for the history of an episode."""
    return check_rescored(
        instance.call("rescored", tuple(history)),
        stamps_s=[tracks.stamp_s for tracks in history],
        posed=[tracks.frame == "world" for tracks in history],
    )


def has_rescored(subject: Subject) -> str:
    """Refuse a class without the method."""
    if "rescored" not in subject.traits.methods:
        raise PromiseError("there is no method rescored; the contract has def rescored(history)")
    return ""


def same_moments(subject: Subject) -> str:
    """Rescore episodes with the ego's pose, without, and one without frames."""
    for ticks in (parallel_cars(), parallel_cars(posed=True), []):
        with subject.started() as instance:
            rescore(instance, update_all(instance, ticks))
    return ""


def history_left_alone(subject: Subject) -> str:
    """Refuse a `rescored` that changes the tracks in its history."""
    with subject.started(watch_arguments=True) as instance:
        rescore(instance, update_all(instance, parallel_cars(posed=True)))
    return ""


def rescores_alike(subject: Subject) -> str:
    """Refuse a `rescored` that answers the same history differently the second time."""
    with subject.started() as instance:
        history = update_all(instance, parallel_cars(posed=True))
        once, twice = (rescore(instance, history) for _ in range(2))
    if words := difference(once, twice):
        raise PromiseError(f"the same history gives other tracks the second time: {words}")
    return ""


def update_goes_on(subject: Subject) -> str:
    """Refuse a `rescored` that changes what `update` answers next."""
    ticks, runs = parallel_cars(), []
    next_tick = TrackerInput(cars(ticks[-1].detections.centres[:, :2], FRAMES * PERIOD_S))
    for rescored in (False, True):
        with subject.started() as instance:
            history = update_all(instance, ticks)
            if rescored:
                rescore(instance, history)
            runs.append([*history, update(instance, next_tick)])
    if words := difference(*runs):
        raise PromiseError(f"rescored changes what update answers next: {words}")
    return ""


PROMISES = (
    *start_promises("update", "detections, ego_pose"),
    Promise("answers with tracks of the same moment", answers),
    Promise("goes on in frames without detections", no_detections),
    Promise("never uses an id again", unique_ids),
    Promise("keeps the id of an object", one_id),
    Promise("does not depend on the order of detections", order),
    input_promise(lambda instance: update_all(instance, parallel_cars(posed=True))),
    Promise("gives the same tracks for the same input", repeats),
    Promise("forgets everything at a reset", forgets),
    Promise("tracks a parked car while the ego moves", moving_ego),
    Promise("tracks two seconds of traffic", compare),
)
OFFLINE_PROMISES = (
    Promise("has rescored, because it is offline", has_rescored),
    Promise("rescores every frame at its moment", same_moments),
    Promise("leaves the history alone", history_left_alone),
    Promise("rescores the same history in the same way", rescores_alike),
    Promise("updates as before after rescored was called", update_goes_on),
)
"""More promises of offline trackers, about `rescored`."""
