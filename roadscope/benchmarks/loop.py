"""The one loop that runs a plug-in over an episode; only its own calls are timed."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from roadscope.benchmarks.isolation import (
    Limits,
    PluginError,
    PluginHandle,
    Timed,
    open_plugin,
    probing,
)
from roadscope.benchmarks.kinds import Kind
from roadscope.benchmarks.records import CallTimes
from roadscope.core import Spec
from roadscope.core.answers import AnswerError

A = TypeVar("A")
C = TypeVar("C")

_warm: set[Spec] = set()
"""Specs of ours that were called in this process."""


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How a run treats plug-ins.

    limits: of one that is isolated.
    trust: run every plug-in inside the run's own process, for debugging.
    sandbox: isolate it from files and the network too, by bubblewrap.
    hidden: folders that look empty in the sandbox, beside that of the cache.
    fresh: compute again what an earlier run has kept.
    """

    limits: Limits = field(default_factory=Limits)
    trust: bool = False
    sandbox: bool = False
    fresh: bool = False
    hidden: tuple[Path, ...] = ()

    def probing(self) -> AbstractContextManager[None]:
        """Treat classes so, too, that are loaded to see what they say of themselves."""
        return probing(self.limits, sandbox=self.sandbox, trust=self.trust)


@dataclass(frozen=True, slots=True)
class CallInput(Generic[C]):
    """One moment of an episode, as a plug-in gets it.

    arguments: of the call.
    context: what the harness needs to check and place the answer; the plug-in never gets it.
    call: False where there is nothing to be answered, so that the plug-in is not called.
    wheels: wheel speeds that an odometry gets before the scan, if it takes them.
    """

    arguments: tuple[Any, ...]
    context: C
    call: bool = True
    wheels: Any = None


@dataclass(frozen=True, slots=True)
class Replies(Generic[C, A]):
    """A plug-in's answers to T moments.

    answers: as `check` returned them; None where the plug-in was not called.
    times: of the calls, 0 where there was none.
    last: what `finish` returned.
    """

    contexts: tuple[C, ...]
    answers: tuple[A | None, ...]
    times: CallTimes
    last: Any = None


def run_plugin(
    spec: Spec,
    kind: Kind,
    ticks: Iterable[CallInput[C]],
    check: Callable[[Any, CallInput[C]], A],
    *,
    reset: Sequence[Any] = (),
    finish: Callable[[PluginHandle], Timed] | None = None,
    options: RunOptions | None = None,
) -> Replies[C, A]:
    """Run a plug-in over the moments of an episode; whatever it does wrong raises `PluginError`.

    check: returns the checked answer or raises `AnswerError`.
    reset: arguments of `reset`.
    finish: is called with the plug-in after the last moment.
    """
    options = options or RunOptions()
    isolated = spec.isolated and not options.trust
    if not isolated and spec.ours:
        ticks = _warmed_up(spec, kind, iter(ticks), reset)
    contexts: list[C] = []
    answers: list[A | None] = []
    processor_ms: list[float] = []
    wall_ms: list[float] = []
    with open_plugin(
        spec.plain,
        limits=options.limits,
        isolated=isolated,
        sandbox=options.sandbox,
        hidden=options.hidden,
    ) as plugin:
        plugin.call("reset", *reset)
        for tick in ticks:
            reply = _ask(spec, kind, plugin, tick, check) if tick.call else Timed(None, 0.0, 0.0)
            contexts.append(tick.context)
            answers.append(reply.answer)
            processor_ms.append(reply.processor_ms)
            wall_ms.append(reply.wall_ms)
        last = finish(plugin) if finish is not None else Timed(None, 0.0, 0.0)
    times = CallTimes(np.array(processor_ms), np.array(wall_ms))
    share = max(len(contexts), 1)
    return Replies(
        tuple(contexts),
        tuple(answers),
        times.shifted(last.processor_ms / share, last.wall_ms / share),
        last.answer,
    )


def _ask(
    spec: Spec,
    kind: Kind,
    plugin: PluginHandle,
    tick: CallInput[C],
    check: Callable[[Any, CallInput[C]], A],
) -> Timed:
    """Call a plug-in and check its answer."""
    before = Timed(None, 0.0, 0.0)
    with warnings.catch_warnings():
        # What a plug-in warns of, such as a black image, is not the reader's concern.
        warnings.simplefilter("ignore")
        if tick.wheels is not None and plugin.traits.takes_wheels:
            before = plugin.call("add_wheels", tick.wheels)
        reply = plugin.call(kind.method, *tick.arguments)
    try:
        answer = check(reply.answer, tick)
    except AnswerError as error:
        raise PluginError(str(spec.plain), str(error), plugin.log) from error
    return Timed(answer, before.processor_ms + reply.processor_ms, before.wall_ms + reply.wall_ms)


def _warmed_up(
    spec: Spec, kind: Kind, ticks: Iterator[CallInput[C]], reset: Sequence[Any]
) -> Iterator[CallInput[C]]:
    """Call a throw-away instance of ours with the first inputs, then yield all inputs.

    Ours compile when they are first called, and no timed call shall include that. It is done once
    in a process, and again in later episodes until one answer is not empty. Plug-ins that are not
    ours get no warm-up; their first call is left out of their times.
    """
    if spec in _warm or not kind.warm_calls:
        return ticks
    first = list(islice(ticks, kind.warm_calls))
    answered = False
    with open_plugin(spec.plain, isolated=False) as plugin, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        plugin.call("reset", *reset)
        for tick in (tick for tick in first if tick.call):
            if tick.wheels is not None and plugin.traits.takes_wheels:
                plugin.call("add_wheels", tick.wheels)
            answer = plugin.call(kind.method, *_copied(tick.arguments)).answer
            answered |= not hasattr(answer, "__len__") or len(answer) > 0
    if answered:
        _warm.add(spec)
    return chain(first, ticks)


def _copied(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    from copy import deepcopy

    return deepcopy(arguments)
