"""Odometries by name."""

from roadscope.core import Registry
from roadscope.odometry.api import Odometry

ODOMETRIES: Registry[Odometry] = Registry(
    "odometry",
    {
        "still": "roadscope.odometry.still:StillOdometry",
    },
    group="roadscope.odometry",
    summaries={
        "still": "Never moves: the lowest mark.",
    },
)

__all__ = ["ODOMETRIES", "Odometry"]
