"""Processes that share a list of items."""

import os
import signal
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import psutil
import pytest

from roadscope.benchmarks import (
    BackendError,
    WorkerError,
    WorkerSettings,
    in_parallel,
    open_workers,
)

ITEMS = range(12)
DEADLY = 5


def where_it_works(_: int) -> tuple[int, bool]:
    """Say who works, and whether Ctrl-C is left to the parent once processes are started here."""
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()
    return os.getpid(), signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def exit_here() -> None:
    os._exit(3)


def kill_here() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def square(log: Path, die: Callable[[], None], item: int) -> int:
    """Square an item; that of one item ends its process."""
    with log.open("a") as file:
        file.write(f"{item}\n")
    if item == DEADLY:
        die()
    time.sleep(0.02)
    return item * item


def dies_once(folder: Path, item: int) -> int:
    """Square an item; the first process that tries item DEADLY is killed."""
    flag = folder / "tried"
    if item == DEADLY and not flag.exists():
        flag.touch()
        kill_here()
    return item * item


def fail(item: int) -> int:
    raise KeyError(item)


def process_number(_: int) -> int:
    return os.getpid()


def test_workers_leave_interrupts_to_their_parent() -> None:
    results = dict(in_parallel(where_it_works, range(4), 2))
    assert sorted(results) == [0, 1, 2, 3]
    assert os.getpid() not in {process for process, _ in results.values()}
    assert all(ignored for _, ignored in results.values())


def test_one_job_works_here_and_changes_nothing() -> None:
    before = signal.getsignal(signal.SIGINT)
    results = [answer for _, answer in in_parallel(where_it_works, range(2), 1)]
    assert {process for process, _ in results} == {os.getpid()}
    assert signal.getsignal(signal.SIGINT) == before


@pytest.mark.sampled(1)
@pytest.mark.parametrize("die", [exit_here, kill_here])
def test_a_deadly_item_costs_only_itself(tmp_path: Path, die: Callable[[], None]) -> None:
    log = tmp_path / "log"
    with open_workers(WorkerSettings(2)) as workers:
        results = dict(workers.each(partial(square, log, die), ITEMS, on_death=lambda i: -i))
    assert results == {item: item * item for item in ITEMS} | {DEADLY: -DEADLY}
    tried = [int(line) for line in log.read_text().split()]
    # What others had computed or were computing is not computed again.
    assert all(tried.count(item) == 1 for item in ITEMS if item != DEADLY)
    assert tried.count(DEADLY) == 3
    assert tried[-1] == DEADLY


def test_an_item_whose_worker_died_is_tried_again(tmp_path: Path) -> None:
    results = dict(in_parallel(partial(dies_once, tmp_path), ITEMS, 2))
    assert results == {item: item * item for item in ITEMS}


def test_without_a_substitute_a_deadly_item_raises(tmp_path: Path) -> None:
    with pytest.raises(WorkerError, match="worker process died"):
        list(in_parallel(partial(square, tmp_path / "log", exit_here), ITEMS, 2))


def test_what_a_function_raises_is_raised_here() -> None:
    with pytest.raises(KeyError):
        list(in_parallel(fail, ITEMS, 2))


@pytest.mark.slow
def test_workers_stay_for_several_lists_and_end_afterwards() -> None:
    with open_workers(WorkerSettings(2)) as workers:
        numbers = {process for _ in range(3) for _, process in workers.each(process_number, ITEMS)}
        assert len(numbers) <= 2
        assert all(psutil.pid_exists(number) for number in numbers)
    assert not any(psutil.pid_exists(number) for number in numbers)


def test_workers_end_with_a_list_that_is_left() -> None:
    results = in_parallel(process_number, ITEMS, 2)
    _, number = next(results)
    results.close()
    assert not psutil.pid_exists(number)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        (WorkerSettings(backend="look"), "loky"),
        (WorkerSettings(address="tcp://localhost:1"), "ray and dask"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: WorkerSettings, reason: str) -> None:
    with pytest.raises(BackendError, match=reason), open_workers(settings):
        pass


def group_and_worker(item: int) -> tuple[int, int]:
    time.sleep(0.05)
    return item % 4, os.getpid()


@pytest.mark.slow
def test_a_worker_goes_on_with_the_group_of_its_last_item() -> None:
    items = range(24)
    with open_workers(WorkerSettings(2)) as workers:
        done = dict(workers.each(group_and_worker, items, groups=[item % 4 for item in items]))
    assert sorted(done) == list(items)
    # Each of two workers takes a group; the last two groups may be shared. Otherwise there are 8.
    assert len(set(done.values())) <= 6
