"""small_gicp: distributions to distributions, from scan to scan or onto a map of voxels."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from roadscope.core import Requirement
from roadscope.core.arguments import check_counts, check_positive, check_positive_or_infinite
from roadscope.odometry.cloud_kernels import deskewed
from roadscope.odometry.peers.adapter import OdometryAdapter
from roadscope.odometry.peers.interface import BOUNDS_M, LibraryScan, Placed
from roadscope.odometry.rigid import exp_se3, inverse, log_se3, orthonormal

SMALL_GICP = Requirement("small_gicp", "pip install roadscope[peers]")
LRU = {"horizon": 100, "clear_cycle": 10}
"""Scans after which unused voxels are dropped, and scans between two checks, as in its KITTI
example."""


class SmallGicpOdometry(OdometryAdapter):
    """small_gicp (Koide 2024), each scan onto a map of Gaussian voxels, as in its KITTI example.

    It knows neither times nor ranges of points. Therefore scans are cut to 1 to 100 m and deskewed
    to the stamp here, at constant velocity; the search starts at the pose that this velocity
    predicts.
    """

    requires: ClassVar = SMALL_GICP

    def __init__(
        self,
        *,
        voxel_m: float = 1.0,
        downsample_m: float = 0.25,
        neighbours: int = 10,
        gate_m: float = 1.0,
        deskew: bool = True,
        ground: bool = True,
    ) -> None:
        """Store the settings.

        voxel_m: size of the map's voxels. downsample_m, neighbours: `downsampling_resolution` and
            `num_neighbors` of `preprocess_points`; gate_m: `max_correspondence_distance`. All three
            are its defaults.
        deskew: whether scans are deskewed. ground: see `OdometryAdapter`.
        """
        scans = _checked(downsample_m, neighbours, gate_m, deskew)
        check_positive(voxel_m=voxel_m)
        super().__init__(lambda _: _Gicp(scans, _GaussianVoxels(voxel_m)), ground=ground)


class SmallGicpScanOdometry(OdometryAdapter):
    """small_gicp (Koide 2024), each scan onto the one before; otherwise as `SmallGicpOdometry`."""

    requires: ClassVar = SMALL_GICP

    def __init__(
        self,
        *,
        downsample_m: float = 0.25,
        neighbours: int = 10,
        gate_m: float = 1.0,
        deskew: bool = True,
        ground: bool = True,
    ) -> None:
        """Store the settings; see `SmallGicpOdometry`."""
        scans = _checked(downsample_m, neighbours, gate_m, deskew)
        super().__init__(lambda _: _Gicp(scans, _LastScan()), ground=ground)


def _checked(downsample_m: float, neighbours: int, gate_m: float, deskew: bool) -> dict[str, Any]:
    check_positive(downsample_m=downsample_m)
    check_positive_or_infinite(gate_m=gate_m)
    check_counts(5, neighbours=neighbours)
    return {"size_m": downsample_m, "neighbours": neighbours, "gate_m": gate_m, "deskew": deskew}


class _GaussianVoxels:
    """All scans, as Gaussians in voxels."""

    def __init__(self, voxel_m: float) -> None:
        from small_gicp import GaussianVoxelMap

        self._voxels = GaussianVoxelMap(voxel_m)
        self._voxels.set_lru(**LRU)

    def add(self, cloud: Any, tree: Any, pose: np.ndarray) -> None:
        self._voxels.insert(cloud, pose)

    def aligned(self, cloud: Any, guess: np.ndarray, gate_m: float) -> np.ndarray:
        from small_gicp import align

        result = align(self._voxels, cloud, guess, max_correspondence_distance=gate_m)
        return np.asarray(result.T_target_source)


class _LastScan:
    """The last scan with its tree."""

    def add(self, cloud: Any, tree: Any, pose: np.ndarray) -> None:
        self._cloud, self._tree, self._pose = cloud, tree, pose

    def aligned(self, cloud: Any, guess: np.ndarray, gate_m: float) -> np.ndarray:
        from small_gicp import align

        start = inverse(self._pose) @ guess
        result = align(self._cloud, cloud, self._tree, start, max_correspondence_distance=gate_m)
        return np.asarray(self._pose @ result.T_target_source)


class _Gicp:
    """small_gicp's functions as a library of `OdometryAdapter`."""

    def __init__(self, scans: dict[str, Any], memory: _GaussianVoxels | _LastScan) -> None:
        self._scans, self._memory = scans, memory
        self._pose, self._twist = np.eye(4), np.zeros(6)

    def place(self, scan: LibraryScan) -> Placed:
        from small_gicp import preprocess_points

        points = scan.points
        if self._scans["deskew"]:
            points = deskewed(points, scan.after_s, self._twist)
        ranges = np.linalg.norm(points, axis=1)
        points = points[(ranges > BOUNDS_M[0]) & (ranges < BOUNDS_M[1])]
        cloud, tree = preprocess_points(
            points, self._scans["size_m"], num_neighbors=self._scans["neighbours"]
        )
        if scan.elapsed_s:
            guess = self._pose @ exp_se3(self._twist * scan.elapsed_s)
            # Rounding in a rotation would treble from scan to scan.
            pose = orthonormal(self._memory.aligned(cloud, guess, self._scans["gate_m"]))
            self._twist = log_se3(inverse(self._pose) @ pose) / scan.elapsed_s
            self._pose = pose
        self._memory.add(cloud, tree, self._pose)
        return Placed(self._pose, scan.stamp_s)
