"""Content of `leaderboard.json` from arrays of scores, for tests."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from roadscope.benchmarks.metrics import Score


def job(
    entry: str,
    seed: int,
    scores: Mapping[str, float | Score],
    *,
    board: str = "tracking",
    scenario: str = "motorway",
    condition: str = "clear",
    inputs: str = "pag",
    reason: str | None = None,
) -> dict[str, Any]:
    whole = {k: v if isinstance(v, Score) else score(v) for k, v in scores.items()}
    return {
        "board": board,
        "entry": entry,
        "scenario": scenario,
        "seed": seed,
        "condition": condition,
        "inputs": inputs,
        "scores": {name: value.to_json() for name, value in whole.items()},
        "reason": reason,
    }


def score(value: float, **fields: Any) -> Score:
    return Score(float(value), **{"unit": "1", "better": "higher", "n": 100, **fields})


def run(jobs: Sequence[dict[str, Any]], **manifest: Any) -> dict[str, Any]:
    return {"manifest": manifest, "rows": [], "scores": list(jobs)}


def run_of(values: np.ndarray, entry: str = "mine", **fields: Any) -> dict[str, Any]:
    """Return a run of one entry; values: (seeds, metrics), metric k is called `m<k>`."""
    return run(
        [
            job(entry, seed, {f"m{k}": score(v, **fields) for k, v in enumerate(row)})
            for seed, row in enumerate(values)
        ]
    )
