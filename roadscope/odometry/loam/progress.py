"""Poses from steps between scans: prediction, deskewing, and the returns that give features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import ImuSamples, Pose
from roadscope.core.jit import compiled
from roadscope.odometry.estimates import WEAKEST_M, propagated_covariance
from roadscope.odometry.imu_buffer import BIAS_GAIN, ImuBuffer
from roadscope.odometry.loam.feature_match import FeatureMatch
from roadscope.odometry.loam.features import Features
from roadscope.odometry.rigid import exp_se3, exp_so3, inverse, log_se3, log_so3

# --------------------------------------------------------------------------------------------------
# Prediction of the motion between two scans by the IMU (Zhang 2022, eq. 3).

GRAVITY_GAIN = 0.01
"""Like `BIAS_GAIN`, for gravity; smaller, since speeds are noisy."""


class ImuPrediction:
    """Integrates turn rates once and specific forces twice over the time between two scans.

    Our reading: the paper takes the displacement from the IMU and names no initial speed. Ours is
    the speed of the last step of the odometry. Gravity together with the accelerometer's bias, and
    the gyro's bias, are learned from steps. Without samples the motion continues at constant
    velocity.

    velocity: (3,) m/s, turning: (3,) rad/s, now, lidar frame.
    """

    def __init__(self, lidar_from_imu: Pose | None) -> None:
        self.samples = ImuBuffer(lidar_from_imu)
        self._lever = np.zeros(3) if lidar_from_imu is None else lidar_from_imu.translation.copy()
        self.velocity, self.turning = np.zeros(3), np.zeros(3)
        self._bias, self._gravity = np.zeros(3), np.full(3, np.nan)
        self._end_velocity, self._rate, self._force = np.zeros(3), np.zeros(3), np.full(3, np.nan)

    def add(self, imu: ImuSamples | None) -> None:
        """Take further samples."""
        self.samples.add(imu)

    def motion(self, start_s: float, end_s: float) -> np.ndarray:
        """Return (4, 4) `before_from_now`, from the last scan to the one at the end."""
        elapsed_s = end_s - start_s
        self._force[:] = np.nan
        if not self.samples.covers(start_s, end_s):
            self._end_velocity = exp_so3(-self.turning * elapsed_s) @ self.velocity
            return exp_se3(np.concatenate([self.velocity, self.turning]) * elapsed_s)
        lengths, rates, forces = self.samples.within(start_s, end_s)
        self._rate = lengths @ rates / elapsed_s
        if np.isnan(self._gravity[0]):
            self._gravity = lengths @ forces / elapsed_s
        state = np.array([self.velocity, self._gravity, self._lever, self._bias])
        moved, self._end_velocity, self._force = _integrated(lengths, rates, forces, state)
        return moved

    def learn(self, predicted: np.ndarray, motion: np.ndarray, elapsed_s: float) -> None:
        """Learn speed, biases and gravity from the motion of the scans and the predicted one."""
        back = motion[:3, :3].T
        start, measured = self.velocity, not np.isnan(self._force[0])
        velocity_error = back @ (motion[:3, 3] - predicted[:3, 3]) / elapsed_s
        self.velocity = self._end_velocity + velocity_error
        self.turning = log_so3(motion[:3, :3]) / elapsed_s
        if not measured:
            self._end_velocity = self.velocity = back @ motion[:3, 3] / elapsed_s
            return
        self._bias = self._bias + BIAS_GAIN * (self._rate - self._bias - self.turning)
        gained = (self.velocity - back @ start) / elapsed_s
        observed = back @ self._force - gained
        self._gravity = back @ self._gravity
        self._gravity += GRAVITY_GAIN * (observed - self._gravity)

    def carry_on(self, predicted: np.ndarray, elapsed_s: float) -> None:
        """Accept the prediction as the motion."""
        self.velocity = self._end_velocity
        self.turning = log_so3(predicted[:3, :3]) / elapsed_s
        if not np.isnan(self._force[0]):
            self._gravity = predicted[:3, :3].T @ self._gravity


@compiled()
def _integrated(
    lengths: np.ndarray, rates: np.ndarray, forces: np.ndarray, state: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the motion (4, 4), the velocity at the end (3,) and the mean force (3,).

    The velocity is in the frame at the end, the force in the frame at the start.

    lengths: (K,) s. rates, forces: (K, 3). state: (4, 3) speed, gravity, place of the IMU and
    bias of its gyro.
    """
    velocity, gravity, lever, bias = (
        state[0].copy(),
        state[1].copy(),
        state[2].copy(),
        state[3].copy(),
    )
    first = rates[0] - bias
    speed = velocity + np.cross(first, lever)
    turned, position, force, whole = np.eye(3), np.zeros(3), np.zeros(3), lengths.sum()
    for k in range(len(lengths)):
        dt = lengths[k]
        rate = rates[k] - bias
        # Half a step's turn: forces act in the middle of it.
        turned_force = turned @ (forces[k] + 0.5 * dt * np.cross(rate, forces[k]))
        force += turned_force * dt / whole
        position += speed * dt + 0.5 * dt * dt * (turned_force - gravity)
        speed += dt * (turned_force - gravity)
        turned = turned @ _turn(rate * dt)
    moved = np.eye(4)
    moved[:3, :3] = turned
    moved[:3, 3] = position + lever - turned @ lever
    last = rates[len(rates) - 1] - bias
    return moved, turned.T @ speed - np.cross(last, lever), force


@compiled()
def _turn(vector: np.ndarray) -> np.ndarray:
    """Return the (3, 3) rotation of a small rotation vector, (3,) radians."""
    angle = np.sqrt((vector**2).sum())
    x, y, z = vector
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    once = 1.0 - angle**2 / 6.0
    twice = 0.5 - angle**2 / 24.0
    rotation: np.ndarray = np.eye(3) + once * across + twice * (across @ across)
    return rotation


# --------------------------------------------------------------------------------------------------
# Deskew by interpolation (Zhang 2022, eq. 5).


def deskewed_between(
    points: np.ndarray, times_s: np.ndarray, before_from_now: np.ndarray, elapsed_s: float
) -> np.ndarray:
    """Return (N, 3) points in the sensor's frame at the stamp.

    points: (N, 3) metres, at (N,) seconds after the stamp. before_from_now: (4, 4), motion over
    the time elapsed up to the stamp, at constant velocity.

    Our reading: eq. 5 scales the whole matrix by the share of time, which leaves no rotation. Here
    the turn's angle and the displacement are scaled, and points are moved to the scan's stamp, not
    to its start.
    """
    share = times_s / elapsed_s
    turn = log_so3(before_from_now[:3, :3])
    shift = before_from_now[:3, :3].T @ before_from_now[:3, 3]
    return _interpolated(points, share, turn, shift)


@compiled()
def _interpolated(
    points: np.ndarray, share: np.ndarray, turn: np.ndarray, shift: np.ndarray
) -> np.ndarray:
    """Return (N, 3) points turned and shifted by their share of a turn, (3,), and a shift, (3,)."""
    angle = np.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    axis = turn / angle if angle > 0.0 else np.zeros(3)
    moved = np.empty((len(points), 3))
    for n in range(len(points)):
        x, y, z = np.float64(points[n, 0]), np.float64(points[n, 1]), np.float64(points[n, 2])
        s, c = np.sin(share[n] * angle), np.cos(share[n] * angle)
        # Rodrigues' formula: v cos + (k x v) sin + k (k.v)(1 - cos).
        along = (axis[0] * x + axis[1] * y + axis[2] * z) * (1.0 - c)
        moved[n, 0] = x * c + (axis[1] * z - axis[2] * y) * s + axis[0] * along
        moved[n, 1] = y * c + (axis[2] * x - axis[0] * z) * s + axis[1] * along
        moved[n, 2] = z * c + (axis[0] * y - axis[1] * x) * s + axis[2] * along
        for i in range(3):
            moved[n, i] += share[n] * shift[i]
    return moved


# --------------------------------------------------------------------------------------------------
# The pose after all steps from scan to scan.

LEAST_PAIRS = 20
"""Least number of pairs: fewer may agree by chance."""
ACCELERATION_M_S2, TURNING_RAD_S2 = 8.0, 2.0
"""Largest errors of a prediction: vehicles do not exceed these accelerations for long."""
WEAKEST_RAD = 0.05
"""Standard deviation of a turn by features, like `WEAKEST_M` of a displacement."""
SURE, PATIENCE = 5, 3
"""After `SURE` steps in a row as predicted, up to `PATIENCE` scans in a row that contradict the
prediction are rejected; after that the speed was wrong."""


class Progress:
    """The pose at the last scan that was matched, and at the latest one.

    pose, covariance: (4, 4) `start_from_lidar` and (6, 6), at the latest scan. stamp_s: of the
    last scan that counts. begun: whether a step has determined the speed.
    """

    def __init__(self, imu: ImuPrediction) -> None:
        self._imu = imu
        self.pose, self.covariance, self.stamp_s = np.eye(4), np.zeros((6, 6)), np.nan
        self._pose, self._covariance = self.pose, self.covariance
        self.begun = False
        self._agreed, self._doubted = 0, 0

    def since(self, stamp_s: float) -> float:
        """Return the time, s, since the last scan that counts; 1 s before the first."""
        return 1.0 if np.isnan(self.stamp_s) else stamp_s - self.stamp_s

    def predicted(self, stamp_s: float) -> np.ndarray:
        """Return the (4, 4) motion since the last scan that counts, to a stamp."""
        if np.isnan(self.stamp_s):
            return np.eye(4)
        return self._imu.motion(self.stamp_s, stamp_s)

    def step(
        self, predicted: np.ndarray, feature_match: FeatureMatch, stamp_s: float
    ) -> tuple[np.ndarray, str]:
        """Move by the features, or as predicted if these are insufficient.

        Returns the accepted (4, 4) motion `before_from_now`, and the reason why it is degraded.
        A motion far from a prediction that was right before is rejected for some scans: all
        features may belong to traffic that moves along.
        """
        misfit, elapsed_s = misfit_of(feature_match), stamp_s - self.stamp_s
        motion = predicted if misfit else with_prediction(predicted, feature_match)
        leap, trusted = leap_of(predicted, motion, elapsed_s), self._agreed >= SURE
        if misfit or (leap and trusted and self._doubted < PATIENCE):
            self._doubted += bool(leap)
            self.carry_on(predicted, stamp_s, counts=True)
            return predicted, misfit or leap
        self._agreed, self._doubted = (0 if leap else self._agreed + 1), 0
        self._imu.learn(predicted, motion, elapsed_s)
        self._arrive(motion, feature_match.covariance)
        self._count(stamp_s)
        self.begun = True
        return motion, leap if trusted else ""

    def carry_on(self, predicted: np.ndarray, stamp_s: float, *, counts: bool) -> None:
        """Move as predicted; counts: whether the next step begins here or where this one did."""
        elapsed_s = 0.0 if np.isnan(self.stamp_s) else stamp_s - self.stamp_s
        spread = np.array([ACCELERATION_M_S2] * 3 + [TURNING_RAD_S2] * 3) * elapsed_s**2
        self._arrive(predicted, np.diag(spread**2))
        if counts and elapsed_s > 0:
            self._imu.carry_on(predicted, elapsed_s)
        if counts:
            self._count(stamp_s)

    def _arrive(self, motion: np.ndarray, uncertain: np.ndarray) -> None:
        self.pose = self._pose @ motion
        self.covariance = propagated_covariance(self._covariance, motion, uncertain)

    def _count(self, stamp_s: float) -> None:
        self._pose, self._covariance, self.stamp_s = self.pose, self.covariance, stamp_s


def leap_of(predicted: np.ndarray, motion: np.ndarray, elapsed_s: float) -> str:
    """Return why a motion is impossible after the predicted one, or nothing."""
    difference = log_se3(inverse(predicted) @ motion)
    away_m, turned = np.linalg.norm(difference[:3]), np.linalg.norm(difference[3:])
    if away_m > WEAKEST_M + ACCELERATION_M_S2 * elapsed_s**2:
        return f"a leap of {away_m:.2g} m from the prediction"
    if turned > WEAKEST_RAD + TURNING_RAD_S2 * elapsed_s**2:
        return f"a leap of {turned:.2g} rad from the prediction"
    return ""


def with_prediction(predicted: np.ndarray, feature_match: FeatureMatch) -> np.ndarray:
    """Return the (4, 4) motion of features, displaced as predicted in unobservable directions.

    J. Zhang, M. Kaess and S. Singh, "On degeneracy of optimization-based state estimation
    problems", ICRA 2016.
    """
    motion = feature_match.before_from_now.copy()
    rotation = motion[:3, :3]
    variances, axes = np.linalg.eigh(rotation @ feature_match.covariance[:3, :3] @ rotation.T)
    observable = axes[:, variances < WEAKEST_M**2]
    motion[:3, 3] = predicted[:3, 3] + observable @ observable.T @ (
        motion[:3, 3] - predicted[:3, 3]
    )
    return motion


def misfit_of(feature_match: FeatureMatch) -> str:
    """Return why a motion is rejected; empty if it is accepted.

    Only horizontal directions count: vertically `with_prediction` uses the prediction.
    """
    if feature_match.pair_count < LEAST_PAIRS:
        return f"only {feature_match.pair_count} features match"
    weakest_m = float(np.sqrt(np.linalg.eigvalsh(feature_match.covariance[:2, :2])[-1]))
    if weakest_m > WEAKEST_M:
        return f"in one direction features show the motion only to {weakest_m:.2g} m"
    return ""


# --------------------------------------------------------------------------------------------------
# Returns that may become features.


@dataclass(frozen=True, slots=True, eq=False)
class ScanReturns:
    """The returns of a scan that may become features.

    points: (N, 3) float64, metres, lidar frame at each point's own time. ring, column: (N,) int64.
    times_s: (N,) float64, seconds after the stamp. rows: (N,) int64, in the scan.
    labels: (N,) int64, only features of the same label are matched; -1 for outliers.
    """

    points: np.ndarray
    ring: np.ndarray
    column: np.ndarray
    times_s: np.ndarray
    rows: np.ndarray
    labels: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def at_stamp(self, motion: np.ndarray, since_s: float) -> np.ndarray:
        """Return the (N, 3) points in the LiDAR's frame at the stamp, deskewed.

        motion: (4, 4) `before_from_now` over the time since_s.
        """
        return deskewed_between(self.points, self.times_s, motion, since_s)


def lack_of_features(returns: ScanReturns, features: Features) -> str:
    """Return why a scan has too few features to be matched; empty if it has enough."""
    if features.sharp + features.flat < LEAST_PAIRS:
        return f"only {features.sharp + features.flat} features"
    if returns.ring.min() == returns.ring.max():
        return "all returns are of one ring"
    return ""
