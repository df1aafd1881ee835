"""More promises of offline trackers, about `rescored`, which gets the tracks of a whole episode."""

from __future__ import annotations

from collections.abc import Sequence

from roadscope.core import Tracks
from roadscope.core.answers import check_rescored
from roadscope.testing.subject import Instance, Promise, PromiseError, Subject
from roadscope.testing.trackers import (
    FRAMES,
    PERIOD_S,
    TrackerInput,
    cars,
    difference,
    parallel_cars,
    update,
    update_all,
)


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


def repeats(subject: Subject) -> str:
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
    Promise("has rescored, because it is offline", has_rescored),
    Promise("rescores every frame at its moment", same_moments),
    Promise("leaves the history alone", history_left_alone),
    Promise("rescores the same history in the same way", repeats),
    Promise("updates as before after rescored was called", update_goes_on),
)
