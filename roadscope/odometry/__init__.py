"""Odometries by name."""

from roadscope.core import Registry
from roadscope.odometry.api import Odometry

ODOMETRIES: Registry[Odometry] = Registry(
    "odometry",
    {
        "still": "roadscope.odometry.still:StillOdometry",
        "dead-reckoning": "roadscope.odometry.dead_reckoning:DeadReckoningOdometry",
        "scan-to-scan": "roadscope.odometry.voxel_map:VoxelMapOdometry?memory=scan",
        "voxel-map": "roadscope.odometry.voxel_map:VoxelMapOdometry",
    },
    group="roadscope.odometry",
    summaries={
        "still": "Never moves: the lowest mark.",
        "dead-reckoning": "The IMU alone, from a start at rest: the lower mark.",
        "scan-to-scan": "Surfaces of the last scan only.",
        "voxel-map": "Surfaces in voxels of three sizes, from all scans: ours.",
    },
)

__all__ = ["ODOMETRIES", "Odometry"]
