"""What the calls of a plug-in cost."""

from __future__ import annotations

import numpy as np

from roadscope.benchmarks.metrics.score import Score


def cost(calls_ms: np.ndarray) -> dict[str, Score]:
    """Return median and 99th percentile of a plug-in's calls.

    The first is left out: where plug-ins are not ours, it may compile or load what they need.
    """
    counted = calls_ms[1:] if len(calls_ms) > 1 else calls_ms
    middle, worst = np.percentile(counted, [50, 99]) if len(counted) else (np.nan, np.nan)
    return {
        "call_p50_ms": Score(float(middle), "ms", "lower", len(counted)),
        "call_p99_ms": Score(float(worst), "ms", "lower", len(counted)),
    }
