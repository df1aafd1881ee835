"""What an offline tracker promises beside, of the pass over an episode that is over."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from roadscope.benchmarks.check.items import Promise, PromiseError, begun, has_method, left_alone
from roadscope.benchmarks.check.trackers import (
    FRAMES,
    PERIOD_S,
    cars,
    detected,
    difference,
    sound,
    told,
    updated,
)
from roadscope.benchmarks.jobs.stack import guarded
from roadscope.core import Tracks
from roadscope.core.registry import Plugin


def method(plugin: Plugin[Any]) -> str:
    """Look for rescored."""
    has_method(plugin, "rescored", "history")
    return ""


def told_anew(plugin: Plugin[Any], tracker: Any, history: Sequence[Tracks]) -> list[Tracks]:
    """Call rescored; an answer that is not what the contract says is a fault."""
    anew = guarded(plugin.spec, tracker.rescored, tuple(history))
    if not isinstance(anew, Sequence):
        raise PromiseError(f"rescored returned {type(anew).__name__}, not a sequence of Tracks")
    if len(anew) != len(history):
        raise PromiseError(
            f"rescored returned {len(anew)} records for the {len(history)} of update; "
            "tell every frame, also those without tracks"
        )
    return [
        sound("rescored", tracks, before.stamp_s, posed=before.frame == "world")
        for tracks, before in zip(anew, history, strict=True)
    ]


def same_moments(plugin: Plugin[Any]) -> str:
    """Look at what comes back, of episodes with the ego's pose, without, and of none."""
    for posed in (False, True):
        tracker = begun(plugin)
        told_anew(plugin, tracker, told(plugin, tracker, list(cars(posed=posed))))
    told_anew(plugin, begun(plugin), [])
    return ""


def history_left_alone(plugin: Plugin[Any]) -> str:
    """Look at whether what update answered stays as it was."""
    tracker = begun(plugin)
    history = told(plugin, tracker, list(cars(posed=True)))
    call = partial(told_anew, plugin, tracker)
    left_alone(call, history, "rescored changed the tracks it was given")
    return ""


def repeats(plugin: Plugin[Any]) -> str:
    """Look at whether the same history gives the same tracks."""
    tracker = begun(plugin)
    history = told(plugin, tracker, list(cars(posed=True)))
    once, twice = (told_anew(plugin, tracker, history) for _ in range(2))
    if words := difference(once, twice):
        raise PromiseError(f"the same history is told in another way the second time: {words}")
    return ""


def update_goes_on(plugin: Plugin[Any]) -> str:
    """Look at whether update answers as if rescored had not been called."""
    episode, runs = list(cars()), []
    after = detected(episode[-1][0].centres[:, :2], FRAMES * PERIOD_S), None
    for late in (False, True):
        tracker = begun(plugin)
        history = told(plugin, tracker, episode)
        if late:
            told_anew(plugin, tracker, history)
        runs.append([*history, updated(plugin, tracker, after)])
    if words := difference(*runs):
        raise PromiseError(f"rescored changes what update answers next: {words}")
    return ""


PROMISES = (
    Promise("has rescored, being offline", method),
    Promise("tells the same moments anew", same_moments),
    Promise("leaves the history alone", history_left_alone),
    Promise("tells the same history in the same way", repeats),
    Promise("goes on as if nothing had been told anew", update_goes_on),
)
