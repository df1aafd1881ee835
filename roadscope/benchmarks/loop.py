"""The one loop that runs a plug-in over an episode; only its own calls are timed."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from copy import deepcopy
from dataclasses import dataclass, field, replace
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
from roadscope.core import Detections, ImageDetections, Spec
from roadscope.core.answers import (
    AnswerError,
    check_command,
    check_detections,
    check_estimate,
    check_fused,
    check_image_detections,
    check_masses,
    check_tracks,
)
from roadscope.core.fused import FusedDetections

A = TypeVar("A")
C = TypeVar("C")

NO_CALL = Timed(None, 0.0, 0.0)
"""The reply where no call was made."""
_warm_specs: set[Spec] = set()
"""Specs of our plug-ins that were warmed up in this process."""


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How a run treats plug-ins.

    limits: of time and memory, for a plug-in in a process of its own.
    trust: run every plug-in inside the run's own process, for debugging.
    sandbox: hide network, cache, results and recorded data from plug-ins, and let them write no
        file.
    fresh: compute again what an earlier run has computed.
    hidden: folders that look empty in the sandbox, beside that of the cache.
    data: folders of recorded data, of which plug-ins in the sandbox can read nothing.
    """

    limits: Limits = field(default_factory=Limits)
    trust: bool = False
    sandbox: bool = False
    fresh: bool = False
    hidden: tuple[Path, ...] = ()
    data: tuple[Path, ...] = ()

    def probing(self) -> AbstractContextManager[None]:
        """Apply these options while classes are loaded to read their traits."""
        return probing(
            self.limits, sandbox=self.sandbox, trust=self.trust, hidden=self.hidden, data=self.data
        )


def open_with(options: RunOptions, spec: Spec) -> AbstractContextManager[PluginHandle]:
    """Make a resolved plug-in, in a process of its own unless it is ours or trusted."""
    return open_plugin(
        spec.plain,
        limits=options.limits,
        isolated=spec.isolated and not options.trust,
        sandbox=options.sandbox,
        hidden=options.hidden,
        data=options.data,
    )


@dataclass(frozen=True, slots=True)
class CallInput(Generic[C]):
    """The input of a plug-in at one moment of an episode.

    arguments: of the call.
    context: what the harness needs to check and use the answer; the plug-in never gets it.
    call: False if the plug-in is not called at this moment.
    wheels: wheel speeds that an odometry gets before the scan, if it uses them.
    """

    arguments: tuple[Any, ...]
    context: C
    call: bool = True
    wheels: Any = None


@dataclass(frozen=True, slots=True)
class Replies(Generic[C, A]):
    """A plug-in's answers to T moments.

    contexts: of the inputs.
    answers: as `check` returned them; None where the plug-in was not called.
    times: of the calls, 0 where there was none.
    last: the answer of `finish`.
    """

    contexts: tuple[C, ...]
    answers: tuple[A | None, ...]
    times: CallTimes
    last: Any = None


def run_plugin(
    spec: Spec,
    kind: Kind,
    inputs: Iterable[CallInput[C]],
    check: Callable[[Any, CallInput[C]], A] | None = None,
    *,
    reset: Sequence[Any] = (),
    finish: Callable[[PluginHandle], Timed] | None = None,
    options: RunOptions | None = None,
) -> Replies[C, A]:
    """Run a plug-in over the moments of an episode; raise `PluginError` if it fails.

    check: returns the checked answer or raises `AnswerError`; None: `AnswerCheck`, for our kinds.
    reset: arguments of `reset`.
    finish: called with the plug-in after the last moment; its time is shared among the calls.
    """
    options = options or RunOptions()
    check = check or AnswerCheck(kind.name)
    if spec.ours and (options.trust or not spec.isolated):
        inputs = _after_warm_up(spec, kind, iter(inputs), reset)
    contexts: list[C] = []
    answers: list[A | None] = []
    processor_ms: list[float] = []
    wall_ms: list[float] = []
    with open_with(options, spec) as plugin:
        plugin.call("reset", *reset)
        for call_input in inputs:
            reply = _call(plugin, kind, call_input)
            answer = checked(spec, check, reply.answer, call_input) if call_input.call else None
            answers.append(answer)
            contexts.append(call_input.context)
            processor_ms.append(reply.processor_ms)
            wall_ms.append(reply.wall_ms)
        last = finish(plugin) if finish is not None else NO_CALL
    moments = max(len(contexts), 1)
    times = CallTimes(np.array(processor_ms), np.array(wall_ms))
    times = times.shifted(last.processor_ms / moments, last.wall_ms / moments)
    return Replies(tuple(contexts), tuple(answers), times, last.answer)


class AnswerCheck:
    """Checks the answers of one plug-in to consecutive calls.

    kind: one of the names of `KINDS`; a kind that a board brings has a check of its own.
    """

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._stamps_s: list[float] = []
        self._mass_columns: set[int] = set()

    def __call__(self, answer: Any, call_input: CallInput[Any]) -> Any:
        """Return the answer to a call, or raise `AnswerError`."""
        first, *others = call_input.arguments
        if self._kind == "tracker":
            detected, ego_pose = first, others[0]
            return check_tracks(answer, stamp_s=detected.stamp_s, posed=ego_pose is not None)
        if self._kind == "odometry":
            scan = first
            return check_estimate(answer, stamp_s=scan.stamp_s, returns=len(scan))
        if self._kind == "driver":
            scene = first
            return check_command(answer, lanes=scene.lanes)
        return self._checked_detections(answer, first, others)

    def _checked_detections(self, answer: Any, first: Any, others: Sequence[Any]) -> Any:
        """Return the answer of a detector or fusion. first, others: arguments of the call."""
        detections: Detections | ImageDetections | FusedDetections
        if self._kind == "detector":
            self._stamps_s.append(first.stamp_s)
            detections = check_detections(answer, stamps_s=self._stamps_s)
        elif self._kind == "camera detector":
            detections = check_image_detections(answer, stamp_s=first.stamp_s)
        elif self._kind == "fusion":
            lidar, camera = first, others[0]
            sensed = camera if lidar is None else lidar
            detections = check_fused(answer, stamp_s=sensed.stamp_s)
        else:
            raise ValueError(f"the board has to check the answers of its kind, '{self._kind}'")
        check_masses(detections.masses, self._mass_columns)
        return detections


@contextmanager
def open_checked(
    spec: Spec,
    kind: Kind,
    check: Callable[[Any, CallInput[None]], Any] | None = None,
    *,
    reset: Sequence[Any] = (),
) -> Iterator[Callable[..., Any]]:
    """Start a plug-in and yield a function that calls it and returns its checked answer.

    The function takes the arguments of the call, and `wheels` as in `CallInput`. The calls have no
    time limit together, as recordings are of any length.

    check, reset: as in `run_plugin`.
    """
    check = check or AnswerCheck(kind.name)
    with open_plugin(spec.plain, limits=Limits(episode_s=float("inf"))) as plugin:
        plugin.call("reset", *reset)

        def answer(*arguments: Any, wheels: Any = None) -> Any:
            call_input = CallInput(arguments, None, wheels=wheels)
            return checked(spec, check, _call(plugin, kind, call_input).answer, call_input)

        yield answer


def checked(spec: Spec, check: Callable[..., A], *arguments: Any) -> A:
    """Call a check and return what it returns; its `AnswerError` is raised as `PluginError`."""
    try:
        return check(*arguments)
    except AnswerError as error:
        raise PluginError(str(spec.plain), str(error)) from error


def _call(plugin: PluginHandle, kind: Kind, call_input: CallInput[Any]) -> Timed:
    """Call a plug-in, unless the input says not to."""
    if not call_input.call:
        return NO_CALL
    wheels_reply = NO_CALL
    with warnings.catch_warnings():
        # Warnings of plug-ins, such as of a black image, are not shown to the reader.
        warnings.simplefilter("ignore")
        if call_input.wheels is not None and plugin.traits.takes_wheels:
            wheels_reply = plugin.call("add_wheels", call_input.wheels)
        reply = plugin.call(kind.method, *call_input.arguments)
    return Timed(
        reply.answer,
        wheels_reply.processor_ms + reply.processor_ms,
        wheels_reply.wall_ms + reply.wall_ms,
    )


def _after_warm_up(
    spec: Spec, kind: Kind, inputs: Iterator[CallInput[C]], reset: Sequence[Any]
) -> Iterator[CallInput[C]]:
    """Call a throw-away instance of our plug-in with the first inputs, then yield all inputs.

    Our plug-ins compile when they are first called, which must not count in the times of calls. The
    warm-up is done once in a process, and repeated in later episodes until an answer was not empty.
    Other plug-ins get none; their first call is left out of their times.
    """
    if spec in _warm_specs or not kind.warm_calls:
        return inputs
    first_inputs = list(islice(inputs, kind.warm_calls))
    answered = False
    with open_plugin(spec.plain, isolated=False) as plugin:
        plugin.call("reset", *reset)
        for call_input in first_inputs:
            # Copies: the plug-in that is timed gets these inputs too, unchanged.
            copied = replace(call_input, arguments=deepcopy(call_input.arguments))
            answer = _call(plugin, kind, copied).answer
            is_empty = hasattr(answer, "__len__") and len(answer) == 0
            answered |= call_input.call and not is_empty
    if answered:
        _warm_specs.add(spec)
    return chain(first_inputs, inputs)
