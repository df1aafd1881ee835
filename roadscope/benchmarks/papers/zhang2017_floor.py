"""The information floor: the least error that any estimator can have on Zhang 2017's drives.

The posterior of the car's pose is computed from everything the sensor measured near it, with the
very model that made the measurements: the body's prisms, every ray with its range noise or its
silence, lost returns, the way of car and sensor during a sweep. Its covariance is the mean square
error of the best estimator there is, for a pose not known beforehand. Rays that pass close by the
silhouette say as much as those that meet it, and what they say is a bound, not a slope: a
Cramer-Rao bound of the ranges misses it, sampling does not.

Whoever does not know how round the car's corners are, or that it keeps its speed, has a higher
floor: the posterior then covers their radius and the acceleration, too, with the priors of our fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.papers.posterior import LogDensity, moments
from roadscope.benchmarks.papers.zhang2017_drives import FRAME_S
from roadscope.benchmarks.papers.zhang2017_floor_corners import Corners, told, untold
from roadscope.benchmarks.papers.zhang2017_floor_motion import (
    STATE,
    acceleration_of,
    joined,
    log_prior,
    motion_of,
    offsets_after,
)
from roadscope.benchmarks.papers.zhang2017_floor_views import View, view_of
from roadscope.benchmarks.papers.zhang2017_scene import Run

FEWEST = 3
"""Frames with fewer returns of the car have no floor: they are not scored."""
START = 0.3, 0.3, 0.1
"""Standard deviations of the first proposal of a pose, metres and radians."""
COLUMNS, THINNER = 12, 4
"""Columns with which the search begins at least, and by how much each step has more."""
PASSING = 0.1
"""Effective share of the sample that is enough before all columns are used."""
WIDER = 2.0
"""How much wider than the frame before the search begins."""
FEWEST_COUNTED = 8.0
"""Effective samples that a covariance is made of at least to be judged."""
RAYS, LEAST_DRAWS = 500_000, 6
"""Rays a stage casts before it makes do with less, and the least share of draws it takes."""


@dataclass(frozen=True, slots=True)
class Floor:
    """K frames; NaN where a frame has too few returns.

    errors: (K, 3) posterior mean minus truth: along and across the car (metres), yaw (radians).
    covariances: (K, 3, 3) of the same.
    shares: (K,) effective share of the sample, 0 where the sampling failed.
    counts: (K,) effective number of samples.
    """

    errors: np.ndarray
    covariances: np.ndarray
    shares: np.ndarray
    counts: np.ndarray

    @property
    def nees(self) -> np.ndarray:
        """(K,) squared errors of the exact posterior's mean in units of its covariance.

        Freed, on average, of what mean and covariance of so few samples add (Hotelling's
        distribution). 3 is expected over all that the priors cover, not of one body on one way:
        whoever knows the priors alone is too sure of what is rare in them.
        """
        found = np.full(len(self.shares), np.nan)
        used = (self.shares > 0) & (self.counts > FEWEST_COUNTED)
        off, n = self.errors[used], self.counts[used]
        turned = np.linalg.solve(self.covariances[used], off[..., None])[..., 0]
        found[used] = (off * turned).sum(axis=1) * (n - 5) / (n - 1) * n / (n + 1)
        return found

    @property
    def position_m(self) -> np.ndarray:
        """(K,) root of the expected squared distance."""
        return _root(self.covariances[:, 0, 0] + self.covariances[:, 1, 1])

    @property
    def longitudinal_m(self) -> np.ndarray:
        """(K,) standard deviation along the car."""
        return _root(self.covariances[:, 0, 0])

    @property
    def heading_rad(self) -> np.ndarray:
        """(K,) standard deviation of the heading."""
        return _root(self.covariances[:, 2, 2])


def _root(variances: np.ndarray) -> np.ndarray:
    roots: np.ndarray = np.sqrt(variances)
    return roots


def floor(
    run: Run,
    frames: int = 1,
    *,
    lag: int | None = None,
    draws: int = 2048,
    knows_corners: bool = True,
    knows_acceleration: bool = True,
) -> Floor:
    """Return the floor of each frame's pose, given so many frames around it.

    frames: how many consecutive frames are used; at the ends of the run those that are there.
    lag: how many of them come after the one whose pose is asked, half of them if left out.
    knows_corners: whether the radius of the car's corners is known. knows_acceleration: whether
    its acceleration is.
    """
    found = floors(
        run, (frames,), lag=lag, draws=draws,
        knows_corners=knows_corners, knows_acceleration=knows_acceleration,
    )  # fmt: skip
    return found[frames]


def floors(
    run: Run,
    frames: Sequence[int],
    *,
    lag: int | None = None,
    draws: int = 2048,
    knows_corners: bool = True,
    knows_acceleration: bool = True,
) -> dict[int, Floor]:
    """Return the floor for each of several numbers of frames; see `floor`."""
    corners = told(run.body) if knows_corners else untold()
    views = [view_of(run, k, corners.bodies) for k in range(len(run.shots))]
    seen = [shot.target.sum() >= FEWEST for shot in run.shots]
    singles: list[Answer] = []
    for view, enough in zip(views, seen, strict=True):
        before = singles[-1] if singles else _nothing(corners)
        singles.append(_single(view, corners, before, draws) if enough else _nothing(corners))
    given = _Given(run, corners, views, singles, knows_acceleration)
    return {
        many: _stacked(
            [_joint(given, k, window, draws) for k, window in _windows(len(views), many, lag)]
            if many > 1
            else singles
        )
        for many in frames
    }


def _windows(count: int, frames: int, lag: int | None) -> list[tuple[int, range]]:
    """Return which frames of a run are used for each."""
    after = frames // 2 if lag is None else lag
    return [
        (k, range(max(k + after - frames + 1, 0), min(k + after + 1, count))) for k in range(count)
    ]


Answer = tuple[np.ndarray, np.ndarray, float, float]
"""Mean and covariance of a frame's pose and of the corners' unknowns; effective share of samples,
effective number of them."""


@dataclass(frozen=True, slots=True)
class _Given:
    """A run with the answers of its single frames."""

    run: Run
    corners: Corners
    views: list[View]
    singles: list[Answer]
    knows_acceleration: bool


def _nothing(corners: Corners) -> Answer:
    size = 3 + corners.unknowns
    return np.full(size, np.nan), np.full((size, size), np.nan), 0.0, 0.0


def _stacked(answers: list[Answer]) -> Floor:
    means, covariances, shares, counts = zip(*answers, strict=True)
    return Floor(
        np.stack([mean[:3] for mean in means]),
        np.stack([covariance[:3, :3] for covariance in covariances]),
        np.array(shares),
        np.array(counts),
    )


def _single(view: View, corners: Corners, before: Answer, draws: int) -> Answer:
    """Return the posterior of a frame's pose.

    Where there are many columns the search begins around the truth as widely as the frame before
    was unsure, or else with few of them.
    """
    mean = np.zeros(3 + corners.unknowns)
    covariance = np.diag([*START, *[1.0] * corners.unknowns]) ** 2
    stride = 1
    while len(view.rays.origins) >= COLUMNS * stride * THINNER:
        stride *= THINNER
    if stride > 1 and before[2] > 0:
        mean[3:], covariance, stride = before[0][3:], WIDER**2 * before[1], 1
    while stride > 1:
        density = _density(view.thinned(stride), corners)
        mean, covariance, _ = moments(density, mean, covariance, draws=draws // 2, wanted=PASSING)
        stride //= THINNER
    sample = _affordable([view], draws)
    mean, covariance, share = moments(_density(view, corners), mean, covariance, draws=sample)
    return mean, covariance, share, share * sample


def _density(view: View, corners: Corners) -> LogDensity:
    def log_density(states: np.ndarray) -> np.ndarray:
        offsets, unknowns = np.ascontiguousarray(states[:, :3]), states[:, 3:]
        out = view.log_densities(offsets, corners.which(unknowns))
        out += _log_prior(unknowns)
        return out

    return log_density


def _log_prior(unknowns: np.ndarray) -> np.ndarray:
    log_prior: np.ndarray = -0.5 * (unknowns**2).sum(axis=1)
    return log_prior


def _affordable(views: list[View], draws: int) -> int:
    """Return how many draws to take: a sharp posterior near the sensor needs fewer."""
    rays = sum(view.rays.observed.size for view in views)
    return int(np.clip(RAYS // rays, draws // LEAST_DRAWS, draws))


def _joint(given: _Given, k: int, window: range, draws: int) -> Answer:
    """Return the posterior of frame k's pose given a window of frames."""
    singles, corners = given.singles, given.corners
    usable = [j for j in window if singles[j][2] > 0]
    if len(usable) < 2 or singles[k][2] == 0:
        # One frame tells nothing of the motion.
        return singles[k]
    motion = motion_of(given.run, k)
    gained = None if given.knows_acceleration else acceleration_of(given.run, k)
    moving = STATE + (gained is not None)
    times = {j: FRAME_S * (j - k) for j in usable}

    def log_density(states: np.ndarray) -> np.ndarray:
        unknowns = states[:, moving:]
        out, which = _log_prior(unknowns), corners.which(unknowns)
        if gained is not None:
            out += log_prior(states[:, STATE], gained)
        for j, time_s in times.items():
            offsets = offsets_after(states[:, :moving], motion, time_s)
            out += given.views[j].log_densities(offsets, which)
        return out

    first = joined(motion, [(time_s, *singles[j][:2]) for j, time_s in times.items()], gained)
    sample = _affordable([given.views[j] for j in usable], draws)
    mean, covariance, share = moments(log_density, *first, draws=sample)
    # x, y and yaw lead the state; how it moves is not asked.
    return mean[:3], covariance[:3, :3], share, share * sample
