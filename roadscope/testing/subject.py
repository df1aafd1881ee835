"""The plug-in under test, and one promise of it."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout
from copy import deepcopy
from dataclasses import dataclass
from time import monotonic
from typing import Any

from roadscope.benchmarks.isolation import Limits, PluginHandle, Traits, open_plugin
from roadscope.benchmarks.kinds import Kind, traits_of
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.references import NAMED_BY_SUITES
from roadscope.core import Spec

DEADLINE_S = 120.0
"""Of one promise; chosen by hand: what compiles or loads weights does so in every process."""
GRACE_S = 1.0
"""By how much all calls together may exceed it, so that one call that hangs is named."""


def resolved(spec: str | Spec, kind: Kind) -> Spec:
    """Return the resolved spec of a plug-in, of a detector that only suites name too."""
    parsed = Spec.parse(spec) if isinstance(spec, str) else spec
    registry = NAMED_BY_SUITES if parsed.name in NAMED_BY_SUITES else kind.registry
    return registry.resolve(parsed)


class PromiseError(AssertionError):
    """A plug-in breaks a promise; the message says how."""


class Subject:
    """A plug-in under test.

    spec: resolved. logs: what it printed, one text for each time that it was opened.
    deadline_s: for loading it and all its calls; only a plug-in in its own process has one.
    spent_s: how much of that it has used.
    """

    def __init__(
        self, spec: Spec, kind: Kind, *, deadline_s: float = DEADLINE_S, trust: bool = False
    ) -> None:
        """Take the plug-in; trust: run it in this process."""
        self.spec, self.kind, self.deadline_s, self._trust = spec, kind, deadline_s, trust
        self.logs: list[str] = []
        self.spent_s = 0.0

    @property
    def isolated(self) -> bool:
        """Whether it runs in a process of its own."""
        return self.spec.isolated and not self._trust

    @property
    def hangs(self) -> bool:
        """Whether it has used up its deadline."""
        return self.isolated and self.spent_s >= self.deadline_s

    @property
    def traits(self) -> Traits:
        """What its class says of itself."""
        return traits_of(self.spec)

    @property
    def options(self) -> RunOptions:
        """How the benchmark runs it."""
        left_s = max(self.deadline_s - self.spent_s, 0.0)
        limits = Limits(first_call_s=left_s, call_s=left_s, episode_s=left_s + GRACE_S)
        return RunOptions(limits=limits, trust=self._trust, fresh=True)

    @contextmanager
    def opened(self, *, watch_arguments: bool = False) -> Iterator[Instance]:
        """Make an instance, and end it afterwards.

        watch_arguments: whether a call that changes its arguments fails.
        """
        printed, start_s = io.StringIO(), monotonic()
        opening = open_plugin(
            self.spec,
            limits=self.options.limits,
            isolated=self.isolated,
            watch_arguments=watch_arguments,
        )
        handle: PluginHandle | None = None
        try:
            with redirect_stdout(printed), ExitStack() as stack:
                try:
                    handle = stack.enter_context(opening)
                finally:
                    self.spent_s += monotonic() - start_s
                yield Instance(self, handle)
        finally:
            self.logs += [handle.log if handle else "", printed.getvalue()]

    @contextmanager
    def started(self, *reset: Any, watch_arguments: bool = False) -> Iterator[Instance]:
        """Make an instance and reset it, as the benchmark does; reset: arguments of that."""
        with self.opened(watch_arguments=watch_arguments) as instance:
            instance.call("reset", *reset)
            yield instance


class Instance:
    """An instance of a plug-in under test."""

    def __init__(self, subject: Subject, handle: PluginHandle) -> None:
        """Take the plug-in and what calls it."""
        self._subject, self._handle = subject, handle

    def call(self, method: str, *arguments: Any) -> Any:
        """Return the answer of a method, unchecked; what it does with its arguments is its own."""
        copied = arguments if self._subject.isolated else deepcopy(arguments)
        start_s = monotonic()
        try:
            with warnings.catch_warnings():
                # What a plug-in warns of, such as a black image, is no matter of its contract.
                warnings.simplefilter("ignore")
                return self._handle.call(method, *copied).answer
        finally:
            self._subject.spent_s += monotonic() - start_s


@dataclass(frozen=True, slots=True)
class Promise:
    """One promise of all plug-ins of a kind.

    words: what is promised.
    verify: returns a remark, or raises `PromiseError`, or whatever the plug-in's calls and the
        validators of `core.answers` raise.
    """

    words: str
    verify: Callable[[Subject], str]
