"""How well tracks follow the objects that could be seen."""

from roadscope.benchmarks.metrics.tracking.scores import TrackingScores, score_tracks
from roadscope.benchmarks.metrics.tracking.sequence import GATE_M

__all__ = ["GATE_M", "TrackingScores", "score_tracks"]
