"""Poses that agree best with motions measured between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.odometry.rigid import adjoint, exp_se3, hat, inverse, log_se3, orthonormal

STEPS = 20
SMALL = 1e-7
"""Steps below, metres and radians, end the search."""


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A measured motion: (4, 4) `first_from_second`, between poses by their numbers.

    spread: (6,) standard deviations, metres along x, y, z, then radians about them.
    """

    first: int
    second: int
    motion: np.ndarray
    spread: np.ndarray


def settled(poses: np.ndarray, links: Sequence[Link]) -> np.ndarray:
    """Return the (N, 4, 4) poses with the least sum of squares over links; the first one stays.

    Gauss-Newton on sparse normal equations, from the poses given; each needs a chain of links
    to the first.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import spsolve

    poses = poses.copy()
    if len(poses) < 2 or not links:
        return poses
    for _ in range(STEPS):
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
    """Return (K, 6), how far poses are from what each link measured, in its deviations."""
    return np.array([_off(poses, link) / link.spread for link in links])


def _off(poses: np.ndarray, link: Link) -> np.ndarray:
    between = inverse(poses[link.first]) @ poses[link.second]
    return log_se3(inverse(link.motion) @ between)


def _linear(
    poses: np.ndarray, links: Sequence[Link]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, columns and values of the Jacobian, and the (6 K,) misfits."""
    rows, columns, values, offs = [], [], [], []
    for k, link in enumerate(links):
        off = _off(poses, link)
        # How a logarithm grows with a small motion after it, up to the square of the misfit.
        grows = np.eye(6) + _bracket(off) / 2 + _bracket(off) @ _bracket(off) / 12
        back = adjoint(inverse(poses[link.second]) @ poses[link.first])
        for node, block in ((link.first, -grows @ back), (link.second, grows)):
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
