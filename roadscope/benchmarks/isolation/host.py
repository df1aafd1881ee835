"""The worker's side: opens plug-ins, calls them and checks their answers.

A worker is a process of a run. Below it is one supervisor, which forks a guard for each plug-in;
the guard forks the plug-in's own process and reports how that ended (see `supervisor`).
"""

from __future__ import annotations

import atexit
import os
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, NoReturn, Protocol

import msgspec

from roadscope.benchmarks.isolation.channel import (
    CLOSED,
    END,
    LOG,
    Channel,
    ClosedError,
    TooLongError,
    framed,
    open_buffer,
)
from roadscope.benchmarks.isolation.describing import (
    MISTAKE,
    PACKAGE,
    ChangedArgumentError,
    call_watched,
    describe,
    may_preload,
    traits_of_class,
    traits_of_source,
)
from roadscope.benchmarks.isolation.limits import (
    MOST_LOG_CHARACTERS,
    Limits,
    PluginError,
    SandboxError,
    Timed,
    Traits,
)
from roadscope.benchmarks.isolation.sandbox import (
    folders_behind,
    needed_paths,
    sandbox_available,
    sandbox_command,
)
from roadscope.core.loading import LoadingError, SpecError, load_class
from roadscope.core.spec import Spec
from roadscope.core.text import last_lines, one_line
from roadscope.core.wire import WireError, decode, encode

ROOT = PACKAGE.parent
"""The folder that contains the package, for the import path of supervisors."""
RUN = (
    "import sys; sys.path[:] = sys.argv[2:]; "
    "from roadscope.benchmarks.isolation.supervisor import supervise; supervise(int(sys.argv[1]))"
)
"""The program of a supervisor; its arguments are the number of its socket and the import path."""
ENVIRONMENT = (
    "PATH HOME USER LANG LANGUAGE LC_ALL LC_CTYPE TZ TMPDIR VIRTUAL_ENV PYTHONPATH PYTHONHASHSEED "
    "PYTHONHOME PYTHONDONTWRITEBYTECODE LD_LIBRARY_PATH DYLD_LIBRARY_PATH CUDA_VISIBLE_DEVICES "
    "OMP_NUM_THREADS OPENBLAS_NUM_THREADS MKL_NUM_THREADS NUMBA_NUM_THREADS NUMBA_CACHE_DIR"
)
"""Environment variables that a plug-in's process gets from this one: no keys, no cache folder."""
MARK = "PLUGIN_MARK"
"""Environment variable by which the processes below a supervisor are recognised once it has
ended."""
MOST_SWEEPS = 20
"""Most searches for remaining processes, which may start others while they end; chosen by hand."""
MOST_PRELOADED = 1000
"""Most modules that are preloaded, far more than there are."""
REPORT_S = 8.0
"""Seconds that a guard may take to end a plug-in with all its processes, and to report."""
MOST_REPORT_BYTES = 1 << 20
"""Most bytes of a guard's report, and of a message beside the answer in it; chosen by hand."""
CLOCK_ERROR_S = 0.01
"""Seconds by which a reported call time may exceed the wait for it; chosen by hand."""
CORES = os.cpu_count() or 1
"""Most seconds of processor time that a call can use in a second."""


class PluginHandle(Protocol):
    """A plug-in that can be called.

    log: the end of what it printed, once it is closed; empty for a plug-in in this process.
    """

    traits: Traits
    log: str

    def call(self, method: str, *arguments: Any) -> Timed:
        """Call a method and return its answer and time; `PluginError` if it fails."""


@contextmanager
def open_plugin(
    spec: Spec,
    *,
    limits: Limits | None = None,
    isolated: bool | None = None,
    sandbox: bool = False,
    hidden: Sequence[Path] = (),
    data: Sequence[Path] = (),
    watch_arguments: bool = False,
) -> Iterator[PluginHandle]:
    """Make a plug-in, in a process of its own unless it is part of roadscope; end it afterwards.

    isolated: whether it gets a process of its own; None: as the spec says.
    sandbox: whether that process has no network, and only an empty scratch folder to write to.
    hidden: folders that look empty in the sandbox, beside that of the cache.
    data: folders of recorded data, of which nothing can be read in the sandbox.
    watch_arguments: whether a call that changes its arguments fails.

    `PluginError` says how the plug-in failed, `SandboxError` why the sandbox cannot be used.
    """
    if not (spec.isolated if isolated is None else isolated):
        yield _InProcess(spec, watch_arguments=watch_arguments)
        return
    options = _Options(limits or Limits(), sandbox, hidden=tuple(hidden), data=tuple(data))
    plugin = _Isolated(spec, options, watch_arguments=watch_arguments)
    try:
        plugin.load()
        yield plugin
    except PluginError as error:
        plugin.close()
        # Another plug-in that is open at the same time may have failed.
        if error.spec == spec.text:
            error.log = error.log or plugin.log
        raise
    finally:
        plugin.close()


def probe(spec: Spec) -> Traits:
    """Return the traits of a plug-in's class, which is loaded in a child process if it is not ours.

    `SpecError` if it does not exist or cannot be imported. If loading fails in another way, the
    traits are read from its source, and `failure` has the reason. Traits are remembered until the
    file changes. `probing` sets the limits of the child.
    """
    if not spec.isolated:
        return traits_of_class(load_class(spec.target), spec.arguments)
    options = _probing.get()
    key = spec.text, spec.target, Path.cwd(), options
    if key in _PROBED:
        traits, modified_ns = _PROBED[key]
        if modified_ns == _modified_ns(traits.file):
            return traits
    try:
        if options.trust or not hasattr(os, "fork"):
            traits = traits_of_class(load_class(spec.target), spec.arguments)
        else:
            with closing(_Isolated(spec, options, make=False)) as plugin:
                traits = plugin.load()
    except LoadingError as error:
        traits = traits_of_source(spec.target, f"{spec.text}: {error}")
    except PluginError as error:
        if error.mistake:
            raise SpecError(str(error)) from error
        traits = traits_of_source(spec.target, str(error))
    _PROBED[key] = traits, _modified_ns(traits.file)
    return traits


@dataclass(frozen=True, slots=True)
class _Options:
    """How a plug-in is isolated: see `open_plugin`, and for `trust` see `probing`."""

    limits: Limits = Limits()  # noqa: RUF009
    sandbox: bool = False
    trust: bool = False
    hidden: tuple[Path, ...] = ()
    data: tuple[Path, ...] = ()


@contextmanager
def probing(
    limits: Limits,
    *,
    sandbox: bool = False,
    trust: bool = False,
    hidden: Sequence[Path] = (),
    data: Sequence[Path] = (),
) -> Iterator[None]:
    """Within the context, `probe` loads classes with these options: see `open_plugin`.

    trust: load them in this process.
    """
    options = _Options(limits, sandbox and not trust, trust, tuple(hidden), tuple(data))
    token = _probing.set(options)
    try:
        yield
    finally:
        _probing.reset(token)


_probing: ContextVar[_Options] = ContextVar("probing", default=_Options())  # noqa: B039

_PROBED: dict[tuple[str, str, Path, _Options], tuple[Traits, int]] = {}
"""Traits by spec, folder and options, with the time when the file was modified."""


def _modified_ns(file: Path | None) -> int:
    """Return when a file was modified; 0 without a file, -1 if that is not known."""
    try:
        return file.stat().st_mtime_ns if file else 0
    except (OSError, ValueError):
        return -1


class _InProcess:
    """A plug-in in this process: it has no limits; only its exceptions are caught."""

    def __init__(self, spec: Spec, *, watch_arguments: bool) -> None:
        self._text, self.log = spec.text, ""
        self._watch_arguments = watch_arguments
        self._plugin = self._guarded(spec.make)
        self.traits = traits_of_class(type(self._plugin), spec.arguments, self._plugin)

    def call(self, method: str, *arguments: Any) -> Timed:
        function = self._guarded(getattr, self._plugin, method)
        wall_s, processor_s = time.perf_counter(), time.process_time()
        if self._watch_arguments:
            answer = self._guarded(call_watched, function, arguments)
        else:
            answer = self._guarded(function, *arguments)
        processor_s, wall_s = time.process_time() - processor_s, time.perf_counter() - wall_s
        return Timed(answer, processor_s * 1e3, wall_s * 1e3)

    def _guarded(self, function: Any, *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except KeyboardInterrupt:
            raise
        except (SpecError, ChangedArgumentError) as error:
            raise PluginError(self._text, str(error)) from error
        except BaseException as error:
            raise PluginError(self._text, describe(error)) from error


def _literal(value: Any) -> str:
    """Return a value as text for `ast.literal_eval`; infinity is written as 1e999."""
    return repr(value).replace("inf", "1e999") if isinstance(value, float) else repr(value)


class _Isolated:
    """A plug-in in its own process."""

    traits: Traits

    def __init__(
        self, spec: Spec, options: _Options, *, make: bool = True, watch_arguments: bool = False
    ) -> None:
        """Start its process. make: whether it is made too, not only its class loaded."""
        limits = options.limits
        self._text, self._limits = spec.text, limits
        self._left_s = limits.episode_s
        self._called_methods: set[str] = set()
        self._call_number = 0
        self._failure: PluginError | None = None
        self.log = ""
        if not hasattr(os, "fork"):
            raise PluginError(
                self._text, "processes cannot be forked here; --trust runs it in this one"
            )
        self._own = _Supervisor(_sandboxed(spec, options)) if options.sandbox else None
        self._supervisor = self._own or _Supervisor.of_this_process()
        request = {
            "target": spec.target,
            "arguments": {name: _literal(value) for name, value in spec.arguments.items()},
            "make": make,
            "watch_arguments": watch_arguments,
            "path": _import_path(),
            "folder": str(Path.cwd()),
            "answer_bytes": round(limits.answer_mb * 1e6),
            "memory_bytes": round(limits.memory_gb * 1e9),
            "output_bytes": round(limits.output_mb * 1e6),
        }
        # Calls and answers go through one socket, commands to the guard and its reports through
        # another. The other ends are sent to the supervisor and then closed here.
        self._call_socket, plugin_end = socket.socketpair()
        self._guard_socket, guard_end = socket.socketpair()
        self._buffer = open_buffer()
        self._channel = Channel(self._call_socket, ended=self._guard_socket, buffer=self._buffer)
        self._reports = Channel(self._guard_socket)
        self._opened_s = time.monotonic()
        with plugin_end, guard_end:
            files = [plugin_end.fileno(), self._buffer, guard_end.fileno()]
            self._guard_number = self._supervisor.open(request, files)

    def load(self) -> Traits:
        """Wait until the plug-in is loaded and made."""
        loaded = self._answer(None, 0, limit_s=self._limits.first_call_s, doing="loading it")
        if type(loaded.answer) is dict and type(loaded.answer.get(MISTAKE)) is str:
            raise PluginError(self._text, loaded.answer[MISTAKE], mistake=True)
        try:
            shown = _shown(loaded.answer)
            self.traits = msgspec.convert(shown, Traits, dec_hook=lambda kind, value: kind(value))
            self._supervisor.remember(loaded.answer["loaded"])
        except (KeyError, TypeError, ValueError):
            self._fail("the description of its class is malformed")
        return self.traits

    def call(self, method: str, *arguments: Any) -> Timed:
        if self._failure is not None:
            raise self._failure
        is_first = method not in self._called_methods
        self._called_methods.add(method)
        self._call_number += 1
        number = self._call_number
        return self._answer(
            encode({"number": number, "method": method, "arguments": list(arguments)}),
            number,
            limit_s=self._limits.first_call_s if is_first else self._limits.call_s,
            doing=method,
        )

    def close(self) -> None:
        """End the process with all processes that it started."""
        self._end(END)
        if self._own is not None:
            self._own.close()

    def _answer(self, message: bytes | None, number: int, *, limit_s: float, doing: str) -> Timed:
        """Send a call, wait for its answer and check it.

        message: None while the plug-in is loaded, which it does without a call.
        doing: what an error says that failed, such as the name of a method.
        """
        most_bytes = round(self._limits.answer_mb * 1e6) + MOST_REPORT_BYTES
        # Loading starts by itself, maybe before this line is reached.
        start_s = self._opened_s if message is None else time.monotonic()
        deadline_s = start_s + min(limit_s, self._left_s)
        try:
            if message is not None:
                if self._channel.surplus():
                    self._fail(f"sent more than one answer before {doing}")
                self._channel.send(message, deadline_s)
            received = self._channel.receive(most_bytes, deadline_s)
        except TimeoutError:
            self._supervisor.resume()
            if limit_s >= self._left_s:
                took = f"all calls of the episode took more than {self._limits.episode_s:g} s"
                self._fail(f"{doing}: {took}")
            self._fail(f"{doing}: no answer within {limit_s:g} s: it hangs")
        except TooLongError as error:
            self._fail(
                f"{doing}: an answer of {int(str(error)) / 1e6:.1f} MB, more than the "
                f"{self._limits.answer_mb:g} MB that it may have"
            )
        except ClosedError:
            self._fail(doing, CLOSED)
        waited_s = time.monotonic() - start_s
        self._left_s -= waited_s
        if self._channel.surplus():
            self._fail(f"{doing}: more than one answer")
        try:
            content = decode(received)
        except WireError as error:
            self._fail(f"{doing}: {error}")
        if not _is_answer(content, number, waited_s + CLOCK_ERROR_S):
            self._fail(f"{doing}: a forged or malformed answer")
        if content["error"]:
            # It raised an exception, and may be called again.
            report = self._report(LOG)
            log = "" if report is None else report["log"]
            raise PluginError(self._text, content["error"], log)
        return Timed(content["answer"], content["processor_ms"], content["wall_ms"])

    def _fail(self, reason: str, command: bytes = END) -> NoReturn:
        """End the plug-in and raise `PluginError` with the reason and how its process ended.

        command: to the guard; `CLOSED` if the process has closed its socket or ended.
        """
        report = self._end(command)
        if report is None:
            reason = f"{reason}: the process that watches over it does not answer"
        elif report["how"]:
            reason = f"{reason}: {report['how']}"
        self._failure = PluginError(self._text, reason, self.log)
        raise self._failure

    def _end(self, command: bytes) -> Mapping[str, str] | None:
        """End the process and return the last report, None if there is none."""
        has_ended = self._guard_socket.fileno() < 0
        if has_ended:
            return None
        report = self._report(command)
        self.log = "" if report is None else last_lines(report["log"], MOST_LOG_CHARACTERS)
        self._call_socket.close()
        self._guard_socket.close()
        os.close(self._buffer)
        if report is None:
            self._supervisor.end(self._guard_number)
        return report

    def _report(self, command: bytes) -> Mapping[str, str] | None:
        """Send a command to the guard and return its report, None if it does not answer."""
        try:
            with suppress(OSError):
                self._guard_socket.send(command)
            deadline_s = time.monotonic() + REPORT_S
            while True:
                report = decode(self._reports.receive(MOST_REPORT_BYTES, deadline_s))
                # A late answer to an earlier `LOG` may come before the last report.
                if report["ended"] or command == LOG:
                    return dict(report)
        except (ClosedError, TimeoutError, TooLongError, WireError):
            return None


class _Supervisor:
    """The handle of a supervisor, the process that forks those of plug-ins."""

    _running: dict[int, _Supervisor] = {}  # noqa: RUF012
    """By the number of the process that started it: a forked process needs its own."""
    _lock = threading.Lock()

    def __init__(self, prefix: Sequence[str] = ()) -> None:
        """Start the process. prefix: words in front of its command, such as the sandbox's."""
        self._control, supervisor_end = socket.socketpair()
        words = [*prefix, sys.executable, "-c", RUN, str(supervisor_end.fileno())]
        self._mark = secrets.token_hex(16)
        names = [name for name in ENVIRONMENT.split() if name in os.environ]
        environment = {name: os.environ[name] for name in names}
        with supervisor_end:
            self._process = subprocess.Popen(
                [*words, *_import_path(), str(ROOT)],
                pass_fds=[supervisor_end.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                env=environment | {MARK: self._mark},
                start_new_session=True,
            )
        self._control.settimeout(REPORT_S)
        self._sending = threading.Lock()
        self._numbers = count(1)
        self._preload: dict[str, None] = {}

    @classmethod
    def of_this_process(cls) -> _Supervisor:
        """Return the supervisor of this process; start one if there is none or it has ended."""
        with cls._lock:
            running = cls._running.get(os.getpid())
            if running is None or running._process.poll() is not None:
                if running is None:
                    atexit.register(cls._close_all)
                else:
                    running.close()
                running = cls._running[os.getpid()] = cls()
            return running

    @classmethod
    def _close_all(cls) -> None:
        running = cls._running.pop(os.getpid(), None)
        if running is not None:
            running.close()

    def open(self, request: Mapping[str, Any], files: Sequence[int]) -> int:
        """Start a plug-in's process and its guard, and return the number of the guard.

        files: numbers of the plug-in's socket, its buffer and the guard's socket. If the supervisor
        has ended, reading from the sockets raises `ClosedError`.
        """
        number = next(self._numbers)
        order = {"end": False, "number": number, "preload": list(self._preload)}
        message = framed(encode({**request, **order}))
        with self._sending, suppress(OSError):
            sent = socket.send_fds(self._control, [message], list(files))
            self._control.sendall(message[sent:])
        return number

    def end(self, number: int) -> None:
        """End a guard that does not answer, with its plug-in; if that fails, end all plug-ins."""
        self.resume()
        with self._sending, suppress(OSError):
            self._control.sendall(framed(encode({"end": True, "number": number})))
            if self._control.recv(1):
                return
        self.close()

    def resume(self) -> None:
        """Let stopped processes run again: a plug-in may have stopped its guard or supervisor."""
        self._send_signal(signal.SIGCONT)

    def _send_signal(self, number: signal.Signals) -> None:
        """Send a signal to the supervisor and to all processes below it."""
        import psutil

        with suppress(psutil.Error):
            supervisor = psutil.Process(self._process.pid)
            for process in [supervisor, *supervisor.children(recursive=True)]:
                with suppress(psutil.Error):
                    process.send_signal(number)

    def remember(self, modules: Sequence[str]) -> None:
        """Preload the slow libraries that a plug-in loaded before the next one is opened."""
        names = [name for name in modules if type(name) is str and may_preload(name)]
        self._preload |= dict.fromkeys(names[:MOST_PRELOADED])

    def close(self) -> None:
        """End it with all plug-ins."""
        self._control.close()
        try:
            self._process.wait(REPORT_S)
        except subprocess.TimeoutExpired:
            self._send_signal(signal.SIGKILL)
            self._process.wait()
        if self._process.returncode:
            self._end_marked()

    def _end_marked(self) -> None:
        """End the remaining processes of a supervisor that was killed, which have no parent now."""
        import psutil

        for _ in range(MOST_SWEEPS):
            remaining = 0
            for process in psutil.process_iter():
                with suppress(psutil.Error):
                    if process.environ().get(MARK) == self._mark:
                        remaining += process.status() != psutil.STATUS_ZOMBIE
                        process.kill()
            if not remaining:
                return


def _import_path() -> list[str]:
    """Return the import path of this process; the empty entry is the current folder."""
    return [entry or str(Path.cwd()) for entry in sys.path]


def _sandboxed(spec: Spec, options: _Options) -> list[str]:
    """Return the words before a supervisor's command that run it in a sandbox.

    The package, the import path and the folder of the plug-in's file can be read even inside hidden
    folders, but nothing can in folders of recorded data. `PluginError` for a file of a plug-in in a
    folder that must look empty.
    """
    if why := sandbox_available():
        raise SandboxError(why)
    from roadscope.benchmarks.cache import cache_dir

    place = spec.target.rpartition(":")[0]
    data_folders = [each for path in options.data for each in folders_behind(path.resolve())]

    def in_data(path: Path) -> bool:
        return any(path.resolve().is_relative_to(each) for each in data_folders)

    readable = [PACKAGE, *(path for path in needed_paths(sys.path) if not in_data(path))]
    hidden_folders = [path.resolve() for path in (cache_dir(), *options.hidden)]
    if place.endswith(".py"):
        folder = Path(place).resolve().parent
        if folder in hidden_folders:
            raise PluginError(
                spec.text,
                f"its file is in {folder}, which looks empty in a sandbox, as results are there: "
                "name another folder for results with --out, or move the file of the plug-in",
            )
        if in_data(folder):
            raise PluginError(
                spec.text,
                f"its file is in {folder}, in a folder of recorded data, which looks empty in a "
                "sandbox, as labels are there: move the file of the plug-in to another folder",
            )
        readable.append(folder)
    return sandbox_command(readable=readable, hidden=[*hidden_folders, *data_folders])


def _is_answer(content: Any, number: int, most_s: float) -> bool:
    """Return whether a message is the answer to this call, with possible times."""
    names = {"number", "error", "answer", "wall_ms", "processor_ms"}
    if type(content) is not dict or content.keys() != names:
        return False
    if type(content["number"]) is not int or content["number"] != number:
        return False
    most_ms = most_s * 1e3
    times = (content["wall_ms"], most_ms), (content["processor_ms"], most_ms * CORES)
    if not all(type(ms) is float and 0 <= ms <= most for ms, most in times):
        return False
    return type(content["error"]) is str


def _shown(value: Any) -> Any:
    """Return a value with all its texts safe to print."""
    if isinstance(value, str):
        return one_line(value)
    if isinstance(value, dict):
        return {_shown(key): _shown(each) for key, each in value.items()}
    return [_shown(each) for each in value] if isinstance(value, list | tuple) else value
