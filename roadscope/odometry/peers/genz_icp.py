"""GenZ-ICP: point to plane and point to point, weighted by how planar the surroundings are."""

from __future__ import annotations

from typing import ClassVar

from roadscope.core import Requirement
from roadscope.core.arguments import check_positive
from roadscope.odometry.peers.adapter import OdometryAdapter
from roadscope.odometry.peers.interface import BOUNDS_M, LibraryScan, Placed


class GenzIcpOdometry(OdometryAdapter):
    """GenZ-ICP (Lee 2024) with its parameters for outdoor places.

    These parameters leave deskewing off, because they were chosen on deskewed data. Here it is on:
    to the stamp, at constant velocity. GenZ-ICP does not use an IMU.

    The library (0.3.2) keeps state beyond an instance: a second one in the same process gives other
    poses for the same scans. Boards run it in a new process for each episode.
    """

    requires: ClassVar = Requirement("genz-icp", "pip install roadscope[peers]")

    def __init__(
        self,
        *,
        voxel_m: float = 0.6,
        points: int = 3000,
        planarity: float = 0.2,
        voxel_points: int = 3,
        deskew: bool = True,
        ground: bool = True,
    ) -> None:
        """Store the settings.

        voxel_m, points, planarity, voxel_points: `voxel_size`, `desired_num_voxelized_points`,
            `planarity_threshold`, `max_points_per_voxel`.
        """
        check_positive(
            voxel_m=voxel_m, points=points, planarity=planarity, voxel_points=voxel_points
        )
        mapping = {
            "voxel_size": voxel_m,
            "desired_num_voxelized_points": points,
            "planarity_threshold": planarity,
            "max_points_per_voxel": voxel_points,
        }
        super().__init__(lambda _: _GenzIcp(mapping, deskew), ground=ground)


class _GenzIcp:
    """`genz_icp.genz_icp.GenZICP` as a library of `OdometryAdapter`."""

    def __init__(self, mapping: dict[str, float], deskew: bool) -> None:
        from genz_icp.config import GenZConfig
        from genz_icp.genz_icp import GenZICP

        config = GenZConfig()
        config.data.min_range, config.data.max_range = BOUNDS_M
        config.data.deskew = deskew
        for name, value in mapping.items():
            setattr(config.mapping, name, value)
        self._genz, self._deskew = GenZICP(config), deskew
        self._step_s = 0.0

    def place(self, scan: LibraryScan) -> Placed:
        # A point of time 0.5 stays where it is; 1 is the motion between the last two scans.
        swept = self._deskew and scan.swept and self._step_s
        times = 0.5 + scan.after_s / self._step_s if swept else None
        self._genz.register_frame(scan.points, times)
        self._step_s = scan.elapsed_s
        return Placed(self._genz.last_pose, scan.stamp_s)
