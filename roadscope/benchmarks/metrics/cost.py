"""Cost of a plug-in's calls in time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.metrics.score import Score


def cost(calls_ms: np.ndarray, percentiles: Sequence[int] = (50, 99)) -> dict[str, Score]:
    """Return percentiles of the time of calls, `call_pN_ms`, milliseconds; nan without a call.

    The first call is left out, because it may compile or load what a plug-in needs, unless it is
    the only one.

    calls_ms: (N,).
    """
    counted = calls_ms[1:] if len(calls_ms) > 1 else calls_ms
    values = (
        np.percentile(counted, percentiles) if len(counted) else np.full(len(percentiles), np.nan)
    )
    return {
        f"call_p{percent}_ms": Score(float(value), "ms", "lower", len(counted))
        for percent, value in zip(percentiles, values, strict=True)
    }
