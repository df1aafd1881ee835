"""How well tracks follow the objects that could be seen."""

from roadscope.benchmarks.metrics.tracking.scores import GATE_M, TrackingScores, score_tracks

__all__ = ["GATE_M", "TrackingScores", "score_tracks"]
