"""Two workers are nearly twice as fast as one."""

import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing import get_context

import pytest

from roadscope.benchmarks import (
    Eligibility,
    Episode,
    Job,
    RunOptions,
    WorkerSettings,
    detection_source,
    open_workers,
)
from roadscope.benchmarks.boards import BOARDS, track_node
from roadscope.trackers import TRACKERS

ITEMS = 40
JOBS = 20
ITEM_S = 0.1
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
    code = f"total = 0\nfor step in range({5 * steps}): total += step & 3"

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


def processor_s(job: Job) -> float:
    """Return the processor time of a tracker on kept detections, and of its scores."""
    before = time.process_time()
    job.board.score(job, job.answers.compute(RunOptions()), RunOptions())
    return time.process_time() - before


@pytest.mark.slow
def test_a_small_job_costs_no_more_in_a_worker() -> None:
    """No more than in two plain processes at once, in processor time.

    Two that share a core cost more than one alone. The start of workers is left out.
    """
    rule, episode = Eligibility(), Episode("two-way", 3, "lux", 4.0)
    tracker = TRACKERS.resolve("nearest")
    job = Job(
        BOARDS["tracking"],
        "nearest",
        episode,
        track_node(tracker, detection_source("noisy"), episode, rule),
        settings=rule,
    )
    with get_context("spawn").Pool(2) as plain:
        here = plain.map(processor_s, [job] * JOBS, chunksize=1)
    with open_workers(WorkerSettings(2)) as workers:
        there = [cost for _, cost in workers.each(processor_s, [job] * JOBS)]
    half = JOBS // 2
    assert statistics.median(there[half:]) < 1.5 * statistics.median(here[half:])
