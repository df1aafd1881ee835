"""Two workers are nearly twice as fast as one."""

import subprocess
import sys
import time
from collections.abc import Callable

import pytest

from roadscope.benchmarks.workers import WorkerSettings, open_workers

ITEMS = 40
ITEM_S = 0.2
ROUNDS = 3
EXPECTED = 1.8
TWO_FREE_CORES = 1.9
"""What two plain processes gain on two free cores, at least."""


def count(steps: int) -> int:
    total = 0
    for step in range(steps):
        total += step & 3
    return total


def seconds(work: Callable[[], object]) -> float:
    before = time.perf_counter()
    work()
    return time.perf_counter() - before


def plain_gain(steps: int) -> float:
    """Return how much two plain processes at once gain over the two in turn."""
    code = f"total = 0\nfor step in range({10 * steps}): total += step & 3"

    def run(processes: int) -> None:
        started = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(processes)]
        for process in started:
            process.wait()

    return 2 * seconds(lambda: run(1)) / seconds(lambda: run(2))


@pytest.mark.slow
def test_two_workers_are_nearly_twice_as_fast() -> None:
    """Started once before, as in a run of several stages."""
    steps = round(1e6 * ITEM_S / seconds(lambda: count(1_000_000)))
    work = [steps] * ITEMS
    measured = []
    with open_workers(WorkerSettings(2)) as workers:
        for _ in workers.each(count, [1000] * 4):
            pass
        for _ in range(ROUNDS):
            before = plain_gain(steps)
            one_s = seconds(lambda: [count(item) for item in work])
            two_s = seconds(lambda: list(workers.each(count, work)))
            free = min(before, plain_gain(steps))
            expected = EXPECTED if free >= TWO_FREE_CORES else EXPECTED * free / 2
            measured.append((one_s / two_s, expected))
            if one_s / two_s >= expected:
                return
    pytest.fail(f"gains of two workers, and what was expected: {measured}")
