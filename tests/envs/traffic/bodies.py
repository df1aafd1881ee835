"""How bodies of recorded traffic move and how far apart they are."""

import numpy as np


def gaps_m(line, row):
    """Return the (N, N) gaps of all bodies at a sample by separating axes, below 0 if they meet."""
    here = np.flatnonzero(line.present[row])
    yaws, half = line.yaws[row, here], line.sizes[here, :2] / 2
    ahead = np.stack([np.cos(yaws), np.sin(yaws)], axis=-1)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    centres = line.axles[row, here] + line.centre_ahead_m[here, None] * ahead
    offsets = centres - centres[:, None]
    gaps = np.full(offsets.shape[:2], -np.inf)
    for axis, own in ((ahead, half[:, 0]), (left, half[:, 1])):
        reach = np.abs(axis @ ahead.T) * half[:, 0] + np.abs(axis @ left.T) * half[:, 1]
        gap = np.abs((offsets * axis[:, None]).sum(axis=-1)) - own[:, None] - reach
        gaps = np.maximum(gaps, np.maximum(gap, gap.T))
    np.fill_diagonal(gaps, np.inf)
    return gaps


def slips_m(line):
    """Return how far rear axles moved across their headings between samples, (K - 1, A)."""
    moved, yaws = np.diff(line.axles, axis=0), np.unwrap(line.yaws, axis=0)
    yaws = (yaws[1:] + yaws[:-1]) / 2
    return moved[..., 1] * np.cos(yaws) - moved[..., 0] * np.sin(yaws)
