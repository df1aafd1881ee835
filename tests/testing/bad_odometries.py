"""Odometries as a user would bring them, most of them bad."""

import os
import time

import numpy as np

from roadscope import OdometryEstimate, OdometryStatus, Pose


def estimate_of(scan, x=0.0, **changed):
    fields = {
        "start_from_lidar": Pose.planar(x, 0.0, 0.0),
        "covariance": np.zeros((6, 6)),
        "dynamic": np.zeros(len(scan), bool),
        "stamp_s": scan.stamp_s,
    }
    if not len(scan):
        fields |= {"status": OdometryStatus.DEGRADED, "reason": "no returns"}
    return OdometryEstimate(**(fields | changed))


class Good:
    """Goes on at 10 m/s, whatever it sees."""

    def __init__(self, *, step_m=1.0):
        self.step_m = step_m

    def reset(self, lidar_from_imu=None):
        self.x = -self.step_m

    def update(self, scan, imu=None):
        self.x += self.step_m
        return estimate_of(scan, self.x)


class Unsaid:
    """Says by its answer alone that it is an odometry."""

    def reset(self, mounting=None): ...

    def update(self, sweep, samples=None) -> OdometryEstimate:
        return estimate_of(sweep)


class WithoutMounting(Good):
    def reset(self):
        self.x = 0.0


class ReturnsMatrix(Good):
    def update(self, scan, imu=None):
        return np.eye(4)


class WrongStamp(Good):
    def update(self, scan, imu=None):
        return estimate_of(scan, stamp_s=scan.stamp_s + 1)


class ForgetsReturns(Good):
    def update(self, scan, imu=None):
        return estimate_of(scan, dynamic=np.zeros(3, bool))


class StartsElsewhere(Good):
    def update(self, scan, imu=None):
        return estimate_of(scan, 3.0)


class FliesOff(Good):
    def update(self, scan, imu=None):
        return estimate_of(scan, 1e9)


class ReturnsNan(Good):
    def update(self, scan, imu=None):
        return estimate_of(scan, np.nan)


class NeedsImu(Good):
    def update(self, scan, imu=None):
        self.last_s = imu.stamps_s[-1]
        return super().update(scan, imu)


class NeedsReturns(Good):
    def update(self, scan, imu=None):
        assert scan.points.min() < 0
        return super().update(scan, imu)


class Scribbles(Good):
    def update(self, scan, imu=None):
        scan.points[:] = 0
        return super().update(scan, imu)


class Random(Good):
    def update(self, scan, imu=None):
        self.x += np.random.default_rng().random() if self.x >= 0 else 0
        return super().update(scan, imu)


class KeepsTheFirstScan(Good):
    """Takes its speed from the first scan ever, which no reset makes it forget."""

    first = None

    def update(self, scan, imu=None):
        self.first = self.first or float(np.abs(scan.points).mean())
        self.x += self.step_m
        return estimate_of(scan, self.x * self.first / 10)


class Raises(Good):
    def update(self, scan, imu=None):
        raise KeyError("what is this")


class Hangs(Good):
    def update(self, scan, imu=None):
        time.sleep(600)


class Ends(Good):
    def update(self, scan, imu=None):
        os._exit(3)


class Greedy(Good):
    def update(self, scan, imu=None):
        self.much = np.ones((64, 1024, 1024, 1024))
        return super().update(scan, imu)
