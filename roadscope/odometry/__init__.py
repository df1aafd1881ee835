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
        "zhang2022": "roadscope.odometry.zhang:ZhangOdometry",
        "zhang2022-map": "roadscope.odometry.zhang:ZhangOdometry?map_every=5",
        "zhang2022-loop": "roadscope.odometry.zhang:ZhangOdometry?map_every=5&loop=true",
        "loam": "roadscope.odometry.zhang:ZhangOdometry?windows=False&drop_dynamic=False"
        "&same_cluster=False",
        "lidar-inertial": "roadscope.odometry.lidar_inertial:LidarInertialOdometry",
        "lego-loam": "roadscope.odometry.lego_loam:LegoLoamOdometry",
        "lego-loam-loop": "roadscope.odometry.lego_loam:LegoLoamOdometry?loop=true",
        "kiss-icp": "roadscope.odometry.peers.kiss_icp:KissIcpOdometry",
        "small-gicp-scan": "roadscope.odometry.peers.small_gicp:SmallGicpScanOdometry",
        "small-gicp": "roadscope.odometry.peers.small_gicp:SmallGicpOdometry",
        "genz-icp": "roadscope.odometry.peers.genz_icp:GenzIcpOdometry",
        "rko-lio": "roadscope.odometry.peers.rko_lio:RkoLioOdometry",
    },
    group="roadscope.odometry",
    summaries={
        "still": "Never moves: the lowest mark.",
        "dead-reckoning": "The IMU alone, from a start at rest: the lower mark.",
        "scan-to-scan": "Surfaces of the last scan only.",
        "voxel-map": "Surfaces in voxels of three sizes, from all scans: ours.",
        "zhang2022": "Edges and planes of clusters that stand still (Zhang 2022).",
        "zhang2022-map": "The same, then LeGO-LOAM's map of what stands still.",
        "zhang2022-loop": "The same, with loops closed.",
        "loam": "Edges and planes from scan to scan: Zhang 2022's chain, no clusters.",
        "lidar-inertial": "A Kalman filter on the IMU and a map of what stands still: ours.",
        "lego-loam": "Ground planes, then edges, then a map: Shan and Englot 2018.",
        "lego-loam-loop": "The same, with loops closed.",
        "kiss-icp": "KISS-ICP: points against a map of points.",
        "small-gicp-scan": "small_gicp, each scan onto the one before.",
        "small-gicp": "small_gicp, each scan onto a map of voxels.",
        "genz-icp": "GenZ-ICP: planes and points, weighed by the place.",
        "rko-lio": "RKO-LIO: a map of points, and the IMU.",
    },
)

__all__ = ["ODOMETRIES", "Odometry"]
