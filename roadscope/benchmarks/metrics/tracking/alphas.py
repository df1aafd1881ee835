"""HOTA and its parts at each alpha, as scores."""

from __future__ import annotations

import math
from collections.abc import Sequence

from roadscope.benchmarks.metrics.breakdown import part_name
from roadscope.benchmarks.metrics.matching import Pairing
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracking.counted import counted_rows, counted_sequence
from roadscope.benchmarks.metrics.tracking.hota import ALPHAS, hota
from roadscope.benchmarks.metrics.tracking.similarity import GATE_M
from roadscope.core import Tracks, Truth

BY_ALPHA = "alpha"
ALPHA_BANDS = tuple(f"{alpha:.2f}" for alpha in ALPHAS)
CURVES = ("det_a", "ass_a", "loc_a")


def score_alphas(
    tracks: Sequence[Tracks], truths: Sequence[Truth], pairings: Sequence[Pairing]
) -> dict[str, Score]:
    """Return HOTA, DetA, AssA and LocA of an episode at each alpha, by `part_name`.

    As in `score_tracks` they weigh as much as the episode has objects, so that, pooled, the mean
    over alphas of each is what is said of it there.
    """
    distances = [pairing.distances for pairing in pairings]
    sequence = counted_sequence(tracks, truths, distances, counted_rows(pairings, GATE_M))
    curves, objects = hota(sequence), len(sequence.truths)
    return {
        part_name(name, BY_ALPHA, band): Score(
            float(value) if objects else math.nan, "1", "higher", objects, 0.0, 1.0, weight=objects
        )
        for name in ("hota", *CURVES)
        for band, value in zip(ALPHA_BANDS, getattr(curves, name), strict=True)
    }
