"""Tracking metrics, and all scores of a tracker on an episode."""

from roadscope.benchmarks.metrics.tracking.scores import (
    TrackingScores,
    score_alphas,
    score_tracks,
)
from roadscope.benchmarks.metrics.tracking.sequence import GATE_M

__all__ = ["GATE_M", "TrackingScores", "score_alphas", "score_tracks"]
