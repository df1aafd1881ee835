"""A hypothesis of a sensor's pose and speed: its filter and its map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.odometry.cloud_kernels import deskewed, placed
from roadscope.odometry.inertial.filter import (
    FORCE,
    GRAVITY,
    GYRO,
    POSE,
    SIZE,
    SPEED,
    TURN,
    WHEELS,
    InertialNoise,
    InertialState,
    coast,
    propagate,
    update_linear,
    update_pose,
)
from roadscope.odometry.inertial.speed_search import GROUND_SHARE, LOWEST_M, NEAR_M, TALLEST_M
from roadscope.odometry.rigid import hat, log_so3, orthonormal
from roadscope.odometry.voxels.free_space import CERTAIN, FreeSpace
from roadscope.odometry.voxels.matching import (
    PosePrior,
    ScanMatch,
    contradicts,
    normal_equations,
    take_gauss_newton_step,
)
from roadscope.odometry.voxels.surfaces import FLOOR_M, VoxelMap, Voxels
from roadscope.odometry.voxels.sweep import ThinnedScan

# --------------------------------------------------------------------------------------------------
# The pose that fits a scan and an inertial prediction best.

STEPS = 8
"""Greatest number of Gauss-Newton steps."""
SIMILAR_ON_SURFACE = 20.0
"""Number of returns that count as one: errors of neighbours on one surface are correlated."""
NARROW, WIDEST, NARROWING = 3.0, 12.0, 0.6
"""Robust scale in standard deviations: in the last steps, at first with a vague prediction, and its
factor from step to step."""
SURFACE_M = 0.04
"""Usual standard deviation of a return from its surface."""
UNREAL = 400.0
"""Information, 1/m^2, about a shift that clutter and the beam pattern produce by themselves, also
where no surface bounds the shift, as along a tunnel; real information must exceed it."""


def matched_with_prediction(
    voxels: Voxels,
    points: np.ndarray,
    pose: np.ndarray,
    covariance: np.ndarray,
    *,
    doubt_m: float = 0.0,
    floor_m: float = FLOOR_M,
) -> ScanMatch:
    """Match (N, 3) points, metres, with the surfaces, with a predicted pose as prior.

    pose: (4, 4), predicted. covariance: (6, 6) of its position and rotation, map's axes. doubt_m:
    standard deviation of a common horizontal motion of all surfaces. floor_m: least standard
    deviation of a point from a surface. The match has no information in directions in which the
    surfaces do not constrain the scan.
    """
    prior = PosePrior(pose, np.linalg.inv(covariance + 1e-12 * np.eye(6)) * SIMILAR_ON_SURFACE)
    vague_m = float(np.sqrt(np.trace(covariance[:3, :3])))
    scale = min(NARROW + vague_m / SURFACE_M, WIDEST)
    estimate = pose.copy()
    for _ in range(STEPS):
        H, b, _ = normal_equations(voxels, points, estimate, scale, floor_m)
        H, b = _with_common_error(*_without_unreal(H, b), doubt_m)
        small = take_gauss_newton_step(estimate, prior, H + prior.information, b)
        if small and scale == NARROW:
            break
        scale = max(NARROW, NARROWING * scale)
    estimate = orthonormal(estimate)
    H, b, sums = normal_equations(voxels, points, estimate, NARROW, floor_m)
    H, _ = _with_common_error(*_without_unreal(H, b), doubt_m)
    return ScanMatch(estimate, H / SIMILAR_ON_SURFACE, len(points), int(sums[0]), float(sums[1]))


def _without_unreal(H: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations with less information about shifts where it hardly exceeds `UNREAL`."""
    values, axes = np.linalg.eigh(H[:3, :3])
    values = np.maximum(values, 0.0)
    shares = values / (values + UNREAL)
    half, whole = np.eye(6), np.eye(6)
    half[:3, :3] = (axes * np.sqrt(shares)) @ axes.T
    whole[:3, :3] = (axes * shares) @ axes.T
    return half @ H @ half, whole @ b


def _with_common_error(
    H: np.ndarray, b: np.ndarray, doubt_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations with a common error of all surfaces added."""
    if not doubt_m:
        return H, b
    error = np.zeros((6, 6))
    error[0, 0] = error[1, 1] = doubt_m**2 / SIMILAR_ON_SURFACE
    shares = np.linalg.inv(np.eye(6) + H @ error)
    return shares @ H, shares @ b


# --------------------------------------------------------------------------------------------------
# The hypothesis.

COASTING_M_S2, COASTING_RAD_S2 = 4.0, 1.0
"""Acceleration and change of rate that are likely in vehicles without samples."""
SLOW_M_S = 0.3
"""A faster vehicle is not at rest, however steadily it drives."""
STANDING_M_S, RESTING_RAD_S, RESTING_M_S2 = 5e-3, 1e-3, 3e-3
"""Standard deviations at rest: of the velocity, the turn rate and the specific force."""
RENEWED_S = 1.0
"""Time after which the map around the sensor consists of newer scans, with the errors of their
poses: by these errors the map drifts."""
DRIFT_LIMITS = np.array([0.3] * 3 + [0.01] * 3)
"""Standard deviations of that drift, m and rad, in directions without information."""
CLOSE_FLOOR_M = 0.02
"""Least standard deviation of a point between near walls: there the map consists of few scans from
nearby and has their errors of attitude."""
SLIPPING = 6.0
"""A wheel speed that is so many standard deviations off is of wheels that slip or are locked."""


@dataclass(frozen=True, slots=True)
class ImuInterval:
    """Inertial samples over an interval; `lengths_s` is empty without samples.

    elapsed_s: its duration. sweep_rate: (3,) rad/s, mean over the sweep at its end, or None.
    """

    elapsed_s: float
    lengths_s: np.ndarray
    rates: np.ndarray
    forces: np.ndarray
    sweep_rate: np.ndarray | None


class InertialTrack:
    """Follows a sensor from a state, with its own map.

    lever: (3,) metres, position of the inertial unit in the LiDAR's frame. reach_m: radius of the
    map. drop_dynamic: whether dynamic returns are left out. doubt_m: standard deviation of a common
    motion of everything in the map, used while there are samples.
    """

    def __init__(
        self,
        state: InertialState,
        lever: np.ndarray,
        noise: InertialNoise,
        *,
        reach_m: float,
        drop_dynamic: bool = True,
    ) -> None:
        self.state, self.lever, self.noise = state, lever, noise
        self.drop_dynamic = drop_dynamic
        self.rate, self.has_samples, self.elapsed_s = np.zeros(3), True, 0.0
        self.doubt_m = 0.0
        self.map = VoxelMap(reach_m=reach_m)
        self.space = FreeSpace()

    @property
    def pose(self) -> np.ndarray:
        """(4, 4) `map_from_lidar`."""
        matrix = self.state.pose.copy()
        matrix[:3, 3] -= matrix[:3, :3] @ self.lever
        return matrix

    def predict(self, interval: ImuInterval, *, still: bool = False) -> None:
        """Predict the state at the next stamp; still: only update the turn rate."""
        if interval.sweep_rate is not None:
            self.rate = interval.sweep_rate - self.state.rate_bias
        if still or not interval.elapsed_s:
            return
        self.has_samples, self.elapsed_s = bool(len(interval.lengths_s)), interval.elapsed_s
        if len(interval.lengths_s):
            propagate(self.state, interval.lengths_s, interval.rates, interval.forces, self.noise)
        else:
            coast(
                self.state,
                self.rate,
                interval.elapsed_s,
                acceleration_m_s2=COASTING_M_S2,
                rotation_rad_s2=COASTING_RAD_S2,
            )

    def twist(self) -> np.ndarray:
        """Return the LiDAR's (6,) velocity and turn rate, LiDAR frame."""
        body = self.state.pose[:3, :3].T @ self.state.velocity
        return np.concatenate([body - np.cross(self.rate, self.lever), self.rate])

    def points_at_stamp(self, sweep: ThinnedScan) -> np.ndarray:
        """Return (K, 3) deskewed points of a sweep at its stamp, relative to the inertial unit."""
        points: np.ndarray = sweep.at_stamp(self.twist()) - self.lever
        return points

    def moving(self, points: np.ndarray, stamp_s: float) -> np.ndarray:
        """Return (K,) whether points are dynamic, see `FreeSpace.entered`."""
        points_in_map, from_lidar = placed(points, self.state.pose), points + self.lever
        # Only vehicles can move along with the sensor; 0 marks points that are not of vehicles.
        votes = self.space.entered(
            stamp_s, points_in_map, np.where(_of_vehicles(from_lidar)[:, None], from_lidar, 0.0)
        )
        return votes >= CERTAIN

    def matched(self, sweep: ThinnedScan, points: np.ndarray, moving: np.ndarray) -> ScanMatch:
        """Return the match of a sweep's (K, 3) points with the map and the prediction."""
        rows = sweep.matched_rows
        rows = rows[~moving[rows]] if self.drop_dynamic else rows
        covariance = self.state.covariance[POSE, POSE]
        doubt_m = self.doubt_m if self.has_samples else 0.0
        return matched_with_prediction(
            self.map.voxels,
            points[rows],
            self.state.pose,
            covariance,
            doubt_m=doubt_m,
            floor_m=CLOSE_FLOOR_M if sweep.close else FLOOR_M,
        )

    def update_by_match(self, scan_match: ScanMatch) -> None:
        """Update the state with a match."""
        before = self.state.pose
        update_pose(self.state, scan_match.map_from_sensor, scan_match.information)
        if not self.slow:
            self._add_map_drift(scan_match)
        if not self.has_samples:
            turned = log_so3(before[:3, :3].T @ self.state.pose[:3, :3])
            self.rate = self.rate + turned / self.elapsed_s

    def _add_map_drift(self, scan_match: ScanMatch) -> None:
        """Add the drift of the map to the covariance: a share of the error of the new scan."""
        scan_error = np.linalg.inv(scan_match.information + np.diag(DRIFT_LIMITS**-2.0))
        self.state.covariance[POSE, POSE] += min(self.elapsed_s / RENEWED_S, 1.0) * scan_error

    @property
    def slow(self) -> bool:
        """Whether the sensor may be at rest; vertical speed does not count."""
        return float(np.linalg.norm(self.state.velocity[:2])) <= SLOW_M_S

    @property
    def hidden_acceleration_m_s2(self) -> float:
        """Largest acceleration that samples do not show: three deviations of a bias."""
        return 3 * self.noise.force_bias if self.has_samples else COASTING_M_S2

    def correct_at_rest(self, rate: np.ndarray) -> None:
        """Update the state with a sensor at rest whose gyro measures a (3,) rate."""
        J = np.zeros((6, SIZE))
        J[:3, SPEED], J[3:, GYRO] = np.eye(3), np.eye(3)
        residual = np.concatenate([-self.state.velocity, rate - self.state.rate_bias])
        update_linear(
            self.state, J, residual, np.array([STANDING_M_S**2] * 3 + [RESTING_RAD_S**2] * 3)
        )

    def correct_gravity(self, force: np.ndarray) -> None:
        """Update the state with a (3,) specific force, m/s^2, that is only gravity and bias."""
        to_sensor, gravity = self.state.pose[:3, :3].T, self.state.gravity
        J = np.zeros((3, SIZE))
        J[:, TURN], J[:, GRAVITY] = -to_sensor @ hat(gravity), -to_sensor
        J[:, FORCE] = np.eye(3)
        residual = force + to_sensor @ gravity - self.state.force_bias
        update_linear(self.state, J, residual, np.full(3, RESTING_M_S2**2))

    def speed_deviation_m_s(self, spread_m_s: float) -> float:
        """Return the standard deviation of measured minus estimated speed ahead, m/s.

        spread_m_s: standard deviation of the measurement.
        """
        ahead = self.state.pose[:3, 0]
        variance = float(ahead @ self.state.covariance[SPEED, SPEED] @ ahead)
        return float(np.hypot(np.sqrt(variance), spread_m_s))

    def correct_speed(self, off_m_s: float, spread_m_s: float) -> None:
        """Update the state with a measured error of its speed ahead.

        off_m_s: measured minus estimated speed. spread_m_s: standard deviation of the measurement.
        """
        J = np.zeros((1, SIZE))
        J[0, SPEED] = self.state.pose[:3, 0]
        update_linear(self.state, J, np.array([off_m_s]), np.array([spread_m_s**2]))

    def correct_by_wheels(self, speed_m_s: float, variance: float, *, doubted: bool) -> bool:
        """Update the state with a speed of wheels; return False if it was rejected as an outlier.

        doubted: whether outliers are rejected.
        """
        ahead, velocity = self.state.pose[:3, 0], self.state.velocity
        estimated_m_s = float(ahead @ velocity)
        scale = 1 + self.state.wheel_scale
        J = np.zeros((1, SIZE))
        J[0, SPEED], J[0, TURN], J[0, WHEELS] = (
            scale * ahead,
            scale * np.cross(ahead, velocity),
            estimated_m_s,
        )
        off_m_s = speed_m_s - scale * estimated_m_s
        expected = float((J @ self.state.covariance @ J.T)[0, 0]) + variance
        if doubted and off_m_s**2 > SLIPPING**2 * expected:
            return False
        update_linear(self.state, J, np.array([off_m_s]), np.array([variance]))
        return True

    def add_to_map(self, sweep: ThinnedScan, points: np.ndarray, moving: np.ndarray) -> None:
        """Add (K, 3) points to the map, except dynamic ones and those that contradict a surface."""
        points_in_map = placed(points, self.state.pose)
        if self.drop_dynamic:
            points_in_map = points_in_map[~(moving | contradicts(self.map.voxels, points_in_map))]
        self.map.add(points_in_map, self.state.pose[:3, 3])
        scan = sweep.scan
        if self.space.due(scan.stamp_s):
            whole = deskewed(scan.points, scan.time_offset_s, self.twist())
            self.space.add(scan.stamp_s, whole, scan.ring, self.pose)


def _of_vehicles(points: np.ndarray) -> np.ndarray:
    """Return (N,) whether points, sensor frame, have a height that vehicles can have."""
    flat = np.hypot(points[:, 0], points[:, 1])
    near = points[flat < NEAR_M, 2]
    ground_m = np.quantile(near, GROUND_SHARE) if len(near) else -np.inf
    above: np.ndarray = points[:, 2] - ground_m
    return (above > LOWEST_M) & (above < TALLEST_M)
