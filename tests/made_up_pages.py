"""Results and moments for pages, made up."""

from typing import Any

import msgspec
import numpy as np

from roadscope.benchmarks.metrics import Score
from roadscope.benchmarks.report import ReplayMoment
from roadscope.benchmarks.results import JobScores, Results, results_of

HOSTILE = (
    "<img src=x onerror=alert(1)>",
    "</script><script>alert(1)</script>",
    '" onmouseover="alert(1)" x=\'',
    "{{ 7 * 7 }}{% raw %}",
    "<!-- <script>",
    "javascript:alert(1)",
)
SCENARIOS = ("motorway", "merge")
SHARES = ("hota", "mota", "idf1")


def results(
    *,
    entry: str = "poor",
    suite: str = "tiny",
    reason: str = "ZeroDivisionError: too small",
    log: str = "last words",
    more: int = 0,
    detectors: tuple[str, ...] = ("pag",),
    seeds: int = 4,
) -> Results:
    """Return a tracking board of `good`, of an entry that fails on one seed, and of a mark.

    more: how many entries with long names, close to each other, stand beside them. detectors:
    whose detections they get.
    """
    crowd = [(f"one of many entries alike, number {k}", 0.3 + 0.03 * k) for k in range(more)]
    jobs = [
        _job(name, scenario, seed, base, detector)
        for name, base in (("good", 0.8), (entry, 0.5), ("good on oracle", 0.95), *crowd)
        for scenario in SCENARIOS
        for seed in range(seeds)
        for detector in detectors
    ]
    failed = JobScores(
        "tracking", entry, "motorway", 9, "clear", "pag", {}, f"{entry}: {reason}", log=log
    )
    manifest = {"suite": suite, "suite_version": 1, "seeds": [0, 1], "boards": ["tracking"]}
    return results_of([*jobs, failed], manifest | {"libraries": {"numpy": "2"}})


def _job(entry: str, scenario: str, seed: int, base: float, detector: str) -> JobScores:
    figure = base + 0.02 * seed
    shares = {name: Score(figure - k / 50, "1", "higher", 100) for k, name in enumerate(SHARES)}
    times = {name: Score(10.0 * base**2, "ms", "lower", 50) for name in ("call_p50_ms",)}
    return JobScores(
        "tracking",
        entry,
        scenario,
        seed,
        "clear",
        detector,
        shares | times,
        mark="upper mark" if "oracle" in entry else None,
        conditions={"scenario": scenario, "condition": "clear", "weather": "clear"},
    )


def moment(entry: str, **fields: Any) -> ReplayMoment:
    """Return a second of traffic: one object is tracked, one is missed, one track is false."""
    frames = 11
    ahead = np.column_stack([np.full(frames, 8), np.zeros((frames, 2))]).astype(int)
    still = np.zeros((frames, 3), int)

    def motion(steps: np.ndarray, x: int, y: int) -> list[int]:
        first = steps.copy()
        first[0] = (x, y, 0)
        return [int(value) for value in first.ravel()]

    usual: dict[str, Any] = {
        "board": "tracking",
        "entry": entry,
        "kind": "misses",
        "text": "1 of 2 objects are missed: car 8 at 30 m",
        "scenario": "motorway",
        "seed": 3,
        "condition": "clear",
        "inputs": "pag",
        "event": 5,
        "times_s": [k / 10 for k in range(frames)],
        "ego": motion(ahead, 0, 0),
        "focus": (150, 0, 300, 150),
        "objects": [
            (4, 0, "m" * frames, 46, 18, motion(ahead, 200, 0)),
            (8, 0, "mm" + "x" * (frames - 2), 46, 18, motion(still, 300, 35)),
        ],
        "answers": [
            (1, 0, "m" * 5 + "s" + "m" * 5, 46, 18, motion(ahead, 200, 2)),
            (2, 3, "ff.f", 46, 18, motion(still, 250, -60)[:9]),
        ],
        "lanes": [(35, [-500, 0, 2000, 0]), (35, [-500, 35, 1000, 0, 1000, 10])],
    }
    return msgspec.convert(usual | fields, ReplayMoment)
