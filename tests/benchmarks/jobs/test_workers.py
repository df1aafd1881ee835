"""Processes that share a list of items."""

import os
import signal

from roadscope.benchmarks.jobs.workers import in_parallel


def heedless(_: int) -> tuple[int, bool]:
    """Say who works, and whether Ctrl-C is left to the parent once processes are started here."""
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()
    return os.getpid(), signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def test_workers_leave_interrupts_to_their_parent() -> None:
    found = dict(in_parallel(heedless, range(4), 2))
    assert sorted(found) == [0, 1, 2, 3]
    assert os.getpid() not in {process for process, _ in found.values()}
    assert all(ignored for _, ignored in found.values())


def test_one_job_works_here_and_changes_nothing() -> None:
    before = signal.getsignal(signal.SIGINT)
    found = [answer for _, answer in in_parallel(heedless, range(2), 1)]
    assert {process for process, _ in found} == {os.getpid()}
    assert signal.getsignal(signal.SIGINT) == before
