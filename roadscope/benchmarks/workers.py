"""Worker processes that share a list of items, on this machine or on a cluster.

Workers come from loky (the default, on this machine), Ray or Dask. Each of them offers futures, and
one loop over futures serves all three. A worker process that dies costs the item that it computed,
and that item is tried again; all other items go on.
"""

from __future__ import annotations

import os
import platform
import re
import signal
import socket
import sys
import threading
import time
import warnings
from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, Protocol, TypeVar

from roadscope.benchmarks.cache import ENVIRONMENT_VARIABLE, cache_dir
from roadscope.core.loading import Requirement
from roadscope.core.names import unknown

T = TypeVar("T")
R = TypeVar("R")

BACKENDS = ("loky", "ray", "dask")
"""The libraries that provide workers."""
EXTRAS = {
    "ray": Requirement("ray", "pip install 'roadscope[ray]'"),
    "dask": Requirement("distributed", "pip install 'roadscope[dask]'"),
}
"""Distributions that backends need and roadscope does not install."""
MOST_SHARED_DEATHS = 2
"""An item whose workers died this often is computed while nothing else runs; chosen by hand."""
HAND_ON_S = 5.0
"""Longest time in which a library hands an item on to a worker; chosen by hand, it takes 1 ms."""
_HOST_AND_PORT = re.compile(r"(?:(?:ray|tcp|tls)://)?(?P<host>[^:/]+):(?P<port>\d+)")
CONNECT_S = 30.0
"""Seconds that a cluster may take to answer; chosen by hand."""
THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
"""Environment variables that limit the threads of libraries, which read them when loaded."""


class WorkerError(RuntimeError):
    """A worker process died, or a cluster was lost."""


class BackendError(ValueError):
    """A backend is unknown, not installed, or does not answer."""


@dataclass(frozen=True, slots=True)
class WorkerSettings:
    """How many workers a run has and where they are.

    jobs: worker processes; 0: one for each core of the cluster at `address`, or of this machine.
    backend: one of `BACKENDS`.
    address: of a running cluster of Ray (`ray://HOST:10001`, `HOST:6379`) or of Dask
        (`tcp://HOST:8786`); None: the backend starts its own workers on this machine.

    Workers on other machines need the same version of this package, and the files of plug-ins and
    of recorded data at the same paths. Scores travel back to the run. Computed files
    (timelines, detections, tracks) stay where they are computed: let `ROADSCOPE_CACHE` name a
    folder that all machines share. Without one every machine has its own cache, the
    `ROADSCOPE_CACHE` of its workers or else a folder of the same path as on this machine; results
    are the same, and what one machine has computed others compute again where they need it.

    Anybody who reaches a cluster's port can run code on it. Ray and Dask have settings against that
    (`RAY_AUTH_MODE` and `RAY_AUTH_TOKEN` of Ray, TLS of Dask), which apply here too.

    Workers of Dask compute one item at a time in a process: start them with `--nthreads 1` and one
    process for each core.
    """

    jobs: int = 1
    backend: str = "loky"
    address: str | None = None

    @property
    def share_kernels(self) -> bool:
        """Whether there are several workers that use one folder of compiled kernels."""
        return self.jobs != 1 and self.address is None

    def check(self) -> None:
        """Raise `BackendError` if the backend is unknown, not installed or gets no address."""
        if self.backend not in BACKENDS:
            raise BackendError(unknown("backend", self.backend, BACKENDS))
        if self.address is not None and self.backend not in EXTRAS:
            raise BackendError(
                f"address {self.address}: backend {self.backend} has workers on this machine only; "
                f"{' and '.join(EXTRAS)} have clusters"
            )
        extra = EXTRAS.get(self.backend)
        if extra is not None and extra.missing:
            raise BackendError(f"backend {self.backend}: {extra.missing}")


class Workers:
    """Workers that are open; with a single job of loky, this process itself."""

    def __init__(self, pool: _Pool | None) -> None:
        self._pool = pool

    def each(
        self,
        function: Callable[[T], R],
        items: Sequence[T],
        *,
        prepare: Callable[[T], Any] = lambda item: item,
        groups: Sequence[Hashable] = (),
        on_death: Callable[[T], R] | None = None,
    ) -> Iterator[tuple[int, R]]:
        """Yield index and result of each item as they are done; in order in this process.

        An item during which a worker died is tried again, the second time while nothing else runs.
        prepare: returns what `function` gets for an item, in this process when a worker takes it.
        groups: of the items, if any. A worker prefers items of the group of its last one, of which
        it may remember something, such as the scans of an episode.
        on_death: returns the result of an item whose workers died in all trials; None:
        `WorkerError`. An error of `function` is raised here and ends all work.
        """
        pool = self._pool
        if pool is None:
            for index, item in enumerate(items):
                yield index, function(prepare(item))
            return

        def start(index: int, after: Future[R] | None) -> Future[R]:
            return pool.submit(function, prepare(items[index]), after)

        for index, future in _share(pool, start, _Waiting(len(items), groups)):
            error = future.exception()
            if error is None:
                yield index, future.result()
            elif on_death is not None:
                yield index, on_death(items[index])
            else:
                text = "a worker process died (out of memory?); try fewer --jobs"
                raise WorkerError(text) from error


@contextmanager
def open_workers(settings: WorkerSettings) -> Iterator[Workers]:
    """Start workers or connect to those of a cluster; end afterwards those that were started."""
    settings.check()
    if settings.backend == "loky" and settings.jobs == 1:
        yield Workers(None)
        return
    kill = True
    with warnings.catch_warnings():
        # loky replaces workers that have grown and says so.
        warnings.filterwarnings("ignore", "A worker stopped", UserWarning)
        pool = _POOLS[settings.backend](settings)
        try:
            yield Workers(pool)
            kill = False
        finally:
            pool.close(kill=kill)


def in_parallel(
    function: Callable[[T], R], items: Sequence[T], jobs: int
) -> Iterator[tuple[int, R]]:
    """Yield index and result of each item as they are done, computed in processes here."""
    with open_workers(WorkerSettings(min(jobs, max(len(items), 1)))) as workers:
        yield from workers.each(function, items)


class _Pool(Protocol):
    """Workers of one backend.

    slots: how many items they compute at a time.
    """

    slots: int

    def submit(
        self, function: Callable[[Any], Any], item: Any, after: Future[Any] | None
    ) -> Future[Any]:
        """Have an item computed by an idle worker, if possible by the one that computed `after`."""

    def deaths(self, error: BaseException) -> int:
        """Return how many workers died during the item, 0 if its function raised the error."""

    def close(self, *, kill: bool) -> None:
        """End what was started; kill: without waiting for what still runs."""


class _Waiting:
    """The items that wait for a worker, in order; an item of the same group may go first."""

    def __init__(self, count: int, groups: Sequence[Hashable]) -> None:
        self._groups = groups or [None] * count
        self._indices = dict.fromkeys(range(count))

    def __len__(self) -> int:
        return len(self._indices)

    def put(self, index: int) -> None:
        """Let an item wait again."""
        self._indices[index] = None

    def take(self, before: int | None, running: Iterable[int]) -> int:
        """Return the next item for the worker that computed item `before`.

        Of the same group if there is one; else of a group that no other worker computes.
        """
        own = () if before is None else (self._groups[before],)
        others = {self._groups[index] for index in running}
        same = (i for i in self._indices if self._groups[i] in own)
        free = (i for i in self._indices if self._groups[i] not in others)
        index = next(chain(same, free, self._indices))
        del self._indices[index]
        return index


def _share(
    pool: _Pool, start: Callable[[int, Future[R] | None], Future[R]], waiting: _Waiting
) -> Iterator[tuple[int, Future[R]]]:
    """Have the workers compute all items, never more at a time than there are workers.

    So every item that was sent is being computed, and it is clear whose worker died. A future with
    an error is that of an item whose workers died in all trials.

    start: has an item computed, if possible by the worker of the future that it gets.
    """
    deaths = Counter[int]()
    alone = deque[int]()
    running: dict[Future[R], int] = {}

    def send(before: int | None = None, after: Future[R] | None = None) -> None:
        while waiting and len(running) < pool.slots:
            index = waiting.take(before, running.values())
            running[start(index, after)] = index
        if alone and not running:
            index = alone.popleft()
            running[start(index, None)] = index

    send()
    while running:
        finished, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in finished:
            index = running.pop(future)
            try:
                error = future.exception()
            except CancelledError as cancelled:
                raise WorkerError("the connection to the cluster was lost") from cancelled
            if error is not None:
                died = pool.deaths(error)
                if not died:
                    raise error
                deaths[index] += died
                if deaths[index] < MOST_SHARED_DEATHS:
                    waiting.put(index)
                elif deaths[index] == MOST_SHARED_DEATHS:
                    alone.append(index)
            if error is None:
                send(index, future)
            else:
                send()
            if error is None or deaths[index] > MOST_SHARED_DEATHS:
                yield index, future


class _LokyPool:
    """Workers of loky, each an executor of its own: if one dies, the others continue."""

    def __init__(self, settings: WorkerSettings) -> None:
        from joblib import cpu_count

        self.slots = settings.jobs or int(cpu_count())
        threads = str(max(int(cpu_count()) // self.slots, 1))
        self._environment = {name: os.environ.get(name, threads) for name in THREAD_VARIABLES}
        self._context = _RunContext.of_this_process(parent=os.getpid())
        self._idle: dict[Future[Any], Any] = {}
        """The idle workers, each by its last item."""
        self._busy: dict[Future[Any], Any] = {}

    def submit(
        self, function: Callable[[Any], Any], item: Any, after: Future[Any] | None
    ) -> Future[Any]:
        from joblib.externals.loky import ProcessPoolExecutor

        self._collect()
        if after in self._idle:
            executor = self._idle.pop(after)
        elif self._idle:
            executor = self._idle.popitem()[1]
        else:
            executor = ProcessPoolExecutor(max_workers=1, env=self._environment)
        with _interrupts_held():
            future = executor.submit(_in_worker, self._context, function, item)
        self._busy[future] = executor
        return future  # type: ignore[no-any-return]

    def deaths(self, error: BaseException) -> int:
        from joblib.externals.loky import BrokenProcessPool

        return int(isinstance(error, BrokenProcessPool))

    def close(self, *, kill: bool) -> None:
        if kill:
            self._let_items_arrive()
        executors = [*self._idle.values(), *self._busy.values()]
        # At once: a worker with all modules loaded takes a while to end.
        with ThreadPoolExecutor(max(len(executors), 1)) as threads:
            for executor in executors:
                threads.submit(executor.shutdown, wait=True, kill_workers=kill)
        self._idle, self._busy = {}, {}

    def _let_items_arrive(self) -> None:
        """Wait until loky has handed on what was just sent.

        Its thread fails with a KeyError (joblib 1.6) if it has to end while an item is on its way.
        """
        until_s = time.monotonic() + HAND_ON_S
        while time.monotonic() < until_s:
            if all(future.running() or future.done() for future in self._busy):
                return
            time.sleep(0.002)

    def _collect(self) -> None:
        """Take back the executors whose item is done; end those whose worker died."""
        for future in [future for future in self._busy if future.done()]:
            executor = self._busy.pop(future)
            error = future.exception()
            if error is not None and self.deaths(error):
                executor.shutdown(wait=True, kill_workers=True)
            else:
                self._idle[future] = executor


class _RayPool:
    """Workers of Ray, by its tasks; Ray itself does not repeat a task."""

    def __init__(self, settings: WorkerSettings) -> None:
        import ray
        from joblib import cpu_count

        jobs = settings.jobs or int(cpu_count())
        with ExitStack() as stack:
            if not ray.is_initialized():
                # Ray prints that a worker died on the standard output, where a board may be read.
                stack.enter_context(redirect_stdout(sys.stderr))
                stack.callback(ray.shutdown)
                _start_ray(settings.address, jobs)
            self.slots = settings.jobs
            if not settings.jobs or settings.address is None:
                self.slots = max(int(ray.cluster_resources().get("CPU", 1)), 1)
            self._task = ray.remote(max_retries=0, num_cpus=1)(_in_worker)
            self._end = stack.pop_all().close
        self._context = _RunContext.of_this_process()
        self._running: list[tuple[Future[Any], Any]] = []

    def submit(
        self, function: Callable[[Any], Any], item: Any, after: Future[Any] | None
    ) -> Future[Any]:
        reference = self._task.remote(self._context, function, item)
        future: Future[Any] = reference.future()
        self._running = [each for each in self._running if not each[0].done()]
        self._running.append((future, reference))
        return future

    def deaths(self, error: BaseException) -> int:
        from ray.exceptions import (
            LocalRayletDiedError,
            NodeDiedError,
            OutOfMemoryError,
            WorkerCrashedError,
        )

        died = WorkerCrashedError, OutOfMemoryError, NodeDiedError, LocalRayletDiedError
        return int(isinstance(error, died))

    def close(self, *, kill: bool) -> None:
        import ray

        for future, reference in self._running:
            if kill and not future.done():
                with suppress(Exception):
                    ray.cancel(reference, force=True)
        self._running = []
        self._end()


def _start_ray(address: str | None, jobs: int) -> None:
    import logging

    import ray

    quiet = {"logging_level": logging.ERROR, "log_to_driver": False}
    try:
        if address is None:
            ray.init(address="local", num_cpus=jobs, include_dashboard=False, **quiet)
        else:
            _check_answering(address)
            ray.init(address=address, **quiet)
    except (OSError, RuntimeError, ValueError) as error:
        raise BackendError(f"no Ray at {address or 'this machine'}: {_line(error)}") from error


class _DaskPool:
    """Workers of Dask.

    Dask itself tries an item again whose worker died, on other workers, as often as its setting
    `distributed.scheduler.allowed-failures` says; when it gives up that is final.
    """

    def __init__(self, settings: WorkerSettings) -> None:
        import logging

        from distributed import Client, LocalCluster
        from joblib import cpu_count

        self._cluster: Any = None
        jobs = settings.jobs or int(cpu_count())
        try:
            if settings.address is None:
                self._cluster = LocalCluster(
                    n_workers=jobs,
                    threads_per_worker=1,
                    processes=True,
                    memory_limit=None,
                    dashboard_address=None,
                    silence_logs=logging.CRITICAL,
                )
            else:
                _check_answering(settings.address)
            self._client = Client(
                self._cluster or settings.address, timeout=CONNECT_S, set_as_default=False
            )
            self._client.wait_for_workers(1, timeout=CONNECT_S)
        except (OSError, TimeoutError, ValueError) as error:
            raise BackendError(
                f"no Dask with workers at {settings.address or 'this machine'}: {_line(error)}"
            ) from error
        # A process computes one item at a time, however many threads it has.
        self.slots = jobs if self._cluster else len(self._client.nthreads())
        if settings.jobs:
            self.slots = min(self.slots, settings.jobs)
        self._executor = self._client.get_executor(pure=False)
        self._context = _RunContext.of_this_process()

    def submit(
        self, function: Callable[[Any], Any], item: Any, after: Future[Any] | None
    ) -> Future[Any]:
        future: Future[Any] = self._executor.submit(_in_worker, self._context, function, item)
        return future

    def deaths(self, error: BaseException) -> int:
        from distributed import KilledWorker

        return MOST_SHARED_DEATHS + 1 if isinstance(error, KilledWorker) else 0

    def close(self, *, kill: bool) -> None:
        self._executor.shutdown(wait=not kill)
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()


_POOLS: dict[str, Callable[[WorkerSettings], _Pool]] = {
    "loky": _LokyPool,
    "ray": _RayPool,
    "dask": _DaskPool,
}


def _check_answering(address: str) -> None:
    """Raise `OSError` at once where nothing answers; Ray itself waits for minutes."""
    if place := _HOST_AND_PORT.fullmatch(address):
        socket.create_connection((place["host"], int(place["port"])), CONNECT_S).close()


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block Ctrl-C while workers start: they inherit that for good, and end with their parent."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@dataclass(frozen=True, slots=True)
class _RunContext:
    """The machine, folder, module path and cache of a run, which its workers use too.

    parent: the process with which workers end; None for those of a cluster.
    """

    host: str
    folder: str
    path: tuple[str, ...]
    cache: str
    parent: int | None

    @classmethod
    def of_this_process(cls, parent: int | None = None) -> _RunContext:
        path = tuple(str(Path(each).resolve()) for each in sys.path)
        return cls(platform.node(), str(Path.cwd()), path, str(cache_dir().resolve()), parent)

    def enter(self) -> None:
        """Use them in this worker, as far as they exist on this machine."""
        if self.parent is not None:
            _leave_with(self.parent)
        if _own_cache is None or self.host == platform.node():
            os.environ[ENVIRONMENT_VARIABLE] = self.cache
        sys.path += [each for each in self.path if each not in sys.path and Path(each).exists()]
        with suppress(OSError):
            os.chdir(self.folder)


_own_cache = os.environ.get(ENVIRONMENT_VARIABLE)
"""The cache folder that a worker was started with."""
_one_at_a_time = threading.Lock()
"""Workers of Dask may have threads; but times, warnings and Numba's threads belong to a process."""


def _in_worker(context: _RunContext, function: Callable[[T], R], item: T) -> R:
    with _one_at_a_time:
        context.enter()
        return function(item)


@cache
def _leave_with(parent: int) -> None:
    """Ignore Ctrl-C, which is for the parent; end this worker soon after the parent was killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    if threading.current_thread() is threading.main_thread():
        # Blocking it is not enough: when a worker starts a process of its own, multiprocessing's
        # resource tracker unblocks it.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=watch, daemon=True).start()
