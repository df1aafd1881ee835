"""Worker processes that share a list of items."""

from __future__ import annotations

import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar

T = TypeVar("T")
R = TypeVar("R")


class WorkerError(RuntimeError):
    """A worker process died."""


def in_parallel(
    function: Callable[[T], R], items: Sequence[T], jobs: int
) -> Iterator[tuple[int, R]]:
    """Yield index and result of each item as they are done; with one job in order, in here.

    jobs: processes. `WorkerError` when one of them died.
    """
    if jobs == 1 or len(items) < 2:
        for index, item in enumerate(items):
            yield index, function(item)
        return
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    pool = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
    tasks = (
        delayed(_in_worker)(os.getpid(), function, index, item) for index, item in enumerate(items)
    )
    try:
        with warnings.catch_warnings():
            # loky replaces workers that have grown and says so.
            warnings.filterwarnings("ignore", "A worker stopped", UserWarning)
            with _interrupts_held():
                results = pool(tasks)
            yield from results
    except TerminatedWorkerError as error:
        raise WorkerError("a worker process died (out of memory?); try fewer --jobs") from error


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


def _in_worker(parent: int, function: Callable[[Any], R], index: int, item: Any) -> tuple[int, R]:
    if os.getpid() != parent:
        _ignore_interrupts()
    leave_with(parent)
    return index, function(item)


@cache
def _ignore_interrupts() -> None:
    """Leave Ctrl-C to the parent: where a worker starts a process of its own it is blocked no more.

    The tracker of multiprocessing's resources, which is started then, unblocks it.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@cache
def leave_with(parent: int) -> None:
    """End this worker soon after the process that started it was killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
