"""Calls of methods that must not change their arguments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from roadscope.core.wire import WireError, encode


class ChangedArgumentError(RuntimeError):
    """A method changed an argument of its call; the message says which."""


def call_watched(function: Callable[..., Any], arguments: Sequence[Any]) -> Any:
    """Call a function and return its answer; `ChangedArgumentError` if it changed an argument.

    It must run in the process of the function, as other processes get copies of the arguments.
    """
    before = [encode(argument) for argument in arguments]
    answer = function(*arguments)
    for number, (argument, expected) in enumerate(zip(arguments, before, strict=True), start=1):
        if _encoded(argument) != expected:
            name = getattr(function, "__name__", "the call")
            raise ChangedArgumentError(f"{name} changed its argument {number}; copy it first")
    return answer


def _encoded(argument: Any) -> bytes:
    try:
        return encode(argument)
    except WireError:
        # It could be encoded before the call, so it was changed.
        return b""
