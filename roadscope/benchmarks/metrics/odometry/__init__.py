"""How well estimated poses follow true ones."""

from roadscope.benchmarks.metrics.odometry.absolute import AbsoluteErrors, absolute_errors
from roadscope.benchmarks.metrics.odometry.drift import KITTI_M, SHORT_M, Drift, drift
from roadscope.benchmarks.metrics.odometry.relative import RelativeErrors, relative_errors
from roadscope.benchmarks.metrics.odometry.scores import OdometryScores, drift_curve, score_odometry
from roadscope.benchmarks.metrics.odometry.trajectory import Trajectories

__all__ = [
    "KITTI_M",
    "SHORT_M",
    "AbsoluteErrors",
    "Drift",
    "OdometryScores",
    "RelativeErrors",
    "Trajectories",
    "absolute_errors",
    "drift",
    "drift_curve",
    "relative_errors",
    "score_odometry",
]
