"""The plug-in under test, and the form of a promise."""

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
from roadscope.core import Spec

DEADLINE_S = 120.0
"""Seconds for one promise; chosen by hand: plug-ins that compile or load weights do so in every
process."""
GRACE_S = 1.0
"""Seconds by which all calls together may exceed the deadline, so that the error names the call
that hangs."""


class PromiseError(AssertionError):
    """A plug-in breaks a promise; the message says how."""


class Subject:
    """A plug-in under test.

    spec: its resolved spec. logs: what it printed, two texts for each time that it was opened.
    deadline_s: most seconds for loading it and for all its calls, if it runs in a process of its
        own. spent_s: how much of that it has used.
    """

    def __init__(
        self,
        spec: Spec,
        kind: Kind,
        *,
        deadline_s: float = DEADLINE_S,
        trust: bool = False,
        sandbox: bool = False,
    ) -> None:
        """Take the plug-in; trust: whether it runs in this process in any case."""
        self.spec, self.kind, self.deadline_s = spec, kind, deadline_s
        self._trust, self._sandbox = trust, sandbox
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
        """What the benchmark reads from its class."""
        return traits_of(self.spec)

    @property
    def options(self) -> RunOptions:
        """The options with which the benchmark runs it."""
        left_s = max(self.deadline_s - self.spent_s, 0.0)
        limits = Limits(first_call_s=left_s, call_s=left_s, episode_s=left_s + GRACE_S)
        return RunOptions(limits=limits, trust=self._trust, sandbox=self._sandbox, fresh=True)

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
            sandbox=self._sandbox,
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
        """Make an instance and reset it, as the benchmark does. reset: arguments of `reset`."""
        with self.opened(watch_arguments=watch_arguments) as instance:
            instance.call("reset", *reset)
            yield instance


class Instance:
    """An instance of a plug-in under test."""

    def __init__(self, subject: Subject, handle: PluginHandle) -> None:
        """Take the plug-in and the handle that calls it."""
        self._subject, self._handle = subject, handle

    def call(self, method: str, *arguments: Any) -> Any:
        """Return the unchecked answer of a method; it gets copies of the arguments."""
        copied = arguments if self._subject.isolated else deepcopy(arguments)
        start_s = monotonic()
        try:
            with warnings.catch_warnings():
                # Warnings, such as of a black image, are no breach of the contract.
                warnings.simplefilter("ignore")
                return self._handle.call(method, *copied).answer
        finally:
            self._subject.spent_s += monotonic() - start_s


@dataclass(frozen=True, slots=True)
class Promise:
    """One promise of all plug-ins of a kind.

    words: the promise, as a sentence whose subject is the plug-in.
    verify: returns a remark; raises `PromiseError`, or what the plug-in's calls and the validators
        of `core.answers` raise.
    """

    words: str
    verify: Callable[[Subject], str]
