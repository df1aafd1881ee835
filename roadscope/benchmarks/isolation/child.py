"""Runs in the process of one plug-in: loads its class, makes it and answers calls.

The plug-in can change anything here, so the worker checks every answer.
"""

from __future__ import annotations

import ast
import ctypes
import faulthandler
import importlib
import os
import signal
import socket
import sys
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, NamedTuple, NoReturn

from roadscope.benchmarks.isolation.arguments import ChangedArgumentError, call_watched
from roadscope.benchmarks.isolation.channel import receive_all, send_all
from roadscope.benchmarks.isolation.describing import (
    MISTAKE,
    describe,
    may_preload,
    traits_of,
)
from roadscope.core.constructing import construct
from roadscope.core.loading import LoadingError, NotInstalledError, SpecError, load_class
from roadscope.core.text import one_line
from roadscope.core.wire import WireError, decode, encode

CONNECTION, BUFFER = 3, 4
"""Numbers of the files that a plug-in's process has open beside stdin, stdout and stderr."""
FREE_NUMBER = 10
"""Files are first moved to numbers from this one on, so that 0 to 4 are free."""
MOST_PIECE_CHARACTERS = 1000
"""Longest piece of a traceback in the log; chosen by hand."""
PLAIN = (SpecError, ChangedArgumentError)
"""Errors with texts for the reader, to which no line of code is added."""
PARENT_DEATH_SIGNAL, CHILD_SUBREAPER = 1, 36
"""Numbers of PR_SET_PDEATHSIG and PR_SET_CHILD_SUBREAPER, from linux/prctl.h."""


def control_process(option: int, value: int) -> None:
    """Set an option of this process by `prctl`; without effect on other systems than Linux."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0)


def run_plugin(
    request: Mapping[str, Any], *, connection: int, buffer: int, output: int
) -> NoReturn:
    """Turn this fresh copy of the supervisor into the plug-in's process.

    connection, buffer, output: file numbers of the socket to the worker, of the file with long
        messages from it, and of the pipe for all output.
    """
    status = 1
    try:
        _reset_process()
        _use_files(connection=connection, buffer=buffer, output=output)
        with suppress(OSError):
            os.chdir(request["folder"])
        sys.path[:] = request["path"]
        with socket.socket(fileno=CONNECTION) as worker:
            _serve(request, worker)
        status = 0
    except BaseException:
        with suppress(BaseException):
            traceback.print_exc()
    finally:
        os._exit(status)


def _reset_process() -> None:
    """Drop the session, signal handlers and random state inherited from the supervisor."""
    os.setsid()
    control_process(PARENT_DEATH_SIGNAL, signal.SIGKILL)
    for signal_number in signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP}:
        with suppress(OSError, ValueError):
            signal.signal(signal_number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_SETMASK, [])
    _limit()
    if "numpy.random" in sys.modules:
        importlib.import_module("numpy.random").seed()


def _use_files(*, connection: int, buffer: int, output: int) -> None:
    """Close all other files, and give these their numbers."""
    import fcntl

    null = os.open(os.devnull, os.O_RDONLY)
    sources = [
        fcntl.fcntl(number, fcntl.F_DUPFD, FREE_NUMBER)
        for number in (null, output, output, connection, buffer)
    ]
    for number, source in enumerate(sources):
        os.dup2(source, number, inheritable=number < CONNECTION)
    os.closerange(BUFFER + 1, os.sysconf("SC_OPEN_MAX"))
    sys.stdin = open(0, closefd=False)  # noqa: SIM115
    sys.stdout, sys.stderr = (
        open(number, "w", buffering=1, errors="backslashreplace", closefd=False)  # noqa: SIM115
        for number in (1, 2)
    )
    # After a crash, the log has the line.
    faulthandler.enable()


def _limit() -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # If memory runs out before the limit is noticed, the kernel ends this process first.
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")


def _serve(request: Mapping[str, Any], worker: socket.socket) -> None:
    """Load the plug-in and answer calls until the worker closes the socket.

    The answer to loading is the traits of the class, or the user's mistake in naming it.
    """
    clocks = Clocks(perf_counter, process_time)
    most = request["answer_bytes"]
    plugin = None

    def load() -> dict[str, Any]:
        nonlocal plugin
        try:
            kind = load_class(request["target"])
        except LoadingError:
            raise
        except SpecError as error:
            return {MISTAKE: str(error)}
        texts = request["arguments"]
        arguments = {name: ast.literal_eval(text) for name, text in texts.items()}
        traits = traits_of(kind, arguments)
        if request["make"]:
            if traits.problem:
                raise SpecError(traits.problem)
            if traits.requires:
                raise NotInstalledError(traits.requires)
            plugin = construct(kind, arguments)
            traits = traits_of(kind, arguments, plugin)
        return asdict(traits) | {
            "file": None if traits.file is None else str(traits.file),
            "methods": sorted(traits.methods),
            "loaded": [name for name in list(sys.modules) if may_preload(name)],
        }

    if not _answer(worker, 0, load, most=most, clocks=clocks):
        return
    while True:
        call = decode(receive_all(worker, BUFFER))

        def run_call(call: Mapping[str, Any] = call) -> Any:
            method, arguments = getattr(plugin, call["method"]), call["arguments"]
            if request["watch_arguments"]:
                return call_watched(method, arguments)
            return method(*arguments)

        _answer(worker, call["number"], run_call, most=most, clocks=clocks)


class Clocks(NamedTuple):
    """Clocks, seconds, bound before the plug-in was loaded, which might replace them."""

    wall: Callable[[], float]
    processor: Callable[[], float]


def _answer(
    worker: socket.socket,
    number: int,
    function: Callable[[], Any],
    *,
    most: int,
    clocks: Clocks,
) -> bool:
    """Call a function, send its answer or its error, and return whether there was an answer."""
    error, answer = "", None
    wall_s, processor_s = clocks.wall(), clocks.processor()
    try:
        answer = function()
    except BaseException as raised:
        wall_s, processor_s = clocks.wall() - wall_s, clocks.processor() - processor_s
        error = one_line(_text(raised, plain=isinstance(raised, PLAIN)))
        with suppress(BaseException):
            pieces = traceback.format_exception(raised)
            sys.stderr.write("".join(piece[:MOST_PIECE_CHARACTERS] for piece in pieces))
    else:
        processor_s, wall_s = clocks.processor() - processor_s, clocks.wall() - wall_s
    header = {"number": number, "wall_ms": wall_s * 1e3, "processor_ms": processor_s * 1e3}
    if not error:
        try:
            message = encode(header | {"error": "", "answer": answer}, most_bytes=most)
        except BaseException as raised:
            error = f"its answer: {_text(raised, plain=isinstance(raised, WireError))}"
    if error:
        message = encode(header | {"error": error, "answer": None})
    for stream in (sys.stdout, sys.stderr):
        with suppress(BaseException):
            stream.flush()
    send_all(worker, message)
    return not error


def _text(raised: BaseException, *, plain: bool) -> str:
    """Return an exception as text; plain: only its own text, without type and line of code."""
    try:
        return str(raised) if plain else describe(raised)
    except BaseException:
        return "an exception that cannot be described"
