"""One hypothesis of where a sensor is and how fast: its filter and its map."""

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
    observe,
    propagate,
    settle,
)
from roadscope.odometry.inertial.speed_search import GROUND_SHARE, LOWEST_M, NEAR_M, TALLEST_M
from roadscope.odometry.rigid import exp_so3, hat, log_so3, orthonormal
from roadscope.odometry.voxels.free_space import CERTAIN, FreeSpace
from roadscope.odometry.voxels.matching import (
    SHIFT_M,
    TURN_RAD,
    Match,
    contradicts,
    normal_equations,
)
from roadscope.odometry.voxels.surfaces import FLOOR_M, VoxelMap, Voxels
from roadscope.odometry.voxels.sweep import Sweep

# --------------------------------------------------------------------------------------------------
# A scan and an inertial prediction together: the pose that fits both best.

STEPS = 8
SIMILAR = 20.0
"""So many returns are worth one: neighbours err alike, by the same misfit surface."""
NARROW, WIDEST = 3.0, 12.0
"""Standard deviations off its surface at which a return counts for a quarter, in the end and at
first where the prediction is vague."""
SURFACE_M = 0.04
OPEN = 400.0
"""Information, 1/m^2, about a shift that clutter and the pattern of the beams feign: what there is
counts by how far it is above this."""


def settled_on(
    voxels: Voxels,
    points: np.ndarray,
    pose: np.ndarray,
    covariance: np.ndarray,
    *,
    doubt_m: float = 0.0,
    floor_m: float = FLOOR_M,
) -> Match:
    """Move (N, 3) points, metres, onto the surfaces, held by a prediction.

    pose: (4, 4), predicted. covariance: (6, 6) of its place and turn, map's axes. doubt_m: how far
    the surfaces may have moved together over the ground. floor_m: what points are off surfaces that
    are known perfectly. The match's information has nothing in directions in which the surfaces
    leave the scan free.
    """
    held = np.linalg.inv(covariance + 1e-12 * np.eye(6)) * SIMILAR
    vague_m = float(np.sqrt(np.trace(covariance[:3, :3])))
    scale = min(NARROW + vague_m / SURFACE_M, WIDEST)
    at = pose.copy()
    for _ in range(STEPS):
        H, b, _ = normal_equations(voxels, points, at, scale, floor_m)
        H, b = _doubted(*_without_open(H, b), doubt_m)
        off = np.concatenate([at[:3, 3] - pose[:3, 3], log_so3(at[:3, :3] @ pose[:3, :3].T)])
        move = -np.linalg.solve(H + held, b + held @ off)
        at[:3, 3] += move[:3]
        at[:3, :3] = exp_so3(move[3:]) @ at[:3, :3]
        small = np.abs(move[:3]).max() < SHIFT_M and np.abs(move[3:]).max() < TURN_RAD
        if small and scale == NARROW:
            break
        scale = max(NARROW, 0.6 * scale)
    at = orthonormal(at)
    H, b, told = normal_equations(voxels, points, at, NARROW, floor_m)
    H, _ = _doubted(*_without_open(H, b), doubt_m)
    return Match(at, H / SIMILAR, len(points), int(told[0]), float(told[1]))


def _without_open(H: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations with less of what they say of shifts in directions that are open."""
    values, axes = np.linalg.eigh(H[:3, :3])
    values = np.maximum(values, 0.0)
    shares = values / (values + OPEN)
    half, whole = np.eye(6), np.eye(6)
    half[:3, :3] = (axes * np.sqrt(shares)) @ axes.T
    whole[:3, :3] = (axes * shares) @ axes.T
    return half @ H @ half, whole @ b


def _doubted(H: np.ndarray, b: np.ndarray, doubt_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations with that error added which the surfaces have in common."""
    if not doubt_m:
        return H, b
    error = np.zeros((6, 6))
    error[0, 0] = error[1, 1] = doubt_m**2 / SIMILAR
    shares = np.linalg.inv(np.eye(6) + H @ error)
    return shares @ H, shares @ b


# --------------------------------------------------------------------------------------------------
# One assumption of where a sensor is and how fast: its filter, its map, its looks.

COASTING = (4.0, 1.0)
"""What vehicles may do that no samples tell, m/s^2 and rad/s^2."""
SLOW_M_S = 0.3
"""Who is held to be faster drives on, however steadily."""
STANDING_M_S, RESTING_RAD_S, RESTING_M_S2 = 5e-3, 1e-3, 3e-3
RENEWED_S = 1.0
"""So long after it a scan is placed by what scans since then have put in the map: their errors are
in it, and no measurement of a pose in it tells more than how scans lie to one another."""
WANDER = np.array([0.3] * 3 + [0.01] * 3)
"""By no more than this, m and rad, where scans tell nothing."""
CLOSE_FLOOR_M = 0.02
"""Between near walls the whole map hangs on few scans that were taken nearby, whose errors in
attitude it has: what is met again from elsewhere is as much off as this at least."""
SLIPPING = 6.0
"""Standard deviations by which wheels that turn freely or are locked are off."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Inertial samples over a stretch; `lengths_s` is empty where there are none.

    elapsed_s: of the whole. sweep_rate: (3,) rad/s, mean over the sweep that ends it, or None.
    """

    elapsed_s: float
    lengths_s: np.ndarray
    rates: np.ndarray
    forces: np.ndarray
    sweep_rate: np.ndarray | None


class InertialTrack:
    """Follows a sensor from a state, on a map of its own.

    lever: (3,) metres, place of the inertial unit in the LiDAR's frame. doubt_m: how far what the
    map holds may have moved together, while samples tell the way better.
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
        self.rate, self.felt, self.elapsed_s = np.zeros(3), True, 0.0
        self.doubt_m = 0.0
        self.map = VoxelMap(reach_m=reach_m)
        self.space = FreeSpace()

    @property
    def pose(self) -> np.ndarray:
        """Return (4, 4) `map_from_lidar`."""
        matrix = self.state.pose.copy()
        matrix[:3, 3] -= matrix[:3, :3] @ self.lever
        return matrix

    def predict(self, stretch: Stretch, *, still: bool = False) -> None:
        """Carry the state on to the next stamp; still: only take over how it turns there."""
        if stretch.sweep_rate is not None:
            self.rate = stretch.sweep_rate - self.state.rate_bias
        if still or not stretch.elapsed_s:
            return
        self.felt, self.elapsed_s = bool(len(stretch.lengths_s)), stretch.elapsed_s
        if len(stretch.lengths_s):
            propagate(self.state, stretch.lengths_s, stretch.rates, stretch.forces, self.noise)
        else:
            coast(self.state, self.rate, stretch.elapsed_s, COASTING)

    def twist(self) -> np.ndarray:
        """Return the LiDAR's (6,) velocity and turn rate, its own frame."""
        body = self.state.pose[:3, :3].T @ self.state.velocity
        return np.concatenate([body - np.cross(self.rate, self.lever), self.rate])

    def seen(self, sweep: Sweep) -> np.ndarray:
        """Return (K, 3) points of a sweep as seen at its stamp, from the inertial unit."""
        points: np.ndarray = sweep.at_stamp(self.twist()) - self.lever
        return points

    def moving(self, points: np.ndarray, stamp_s: float) -> np.ndarray:
        """Return (K,) bool, which points have moved to where they are."""
        here, seen = placed(points, self.state.pose), points + self.lever
        votes = self.space.entered(stamp_s, here, np.where(_of_vehicles(seen)[:, None], seen, 0.0))
        return votes >= CERTAIN

    def matched(self, sweep: Sweep, points: np.ndarray, moving: np.ndarray) -> Match:
        """Return where the surfaces and the prediction together put a sweep's (K, 3) points."""
        few = sweep.few[~moving[sweep.few]] if self.drop_dynamic else sweep.few
        covariance = self.state.covariance[POSE, POSE]
        doubt_m = self.doubt_m if self.felt else 0.0
        return settled_on(
            self.map.voxels,
            points[few],
            self.state.pose,
            covariance,
            doubt_m=doubt_m,
            floor_m=CLOSE_FLOOR_M if sweep.close else FLOOR_M,
        )

    def settle(self, found: Match) -> None:
        """Take over what was found."""
        before = self.state.pose
        settle(self.state, found.map_from_sensor, found.information)
        if not self.slow:
            self._wander(found)
        if not self.felt:
            turned = log_so3(before[:3, :3].T @ self.state.pose[:3, :3])
            self.rate = self.rate + turned / self.elapsed_s

    def _wander(self, found: Match) -> None:
        """Let the map go on with a share of the error of the scan that is put there."""
        sure = np.linalg.inv(found.information + np.diag(WANDER**-2.0))
        self.state.covariance[POSE, POSE] += min(self.elapsed_s / RENEWED_S, 1.0) * sure

    @property
    def slow(self) -> bool:
        """Whether the sensor may stand: nobody goes up who does not go ahead."""
        return float(np.linalg.norm(self.state.velocity[:2])) <= SLOW_M_S

    @property
    def unfelt_m_s2(self) -> float:
        """Return what acceleration goes unnoticed at most: three deviations of a bias."""
        return 3 * self.noise.force_bias if self.felt else COASTING[0]

    def stand(self, rate: np.ndarray) -> None:
        """Take it that the sensor stands, while its gyro reads a (3,) rate."""
        J = np.zeros((6, SIZE))
        J[:3, SPEED], J[3:, GYRO] = np.eye(3), np.eye(3)
        off = np.concatenate([-self.state.velocity, rate - self.state.rate_bias])
        observe(self.state, J, off, np.array([STANDING_M_S**2] * 3 + [RESTING_RAD_S**2] * 3))

    def weigh(self, force: np.ndarray) -> None:
        """Take it that a (3,) force, m/s^2, is gravity's alone, and the bias."""
        to_sensor, gravity = self.state.pose[:3, :3].T, self.state.gravity
        J = np.zeros((3, SIZE))
        J[:, TURN], J[:, GRAVITY] = -to_sensor @ hat(gravity), -to_sensor
        J[:, FORCE] = np.eye(3)
        off = force + to_sensor @ gravity - self.state.force_bias
        observe(self.state, J, off, np.full(3, RESTING_M_S2**2))

    def looked_off_m_s(self, spread_m_s: float) -> float:
        """Return the standard deviation of what is seen of the speed ahead from what is held.

        spread_m_s: that of what is seen from the truth.
        """
        ahead = self.state.pose[:3, 0]
        variance = float(ahead @ self.state.covariance[SPEED, SPEED] @ ahead)
        return float(np.hypot(np.sqrt(variance), spread_m_s))

    def speed_up(self, off_m_s: float, spread_m_s: float) -> None:
        """Take a measured difference to the speed ahead."""
        J = np.zeros((1, SIZE))
        J[0, SPEED] = self.state.pose[:3, 0]
        observe(self.state, J, np.array([off_m_s]), np.array([spread_m_s**2]))

    def roll(self, speed_m_s: float, variance: float, *, doubted: bool) -> bool:
        """Take what wheels tell; say whether it was taken: if doubted, not what is far off."""
        ahead, velocity = self.state.pose[:3, 0], self.state.velocity
        held_m_s = float(ahead @ velocity)
        scale = 1 + self.state.wheel_scale
        J = np.zeros((1, SIZE))
        J[0, SPEED], J[0, TURN], J[0, WHEELS] = (
            scale * ahead,
            scale * np.cross(ahead, velocity),
            held_m_s,
        )
        off_m_s = speed_m_s - scale * held_m_s
        expected = float((J @ self.state.covariance @ J.T)[0, 0]) + variance
        if doubted and off_m_s**2 > SLIPPING**2 * expected:
            return False
        observe(self.state, J, np.array([off_m_s]), np.array([variance]))
        return True

    def remember(self, sweep: Sweep, points: np.ndarray, moving: np.ndarray) -> None:
        """Put (K, 3) points into the map but those that move, or off a surface that is known."""
        here = placed(points, self.state.pose)
        if self.drop_dynamic:
            here = here[~(moving | contradicts(self.map.voxels, here))]
        self.map.add(here, self.state.pose[:3, 3])
        scan = sweep.scan
        if self.space.due(scan.stamp_s):
            whole = deskewed(scan.points, scan.time_offset_s, self.twist())
            self.space.add(scan.stamp_s, whole, scan.ring, self.pose)


def _of_vehicles(seen: np.ndarray) -> np.ndarray:
    """Return (N,) bool, which points, as the sensor sees them, are as high as vehicles are."""
    flat = np.hypot(seen[:, 0], seen[:, 1])
    near = seen[flat < NEAR_M, 2]
    ground_m = np.quantile(near, GROUND_SHARE) if len(near) else -np.inf
    above: np.ndarray = seen[:, 2] - ground_m
    return (above > LOWEST_M) & (above < TALLEST_M)
