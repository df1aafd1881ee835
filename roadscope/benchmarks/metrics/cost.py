"""What the calls of a plug-in cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.metrics.score import Score


def cost(calls_ms: np.ndarray, percentiles: Sequence[int] = (50, 99)) -> dict[str, Score]:
    """Return percentiles of a plug-in's calls, the median and the 99th if not told otherwise.

    The first is left out: where plug-ins are not ours, it may compile or load what they need.
    """
    counted = calls_ms[1:] if len(calls_ms) > 1 else calls_ms
    values = (
        np.percentile(counted, percentiles) if len(counted) else np.full(len(percentiles), np.nan)
    )
    return {
        f"call_p{percent}_ms": Score(float(value), "ms", "lower", len(counted))
        for percent, value in zip(percentiles, values, strict=True)
    }
