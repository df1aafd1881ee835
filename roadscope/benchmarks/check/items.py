"""One thing that a plug-in promises, and what is said of it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

from roadscope.benchmarks.jobs.stack import guarded
from roadscope.core.registry import Plugin

TWO_SECONDS = ("motorway", 0, "lux", 2.0)
"""The scene: traffic, one of the training seeds, sensors, length."""


class PromiseError(RuntimeError):
    """A plug-in breaks its promise; the message says in plain words how."""


@dataclass(frozen=True, slots=True)
class Item:
    """What came of one promise.

    words: what is wrong, or a remark.
    times: how many promises it stands for.
    """

    promise: str
    good: bool
    words: str = ""
    times: int = 1


Look = Callable[[Plugin[Any]], str]
"""Takes a plug-in, makes instances of it, returns a remark or raises `PromiseError`."""

Tell = Callable[[Plugin[Any], Any], object]
"""Takes a plug-in and an instance, returns what that makes of a whole scene."""


@dataclass(frozen=True, slots=True)
class Promise:
    """A promise and how it is looked at.

    ready: makes what of ours is looked at with; the time it takes is not the plug-in's.
    """

    words: str
    look: Look
    ready: Callable[[], object] | None = None


@cache
def traffic_ready() -> None:
    """Drive, sense and score the two-second scene without the plug-in, which compiles our part."""
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.oracle import ORACLE
    from roadscope.benchmarks.single import run_episode

    run_episode(Episode(*TWO_SECONDS), detector=ORACLE, tracker="nearest")


def made_by_name(plugin: Plugin[Any]) -> str:
    """Refuse constructors that a name alone does not satisfy."""
    given = []
    for parameter in inspect.signature(plugin.factory).parameters.values():
        if parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
            continue
        if parameter.default is parameter.empty:
            raise PromiseError(
                f"the constructor's argument '{parameter.name}' has no default; give it one, "
                "so that the name alone makes it"
            )
        if parameter.kind is not parameter.KEYWORD_ONLY:
            raise PromiseError(
                f"the constructor's argument '{parameter.name}' can be given by position; put * "
                f"before it: def __init__(self, *, {parameter.name}={parameter.default!r})"
            )
        given.append(parameter.name)
    plugin.make()
    return f"arguments: {', '.join(given)}" if given else ""


def begun(plugin: Plugin[Any]) -> Any:
    """Make a plug-in and reset it, as the benchmark does."""
    made = plugin.make()
    guarded(plugin.spec, made.reset)
    return made


def begins(method: str, look: Look) -> tuple[Promise, Promise]:
    """Return what every plug-in promises first.

    look: whether it has reset and the method.
    """
    return Promise("made by its name alone", made_by_name), Promise(f"has reset and {method}", look)


def having(method: str, *arguments: str) -> Look:
    """Look for reset and the method."""

    def look(plugin: Plugin[Any]) -> str:
        has_method(plugin, "reset")
        has_method(plugin, method, *arguments)
        return ""

    return look


def leaving_alone(
    call: Callable[[Plugin[Any], Any, Any], object], scene: Callable[[], Iterable[Any]], words: str
) -> Promise:
    """Promise that no part of a scene is changed by a call with it; parts are copied before."""

    def look(plugin: Plugin[Any]) -> str:
        made = begun(plugin)
        for part in scene():
            left_alone(partial(call, plugin, made), deepcopy(part), words)
        return ""

    return Promise("leaves its input alone", look)


def settled(tell: Tell, given: str, answers: str) -> tuple[Promise, Promise]:
    """Promise that answers depend on nothing but what came since the last reset."""
    return (
        Promise(f"the same {given} give the same {answers}", repeating(tell, given, answers)),
        Promise("reset forgets everything", forgetting(tell, given, answers)),
    )


def repeating(tell: Tell, given: str, answers: str) -> Look:
    """Look at whether the same scene gives the same answers to another instance."""

    def look(plugin: Plugin[Any]) -> str:
        if tell(plugin, begun(plugin)) != tell(plugin, begun(plugin)):
            raise PromiseError(f"the same {given} give other {answers} the second time")
        return ""

    return look


def forgetting(tell: Tell, given: str, answers: str) -> Look:
    """Look at whether anything of a scene is left after reset."""

    def look(plugin: Plugin[Any]) -> str:
        made = begun(plugin)
        expected = tell(plugin, made)
        guarded(plugin.spec, made.reset)
        if tell(plugin, made) != expected:
            raise PromiseError(
                f"reset does not forget: the same {given} after it give other {answers}"
            )
        return ""

    return look


def left_alone(call: Callable[[Any], object], given: Any, words: str) -> None:
    """Refuse a call that changes what it is given."""
    before = deepcopy(given)
    call(given)
    if given != before:
        raise PromiseError(f"{words}; copy first")


def has_method(plugin: Plugin[Any], name: str, *arguments: str) -> None:
    """Refuse a class without a method that can be called so."""
    method = getattr(plugin.factory, name, None)
    wanted = f"def {name}({', '.join(('self', *arguments))})"
    if not callable(method):
        raise PromiseError(f"there is no method {name}; the contract has {wanted}")
    try:
        inspect.signature(method).bind(None, *arguments)
    except TypeError as error:
        raise PromiseError(
            f"{name} cannot be called as the contract does, {wanted}: {error}"
        ) from None
