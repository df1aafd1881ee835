"""Limits of plug-ins, their errors, and the records of their calls and traits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from roadscope.core.text import last_lines, one_line

MOST_LOG_CHARACTERS = 4000
"""Longest log of an error, chosen by hand: the end of a traceback and some lines before it."""


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of a plug-in in a process of its own.

    first_call_s: for loading and making it, and for the first call of each method, which may load
        weights and compile.
    call_s: for each later call.
    episode_s: for all calls of an episode together, loading included.
    memory_gb: resident memory of its process and of all that it started, 10^9 bytes.
    answer_mb: size of an answer, 10^6 bytes.
    output_mb: size of its output, 10^6 bytes.
    """

    first_call_s: float = 120.0
    call_s: float = 30.0
    episode_s: float = 300.0
    memory_gb: float = 8.0
    answer_mb: float = 64.0
    output_mb: float = 16.0


class PluginError(RuntimeError):
    """A plug-in failed; the text is one line that begins with its spec.

    spec: of the plug-in. log: the end of what it printed, at most 4,000 characters.
    mistake: whether the user named a plug-in that does not exist or cannot be imported.
    """

    def __init__(self, spec: str, reason: str, log: str = "", *, mistake: bool = False) -> None:
        """Take the plug-in's spec, the reason, and what it printed."""
        super().__init__(one_line(f"{spec}: {reason}"))
        self.spec, self.log = spec, last_lines(log, MOST_LOG_CHARACTERS)
        self.mistake = mistake

    def __reduce__(self) -> tuple[Any, ...]:
        """Support pickling, as errors are sent from workers to the process that started them."""
        return PluginError.__new__, (PluginError, str(self)), vars(self)


class SandboxError(RuntimeError):
    """The sandbox cannot be used here; the text says why."""


@dataclass(frozen=True, slots=True)
class Timed:
    """An answer of a plug-in and the time of its call.

    processor_ms: processor time of its process, all threads together.
    wall_ms: elapsed time.
    """

    answer: Any
    processor_ms: float
    wall_ms: float


@dataclass(frozen=True, slots=True)
class Traits:
    """The traits of a plug-in's class that the benchmark uses.

    file: that it was loaded from, or None. methods: its public methods.
    kind: the kind that it declares, or "".
    offline, weighed, takes_imu, takes_wheels: see the protocols of trackers and odometries.
    requires: the distribution that it needs and that is not installed, as text, or "".
    parameters: the defaults of the constructor's parameters as text, by name; "" without one.
    positional: the parameters that can be given by position.
    problem: why the constructor does not take the arguments, or "".
    failure: why the class cannot be loaded, or ""; then the traits are read from its source.
    """

    file: Path | None
    methods: frozenset[str]
    kind: str
    offline: bool = False
    weighed: bool = False
    takes_imu: bool = True
    takes_wheels: bool = False
    requires: str = ""
    parameters: Mapping[str, str] = field(default_factory=dict)
    positional: tuple[str, ...] = ()
    problem: str = ""
    failure: str = ""
