"""A street of boxes, driven through at constant speed and turn rate, with scans and IMU."""

from functools import cache

import numpy as np

from roadscope.core import ImuSamples, LidarScan
from roadscope.odometry import exp_se3

ELEVATIONS = np.deg2rad(np.arange(-15, 16, 2.0))
COLUMNS, PERIOD_S, HEIGHT_M, RATE_HZ = 360, 0.1, 1.9, 400
GRAVITY_M_S2 = 9.81
FINE = {"zhang2022", "zhang2022-guarded", "zhang2022-map", "zhang2022-loop"}
"""Odometries that cut what they see by angles: they are shown the columns of a real VLP-16."""


@cache
def street(seed=0):
    """Centres and half sizes, (B, 3), of houses, poles and bins on both sides of a road."""
    rng = np.random.default_rng(seed)
    houses = [
        (x, s * rng.uniform(12, 16), 3, rng.uniform(3, 6), 3, 6)
        for s in (-1, 1)
        for x in np.arange(-40, 80, 14.0)
    ]
    poles = [
        (x + rng.uniform(-3, 3), s * 8, 3, 0.1, 0.1, 4)
        for s in (-1, 1)
        for x in np.arange(-40, 80, 17.0)
    ]
    boxes = np.array(houses + poles)
    return boxes[:, :3], boxes[:, 3:]


def ranges(origins, ways):
    """Distance along (N, 3) unit rays to ground or boxes; inf where there is nothing."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ground = np.where(ways[:, 2] < 0, -origins[:, 2] / ways[:, 2], np.inf)
        centres, halves = street()
        enter, leave = -np.inf, np.inf
        for axis in range(3):
            sides = np.stack([centres - halves, centres + halves])[:, :, axis, None]
            low, high = (sides - origins[:, axis]) / ways[:, axis]
            enter = np.maximum(enter, np.minimum(low, high))
            leave = np.minimum(leave, np.maximum(low, high))
    hit = np.where((enter <= leave) & (enter > 0), enter, np.inf)
    return np.minimum(ground, hit.min(axis=0))


def beams(azimuths, ring):
    """(N, 3) directions of beams."""
    flat = np.cos(ELEVATIONS[ring])
    return np.column_stack(
        [flat * np.cos(azimuths), flat * np.sin(azimuths), np.sin(ELEVATIONS[ring])]
    )


class ToyDrive:
    """Constant speed and turn rate; every scan a full turn of 16 beams around its stamp.

    Both may grow from nothing during the first `ramp_s` seconds. A real VLP-16 has 1800 columns.
    """

    def __init__(
        self, speed_m_s=8.0, yaw_rate_rad_s=0.1, noise_m=0.01, seed=0, ramp_s=0.0, columns=COLUMNS
    ):
        self.twist = np.array([speed_m_s, 0, 0, 0, 0, yaw_rate_rad_s])
        self.noise_m, self.seed, self.ramp_s, self.columns = noise_m, seed, ramp_s, columns

    def _driven_s(self, stamps_s):
        """For how long it would have driven at full speed to be where it is at some stamps."""
        if not self.ramp_s:
            return stamps_s - 0.05
        ramped = np.clip(stamps_s, 0, self.ramp_s)
        return ramped**2 / self.ramp_s / 2 + np.maximum(stamps_s - self.ramp_s, 0)

    def pose(self, stamp_s):
        """`start_from_lidar` at a stamp; the first scan's is 0.05 s."""
        return exp_se3(self.twist * self._driven_s(stamp_s))

    def scan(self, k):
        rng = np.random.default_rng([self.seed, k])
        stamp_s = 0.05 + PERIOD_S * k
        offsets = (np.arange(self.columns) + 0.5) / self.columns * PERIOD_S - PERIOD_S / 2
        azimuths = -np.linspace(-np.pi, np.pi, self.columns, endpoint=False)
        column, ring = np.divmod(np.arange(16 * self.columns), 16)
        driven_s = self._driven_s(stamp_s + offsets)
        yaws = self.twist[5] * driven_s
        chords = self.twist[0] * driven_s * np.sinc(yaws / (2 * np.pi))
        origins = np.column_stack(
            [chords * np.cos(yaws / 2), chords * np.sin(yaws / 2), np.full(self.columns, HEIGHT_M)]
        )[column]
        reach = ranges(origins, beams((azimuths + yaws)[column], ring))
        reach = reach + self.noise_m * rng.standard_normal(len(reach))
        in_range = reach < 80
        n = int(in_range.sum())
        ring, column = ring[in_range].astype(np.int16), column[in_range].astype(np.int32)
        points = (reach[in_range, None] * beams(azimuths[column], ring)).astype(np.float32)
        return LidarScan(points, np.full(n, 0.5), ring, column, offsets[column], stamp_s, "lidar")

    def imu(self, k, bias=(0.0, 0.0, 0.0)):
        """Samples from the end of scan k - 1 to that of scan k."""
        stamps = np.arange(round(PERIOD_S * RATE_HZ)) / RATE_HZ + PERIOD_S * k
        speed, rate = self.twist[0], self.twist[5]
        share = np.clip(stamps / self.ramp_s, 0, 1) if self.ramp_s else np.ones(len(stamps))
        push = speed * (stamps < self.ramp_s) / max(self.ramp_s, 1e-9)
        up = np.full(len(stamps), GRAVITY_M_S2)
        return ImuSamples(
            stamps,
            share[:, None] * [0, 0, rate] + bias,
            np.column_stack([push, share**2 * speed * rate, up]),
        )


def columns_for(name):
    return 1800 if name in FINE else COLUMNS


@cache
def moment(speed_m_s, k, columns=COLUMNS):
    drive = ToyDrive(speed_m_s, columns=columns)
    return drive.scan(k), drive.imu(k)


def driven(scans=12, speed_m_s=8.0, columns=COLUMNS):
    """A drive with its scans and IMU blocks, which are kept: tests leave them alone."""
    drive = ToyDrive(speed_m_s, columns=columns)
    return drive, [moment(speed_m_s, k, columns) for k in range(scans)]


def emptied(scan):
    return scan.select(np.zeros(len(scan), bool))


def offset(estimate, truth):
    """Metres and radians between an estimate and a (4, 4) truth."""
    rest = np.linalg.inv(truth) @ estimate.start_from_lidar.matrix
    turn = np.arccos(np.clip((np.trace(rest[:3, :3]) - 1) / 2, -1, 1))
    return float(np.linalg.norm(rest[:3, 3])), float(turn)


class ScansInMemory:
    """Scans that are not in files."""

    def __init__(self, scans: list[LidarScan]) -> None:
        self.scans, self.stamps_s = scans, [scan.stamp_s for scan in scans]

    def __len__(self) -> int:
        return len(self.scans)

    def part(self, first: int, end: int):
        return iter(self.scans[first:end])
