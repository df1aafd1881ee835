"""KISS-ICP: points against a map of points."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from roadscope.core import Requirement
from roadscope.core.arguments import check_positive
from roadscope.odometry.peers.adapter import OdometryAdapter
from roadscope.odometry.peers.interface import BOUNDS_M, LibraryScan, Placed
from roadscope.odometry.rigid import exp_se3, log_se3


class KissIcpOdometry(OdometryAdapter):
    """KISS-ICP (Vizzo 2023) as its authors ship it: voxels of 1 m for 100 m, deskewing on.

    It deskews to the last point of a scan at constant velocity and does not use an IMU. For
    scans that it did not get, its last pose is predicted, which it does not do by itself.
    """

    requires: ClassVar = Requirement("kiss-icp", "pip install roadscope[peers]")

    def __init__(self, *, voxel_m: float = 1.0, deskew: bool = True, ground: bool = True) -> None:
        """Store the settings; voxel_m: `mapping.voxel_size`, by default a hundredth of the range.

        ground: see `OdometryAdapter`, also for the other peers.
        """
        check_positive(voxel_m=voxel_m)
        super().__init__(lambda _: _KissIcp(voxel_m, deskew), ground=ground)


class _KissIcp:
    """`kiss_icp.kiss_icp.KissICP` as a library of `OdometryAdapter`."""

    def __init__(self, voxel_m: float, deskew: bool) -> None:
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP

        config = KISSConfig()
        config.data.min_range, config.data.max_range = BOUNDS_M
        config.data.deskew = deskew
        config.mapping.voxel_size = voxel_m
        config.registration.max_num_threads = 1
        self._kiss, self._deskew = KissICP(config), deskew
        self._step_s = 0.0

    def place(self, scan: LibraryScan) -> Placed:
        swept = self._deskew and scan.swept
        self._leap(scan.elapsed_s)
        # A scan without deskewing belongs to its stamp rather than to its end.
        still = bool((self._kiss.last_delta == np.eye(4)).all())
        self._kiss.register_frame(scan.points, scan.after_s if swept else np.empty(0))
        at_s = scan.stamp_s + (scan.after_s.max() if swept and not still else 0.0)
        return Placed(self._kiss.last_pose, float(at_s))

    def _leap(self, elapsed_s: float) -> None:
        """Predict the last pose if more than one step has passed since."""
        extra_s = elapsed_s - self._step_s
        if 0 < self._step_s < 2 * extra_s:
            twist = log_se3(self._kiss.last_delta) / self._step_s
            self._kiss.last_pose = self._kiss.last_pose @ exp_se3(twist * extra_s)
        else:
            self._step_s = elapsed_s
