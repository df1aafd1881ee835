"""Odometries by name."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names
from roadscope.core import Registry
from roadscope.odometry.api import Odometry

if TYPE_CHECKING:
    from roadscope.odometry.api import WheeledOdometry
    from roadscope.odometry.cloud_kernels import placed, thinned
    from roadscope.odometry.estimates import estimate
    from roadscope.odometry.mounted import MountedOdometry
    from roadscope.odometry.voxels.matching import PosePrior, ScanMatch, best_match
    from roadscope.odometry.voxels.surfaces import VoxelMap

ODOMETRIES: Registry[Odometry] = Registry(
    "odometry",
    {
        "still": "roadscope.odometry.still:StillOdometry",
        "dead-reckoning": "roadscope.odometry.dead_reckoning:DeadReckoningOdometry",
        "scan-to-scan": "roadscope.odometry.voxel_map:VoxelMapOdometry?memory=scan",
        "voxel-map": "roadscope.odometry.voxel_map:VoxelMapOdometry",
        "zhang2022": "roadscope.odometry.zhang:ZhangOdometry",
        "zhang2022-guarded": "roadscope.odometry.zhang:ZhangOdometry?guarded=true&dimensions=2"
        "&sampled=0.01",
        "zhang2022-map": "roadscope.odometry.zhang:ZhangOdometry?map_every=5",
        "zhang2022-loop": "roadscope.odometry.zhang:ZhangOdometry?map_every=5&loop=true",
        "loam": "roadscope.odometry.zhang:ZhangOdometry?windows=False&drop_dynamic=False"
        "&same_cluster=False&guarded=true",
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
        "still": "Never moves: a lower mark.",
        "dead-reckoning": "The IMU alone, from a start at rest: a lower mark.",
        "scan-to-scan": "Surfaces of the last scan only.",
        "voxel-map": "Surfaces in voxels of three sizes, from all scans: ours.",
        "zhang2022": "Edges and planes of static clusters (Zhang 2022).",
        "zhang2022-guarded": "zhang2022 that distrusts some wrong predictions: ours.",
        "zhang2022-map": "zhang2022, then LeGO-LOAM's map of static clusters.",
        "zhang2022-loop": "zhang2022-map, with loops closed.",
        "loam": "Edges and planes, scan to scan: zhang2022 without clusters.",
        "lidar-inertial": "A Kalman filter on the IMU and a map of static surfaces: ours.",
        "lego-loam": "Ground planes, then edges, then a map: Shan and Englot 2018.",
        "lego-loam-loop": "lego-loam, with loops closed.",
        "kiss-icp": "KISS-ICP: points against a map of points.",
        "small-gicp-scan": "small_gicp, each scan onto the previous one.",
        "small-gicp": "small_gicp, each scan onto a map of voxels.",
        "genz-icp": "GenZ-ICP: planes and points, weighted by planarity.",
        "rko-lio": "RKO-LIO: a map of points, and the IMU.",
    },
)

_PLACES = {
    "WheeledOdometry": "roadscope.odometry.api:WheeledOdometry",
    "MountedOdometry": "roadscope.odometry.mounted:MountedOdometry",
    "PosePrior": "roadscope.odometry.voxels.matching:PosePrior",
    "ScanMatch": "roadscope.odometry.voxels.matching:ScanMatch",
    "VoxelMap": "roadscope.odometry.voxels.surfaces:VoxelMap",
    "best_match": "roadscope.odometry.voxels.matching:best_match",
    "estimate": "roadscope.odometry.estimates:estimate",
    "placed": "roadscope.odometry.cloud_kernels:placed",
    "thinned": "roadscope.odometry.cloud_kernels:thinned",
}
"""Public name -> `module:attribute`, loaded when first used."""

__all__ = [
    "ODOMETRIES",
    "MountedOdometry",
    "Odometry",
    "PosePrior",
    "ScanMatch",
    "VoxelMap",
    "WheeledOdometry",
    "best_match",
    "estimate",
    "placed",
    "thinned",
]

_PARTS = {
    "above_ground": "sensor_height",
    "api": "update_with_wheels",
    "clock": "Clock RESTART",
    "cloud_kernels": "deskewed",
    "dead_reckoning": "DeadReckoningOdometry",
    "eigen_kernels": "eigen3",
    "estimates": "LOST",
    "imu_buffer": "ImuBuffer NO_SAMPLES",
    "lego_loam": "LegoLoamOdometry",
    "lidar_inertial": "LidarInertialOdometry",
    "rigid": "adjoint exp_se3 exp_so3 hat inverse log_se3 log_so3 orthonormal",
    "scatter": "LARGEST_NOISE_M LEAST_TRIPLES excessive_noise range_noise_m",
    "still": "StillOdometry",
    "travel": "direction_of_travel turned_back turned_scan",
    "zhang": "LARGEST_DYNAMIC_SHARE DynamicThreshold ZhangOdometry ZhangSettings",
}
"""What else the tests of this repository use, by the file that defines it. It is not public."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES, _PARTS)
