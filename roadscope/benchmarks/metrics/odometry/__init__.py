"""How well estimated poses follow true ones."""

from roadscope.benchmarks.metrics.odometry.errors import (
    KITTI_M,
    SHORT_M,
    AbsoluteErrors,
    Drift,
    RelativeErrors,
    StandingScores,
    absolute_errors,
    by_distance,
    drift,
    relative_errors,
    rests,
    score_standing,
)
from roadscope.benchmarks.metrics.odometry.moving_returns import MovingScores, score_moving
from roadscope.benchmarks.metrics.odometry.scores import OdometryScores, drift_curve, score_odometry
from roadscope.benchmarks.metrics.odometry.trajectory import Trajectories

__all__ = [
    "KITTI_M",
    "SHORT_M",
    "AbsoluteErrors",
    "Drift",
    "MovingScores",
    "OdometryScores",
    "RelativeErrors",
    "StandingScores",
    "Trajectories",
    "absolute_errors",
    "by_distance",
    "drift",
    "drift_curve",
    "relative_errors",
    "rests",
    "score_moving",
    "score_odometry",
    "score_standing",
]
