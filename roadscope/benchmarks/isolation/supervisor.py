"""Runs in the supervisor, in the guards that it forks, and in the plug-ins' own processes.

A worker has one supervisor. It imports once what all plug-ins need and never has data of a suite;
for each plug-in it forks a guard, and the guard forks the plug-in's process. The guard watches
that process and ends it with all processes that it started. The plug-in can change anything in its
process, so the worker checks every answer.
"""

from __future__ import annotations

import ast
import ctypes
import faulthandler
import gc
import importlib
import os
import select
import signal
import socket
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, NamedTuple, NoReturn

import psutil

from roadscope.benchmarks.isolation.channel import (
    CLOSED,
    LENGTH_BYTES,
    LOG,
    ClosedError,
    receive_all,
    receive_exactly,
    send_all,
)
from roadscope.benchmarks.isolation.describing import (
    MISTAKE,
    ChangedArgumentError,
    call_watched,
    describe,
    may_preload,
    traits_of_class,
)
from roadscope.core.constructing import construct
from roadscope.core.loading import LoadingError, NotInstalledError, SpecError, load_class
from roadscope.core.text import one_line
from roadscope.core.wire import WireError, decode, encode

FILES = 3
"""Files that come with a request: the plug-in's socket and buffer, and the guard's socket."""
ENDED = b"E"
"""Answer to a request to end a plug-in."""
POLL_S = 0.1
"""Seconds from one measurement of memory to the next."""
POLL_SHARE = 0.05
"""Greatest share of a core that measuring may use, if there are very many processes."""
CLOSING_S = 1.0
"""Seconds that a process may take to end by itself once its socket is closed."""
ENDING_S = 5.0
"""Seconds that killed processes may take to disappear."""
LOG_BYTES = 16_000
"""Bytes of the end of the output that a guard keeps for the log; chosen by hand."""
LISTED = Path(f"/proc/self/task/{os.getpid()}/children").exists()
"""Whether the system lists the children of a process."""
MOST_PROCESSES = 1000
"""Most processes of a plug-in, chosen by hand: more than any library's pool has."""

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


def supervise(control: int) -> NoReturn:
    """Fork a guard, or end one, for every request on the socket, until that is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_SETMASK, [])
    control_process(CHILD_SUBREAPER, 1)
    worker = socket.socket(fileno=control)
    guards: dict[int, int] = {}
    """The number of the plug-in by the guard's process number."""
    orphans = False
    gc.collect()
    gc.freeze()
    poll = select.poll()
    poll.register(worker, select.POLLIN)
    while True:
        ready = poll.poll(POLL_S * 1e3 if guards or orphans else None)
        # The processes of a guard that was killed are now children of this process.
        orphans = (_reap_guards(guards) or orphans) and _end_orphans(guards)
        if not ready:
            continue
        try:
            request, files = _request(worker)
        except (ClosedError, OSError):
            break
        if request["end"]:
            _end_guard(guards, request["number"])
            with suppress(OSError):
                worker.sendall(ENDED)
            continue
        _preload(request["preload"])
        guard = os.fork()
        if guard == 0:
            worker.detach()
            os.close(control)
            _guard(request, *files)
        guards[guard] = request["number"]
        for file in files:
            os.close(file)
    _end_descendants()
    os._exit(0)


def _request(worker: socket.socket) -> tuple[Mapping[str, Any], list[int]]:
    head, files, _, _ = socket.recv_fds(worker, LENGTH_BYTES, FILES)
    if not head:
        raise ClosedError
    head += receive_exactly(worker, LENGTH_BYTES - len(head))
    data = receive_exactly(worker, int.from_bytes(head, "little"))
    return decode(data), files


def _preload(modules: Sequence[str]) -> None:
    """Import what earlier plug-ins imported, once for all later ones: torch takes seconds."""
    missing = [name for name in modules if name not in sys.modules]
    for name in missing:
        # An import that fails here fails in the plug-in's process too, where it is reported.
        with suppress(Exception):
            importlib.import_module(name)
    if missing:
        gc.collect()
        gc.freeze()


def _reap_guards(guards: dict[int, int]) -> bool:
    """Remove the guards that ended, and return whether one of them failed or was killed."""
    statuses = {process: status for process, status in _reap().items() if process in guards}
    for process in statuses:
        del guards[process]
    return any(statuses.values())


def _end_guard(guards: dict[int, int], number: int) -> None:
    """End a guard, and the processes below it, which become children of this one."""
    for guard in [process for process, plugin in guards.items() if plugin == number]:
        os.kill(guard, signal.SIGKILL)
    deadline = time.monotonic() + ENDING_S
    while time.monotonic() < deadline:
        _reap_guards(guards)
        if number not in guards.values() and not _end_orphans(guards):
            return
        time.sleep(0.001)


def _end_orphans(guards: Mapping[int, int]) -> bool:
    """End all children that are not guards, with theirs; return whether there were any."""
    orphans = [child for child in psutil.Process().children() if child.pid not in guards]
    for orphan in orphans:
        for process in [orphan, *_below(orphan)]:
            with suppress(psutil.Error):
                process.kill()
    return bool(orphans)


def _reap() -> dict[int, int]:
    """Return the exit status of each child that ended, by its number."""
    reaped = {}
    with suppress(ChildProcessError):
        while True:
            number, status = os.waitpid(-1, os.WNOHANG)
            if not number:
                break
            reaped[number] = status
    return reaped


def _end_descendants() -> None:
    """End all processes that descend from this one."""
    deadline = time.monotonic() + ENDING_S
    while time.monotonic() < deadline:
        _reap()
        left = _listed_below(os.getpid()) or _below(psutil.Process())
        if not left:
            return
        for process in left:
            with suppress(psutil.Error):
                process.kill()
        time.sleep(0.001)


def _below(process: psutil.Process) -> list[psutil.Process]:
    try:
        return list(process.children(recursive=True))
    except psutil.NoSuchProcess:
        return []


def _listed_below(number: int) -> list[psutil.Process]:
    """Return the processes below one as Linux lists them.

    This takes a tenth of the time of `_below`, but may miss some while others end.
    """
    processes = []
    for file in Path(f"/proc/{number}/task").glob("*/children"):
        with suppress(OSError):
            for child in map(int, file.read_text().split()):
                with suppress(psutil.Error):
                    processes.append(psutil.Process(child))
                processes += _listed_below(child)
    return processes


def _guard(request: Mapping[str, Any], data: int, buffer: int, watch: int) -> NoReturn:
    """Start the plug-in's process, watch it, and report to the worker how it ended."""
    try:
        os.setsid()
        control_process(CHILD_SUBREAPER, 1)
        output, written = os.pipe()
        plugin = os.fork()
        if plugin == 0:
            for file in (watch, output):
                os.close(file)
            run_plugin(request, connection=data, buffer=buffer, output=written)
        for file in (data, buffer, written):
            os.close(file)
        Guard(request, plugin, output=output, worker=socket.socket(fileno=watch)).watch()
    except BaseException:
        sys.excepthook(*sys.exc_info())
        with suppress(BaseException):
            _end_descendants()
        os._exit(1)
    os._exit(0)


class Guard:
    """Watches the process of one plug-in."""

    def __init__(
        self, request: Mapping[str, Any], plugin: int, *, output: int, worker: socket.socket
    ) -> None:
        """Take the limits, the process, the pipe of its output and the socket to the worker."""
        self._memory_bytes, self._output_bytes = request["memory_bytes"], request["output_bytes"]
        self._plugin, self._output, self._worker = plugin, output, worker
        self._log, self._written = b"", 0
        self._status: int | None = None
        self._next_measure = 0.0
        os.set_blocking(output, False)
        self._poll = select.poll()
        self._poll.register(worker, select.POLLIN)
        self._poll.register(output, select.POLLIN)
        if hasattr(os, "pidfd_open"):
            with suppress(OSError):
                self._poll.register(os.pidfd_open(plugin), select.POLLIN)

    def watch(self) -> None:
        """Watch until the plug-in has ended or must be ended; end it and report."""
        while True:
            ready = {number for number, _ in self._poll.poll(POLL_S * 1e3)}
            if self._output in ready and not self._read():
                self._poll.unregister(self._output)
            how = self._reason_to_end()
            if not how and self._worker.fileno() in ready:
                command = b""  # The worker has closed the socket.
                with suppress(OSError):
                    command = self._worker.recv(1)
                if command == LOG:
                    self._report("", ended=False)
                    continue
                if command == CLOSED:
                    how = self._closed()
                break
            if how:
                break
        with suppress(OSError):
            os.killpg(self._plugin, signal.SIGKILL)
        _end_descendants()
        with suppress(OSError):
            self._report(how, ended=True)

    def _reason_to_end(self) -> str:
        """Return why the plug-in must be ended or how it ended; empty while it may run."""
        if self._ended():
            return _status_in_words(self._status or 0)
        if self._written > self._output_bytes:
            return f"wrote more than {self._output_bytes / 1e6:g} MB of output"
        now = time.monotonic()
        if now >= self._next_measure:
            tree = _listed_below(os.getpid()) if LISTED else _below(psutil.Process())
            used = _used_bytes(tree, self._memory_bytes)
            if used > self._memory_bytes:
                most = self._memory_bytes / 1e9
                return f"used {used / 1e9:.2f} GB of memory, more than the {most:g} GB that it may"
            if len(tree) > MOST_PROCESSES:
                return f"started more than {MOST_PROCESSES} processes"
            after = time.monotonic()
            self._next_measure = after + max(POLL_S, (after - now) / POLL_SHARE)
        return ""

    def _ended(self) -> bool:
        if self._status is None:
            self._status = _reap().get(self._plugin)
        return self._status is not None

    def _closed(self) -> str:
        """Return how a process ended whose socket is closed."""
        deadline = time.monotonic() + CLOSING_S
        while not self._ended() and time.monotonic() < deadline:
            time.sleep(0.001)
        if self._status is None:
            return "closed its connection"
        return _status_in_words(self._status)

    def _read(self) -> bool:
        """Read output, store its end for the log, and return whether more may come."""
        try:
            piece = os.read(self._output, 1 << 16)
        except BlockingIOError:
            return True
        self._written += len(piece)
        self._log = (self._log + piece)[-LOG_BYTES:]
        return bool(piece)

    def _report(self, how: str, *, ended: bool) -> None:
        written = -1
        while written != self._written and self._written <= 2 * self._output_bytes:
            written = self._written
            self._read()
        log = self._log.decode(errors="backslashreplace")
        send_all(self._worker, encode({"ended": ended, "how": how, "log": log}))


def _used_bytes(tree: Sequence[psutil.Process], most: int) -> int:
    """Return the resident memory of processes; those that have ended do not count.

    Shared memory counts once, if the system reports it.
    """
    used = 0
    for process in tree:
        with suppress(psutil.Error):
            used += process.memory_info().rss
    if used <= most or len(tree) < 2:
        return used
    shares = 0
    for process in tree:
        with suppress(psutil.Error):
            full = process.memory_full_info()
            shares += getattr(full, "pss", None) or full.rss
    return shares


def _status_in_words(status: int) -> str:
    """Return how a process ended by the status that `os.waitpid` returned."""
    code = os.waitstatus_to_exitcode(status)
    if code >= 0:
        return f"ended its own process with exit status {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = str(-code)
    described = signal.strsignal(-code)
    return f"its process was ended by {name}" + (f" ({described.lower()})" if described else "")


# --------------------------------------------------------------------------------------------------
# The process of a plug-in


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
    import resource

    os.setsid()
    control_process(PARENT_DEATH_SIGNAL, signal.SIGKILL)
    for signal_number in signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP}:
        with suppress(OSError, ValueError):
            signal.signal(signal_number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_SETMASK, [])
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # If memory runs out before the limit is noticed, the kernel ends this process first.
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")
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
            plugin_class = load_class(request["target"])
        except LoadingError:
            raise
        except SpecError as error:
            return {MISTAKE: str(error)}
        texts = request["arguments"]
        arguments = {name: ast.literal_eval(text) for name, text in texts.items()}
        traits = traits_of_class(plugin_class, arguments)
        if request["make"]:
            if traits.problem:
                raise SpecError(traits.problem)
            if traits.requires:
                raise NotInstalledError(traits.requires)
            plugin = construct(plugin_class, arguments)
            traits = traits_of_class(plugin_class, arguments, plugin)
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
    worker: socket.socket, number: int, function: Callable[[], Any], *, most: int, clocks: Clocks
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
