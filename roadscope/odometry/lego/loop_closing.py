"""Loop closing: places visited again, and the correction of the poses between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from roadscope.odometry.lego.point_map import Keyframe, KeyframeMap
from roadscope.odometry.loam.progress import misfit_of
from roadscope.odometry.rigid import adjoint, exp_se3, hat, inverse, log_se3, orthonormal

# --------------------------------------------------------------------------------------------------
# Point-to-point ICP (Besl and McKay 1992).

ICP_STEPS = 30
"""Most steps of ICP, each with a new search for pairs."""
INLIER_SHARE = 0.8
"""Share of the pairs, the nearest ones, that are used: parts of a scan have no counterpart."""


def icp_motion(
    points: np.ndarray, target: np.ndarray, start: np.ndarray, reach_m: float
) -> np.ndarray:
    """Return the (4, 4) `target_from_points` that brings (N, 3) points onto (M, 3) others.

    start: (4, 4), initial value. reach_m: greatest distance of a pair.
    """
    from scipy.spatial import cKDTree

    pose, tree = start.copy(), cKDTree(target)
    for _ in range(ICP_STEPS):
        moved = points @ pose[:3, :3].T + pose[:3, 3]
        distances, nearest = tree.query(moved, distance_upper_bound=reach_m)
        bound = (
            np.quantile(distances[np.isfinite(distances)], INLIER_SHARE)
            if np.isfinite(distances).any()
            else 0.0
        )
        inliers = distances <= bound
        if inliers.sum() < 6:
            return pose
        move = best_motion(moved[inliers], target[nearest[inliers]])
        pose = move @ pose
        if np.abs(log_se3(move)).max() < 1e-3:
            break
    return pose


def overlap(points: np.ndarray, target: np.ndarray, pose: np.ndarray, within_m: float) -> float:
    """Return the share of (N, 3) points that a (4, 4) motion brings within a distance of others."""
    from scipy.spatial import cKDTree

    moved = points @ pose[:3, :3].T + pose[:3, 3]
    distances, _ = cKDTree(target).query(moved, distance_upper_bound=within_m)
    return float(np.isfinite(distances).mean())


def best_motion(points: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the (4, 4) motion that brings (N, 3) points nearest to their (N, 3) partners."""
    centre, aim = points.mean(axis=0), target.mean(axis=0)
    left, _, right = np.linalg.svd((target - aim).T @ (points - centre))
    motion = np.eye(4)
    motion[:3, :3] = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    motion[:3, 3] = aim - motion[:3, :3] @ centre
    return motion


# --------------------------------------------------------------------------------------------------
# Pose graph: the poses that agree best with measured motions between them.

GRAPH_STEPS = 20
"""Most Gauss-Newton steps."""
SMALL = 1e-7
"""Smaller steps, metres and radians, end the search."""


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A measured motion: (4, 4) `first_from_second`, between poses by their numbers.

    spread: (6,) standard deviations, metres along x, y, z, then radians about them.
    """

    first: int
    second: int
    motion: np.ndarray
    spread: np.ndarray


def optimised_poses(poses: np.ndarray, links: Sequence[Link]) -> np.ndarray:
    """Return the (N, 4, 4) poses with the least sum of squares over links; the first one stays.

    Gauss-Newton on sparse normal equations, from the poses given; each needs a chain of links
    to the first.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import spsolve

    poses = poses.copy()
    if len(poses) < 2 or not links:
        return poses
    for _ in range(GRAPH_STEPS):
        rows, columns, values, off = _linear(poses, links)
        shape = (6 * len(links), 6 * len(poses))
        jacobian = csr_matrix((values, (rows, columns)), shape=shape)[:, 6:]
        step = -spsolve((jacobian.T @ jacobian).tocsc(), jacobian.T @ off)
        for pose, twist in zip(poses[1:], step.reshape(-1, 6), strict=True):
            pose[:] = pose @ exp_se3(twist)
        if np.abs(step).max() < SMALL:
            break
    return np.array([orthonormal(pose) for pose in poses])


def misfits(poses: np.ndarray, links: Sequence[Link]) -> np.ndarray:
    """Return (K, 6) residuals of the links, in their standard deviations."""
    return np.array([_residual(poses, link) / link.spread for link in links])


def _residual(poses: np.ndarray, link: Link) -> np.ndarray:
    first_from_second = inverse(poses[link.first]) @ poses[link.second]
    return log_se3(inverse(link.motion) @ first_from_second)


def _linear(
    poses: np.ndarray, links: Sequence[Link]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, columns and values of the Jacobian, and the (6 K,) misfits."""
    rows, columns, values, offs = [], [], [], []
    for k, link in enumerate(links):
        off = _residual(poses, link)
        # Derivative of log(T exp(x)) by x at 0, up to the square of the residual log(T).
        derivative = np.eye(6) + _bracket(off) / 2 + _bracket(off) @ _bracket(off) / 12
        second_from_first = adjoint(inverse(poses[link.second]) @ poses[link.first])
        blocks = ((link.first, -derivative @ second_from_first), (link.second, derivative))
        for node, block in blocks:
            r, c = np.indices((6, 6))
            rows.append(6 * k + r.ravel())
            columns.append(6 * node + c.ravel())
            values.append((block / link.spread[:, None]).ravel())
        offs.append(off / link.spread)
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(values), np.hstack(offs)


def _bracket(twist: np.ndarray) -> np.ndarray:
    """Return the (6, 6) matrix that takes the Lie bracket with a twist."""
    whole = np.zeros((6, 6))
    whole[:3, :3] = whole[3:, 3:] = hat(twist[3:])
    whole[:3, 3:] = hat(twist[:3])
    return whole


# --------------------------------------------------------------------------------------------------
# Detection of loops.

NEAR_M = 15.0
"""Greatest distance of a candidate."""
DRIVEN_M = 50.0
"""Least distance driven since a candidate: recent keyframes are in the map anyway."""
AGAIN_M = 10.0
"""Least distance driven between two attempts to close a loop."""
BESIDE = 10
"""Number of keyframes before and after a candidate in its local map."""
RESIDUAL_M = 0.2
"""Greatest weighted root mean square distance of the matched features."""
AGREED, WITHIN_M = 0.5, 0.3
"""Least share of edges that have an edge of the local map within `WITHIN_M`."""
DRIFTED = 0.05
"""Largest drift as a share of the distance driven since. Without this bound, self-similar places
such as corridors would close false loops."""
STEP_SPREAD = np.array([0.05] * 3 + [0.005] * 3)
LOOP_SPREAD = np.array([0.05] * 3 + [0.005] * 3)
"""Standard deviations of a motion between keyframes, and of one that closes a loop."""


class LoopClosing:
    """Stores links between keyframes, and finds further ones at places visited again."""

    def __init__(self) -> None:
        self.links: list[Link] = []
        self.closed = 0
        self._last_m = -np.inf

    def add(self, keyframes: Sequence[Keyframe]) -> None:
        """Link the last keyframe with the one before it."""
        if len(keyframes) > 1:
            last = len(keyframes) - 1
            self.links.append(_link(keyframes, last - 1, last, STEP_SPREAD))

    def closed_by(self, keyframes: Sequence[Keyframe]) -> list[Keyframe] | None:
        """Return all keyframes with corrected poses if the last one closes a loop, else None."""
        last = len(keyframes) - 1
        if keyframes[last].driven_m - self._last_m < AGAIN_M:
            return None
        candidate = nearest_candidate(keyframes)
        if candidate is None:
            return None
        self._last_m = keyframes[last].driven_m
        map_from_last = relocalised(keyframes, candidate)
        if map_from_last is None:
            return None
        motion = inverse(keyframes[candidate].map_from_lidar) @ map_from_last
        self.links.append(Link(candidate, last, motion, LOOP_SPREAD))
        self.closed += 1
        poses = optimised_poses(np.array([each.map_from_lidar for each in keyframes]), self.links)
        return [replace(k, map_from_lidar=p) for k, p in zip(keyframes, poses, strict=True)]


def nearest_candidate(keyframes: Sequence[Keyframe]) -> int | None:
    """Return the number of the nearest keyframe of an earlier visit to the last one's place."""
    last = keyframes[-1]
    earlier = [k for k in keyframes if last.driven_m - k.driven_m > DRIVEN_M]
    if not earlier:
        return None
    away_m = np.linalg.norm([k.place - last.place for k in earlier], axis=1)
    nearest = int(np.argmin(away_m))
    return nearest if away_m[nearest] < NEAR_M else None


def relocalised(keyframes: Sequence[Keyframe], candidate: int) -> np.ndarray | None:
    """Return the (4, 4) pose of the last keyframe on the map around an earlier one, if it fits."""
    around = keyframes[max(candidate - BESIDE, 0) : candidate + BESIDE + 1]
    last, local_map = keyframes[-1], KeyframeMap(around)
    if not len(local_map.edges) or not len(last.edges):
        return None
    # First roughly by edges, which are few and distinct; then finely by lines and planes.
    rough = icp_motion(last.edges, local_map.edges.points, last.map_from_lidar, NEAR_M)
    feature_match = local_map.match(last, rough)
    if misfit_of(feature_match) or feature_match.residual_m > RESIDUAL_M:
        return None
    moved_m = np.linalg.norm(feature_match.before_from_now[:3, 3] - last.place)
    if moved_m > DRIFTED * (last.driven_m - keyframes[candidate].driven_m):
        return None
    overlap_share = overlap(
        last.edges, local_map.edges.points, feature_match.before_from_now, WITHIN_M
    )
    return feature_match.before_from_now if overlap_share > AGREED else None


def _link(keyframes: Sequence[Keyframe], first: int, second: int, spread: np.ndarray) -> Link:
    a, b = keyframes[first].map_from_lidar, keyframes[second].map_from_lidar
    return Link(first, second, inverse(a) @ b, spread)
