"""Tracking metrics, and all scores of a tracker on an episode."""

from roadscope._lazy import lazy_names
from roadscope.benchmarks.metrics.tracking.scores import (
    TrackingScores,
    score_each_alpha,
    score_tracks,
)
from roadscope.benchmarks.metrics.tracking.sequence import GATE_M

__all__ = ["GATE_M", "TrackingScores", "score_each_alpha", "score_tracks"]

_PARTS = {
    "amota": "NUSCENES_RECALLS RECALLS least_scores",
    "clear": "count_matches",
    "matching": "match_tracks",
    "scores": "ALPHA_BANDS BY_ALPHA CURVES NEVER Recovery recovery",
    "sequence": "SIMILARITIES similarity_by_distance",
    "state_accuracy": "FrameRows Nees StateErrors chi_square nees state_errors",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
