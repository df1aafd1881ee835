"""The pose estimators that Zhang 2017's experiments compare, run frame by frame and timed.

All are given which returns are the car's. The paper's and ours are told its size, `sized saloon`
only how that of such cars is spread. Ours also knows beams and noise, and of the body its outline
but for the radius of its corners; one estimator fits the sharp and the rounded body. Beside it:
told the radius, too, and told no more than how saloons are built.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from itertools import islice, pairwise
from time import thread_time
from types import MappingProxyType
from typing import Any

import numpy as np

from roadscope.benchmarks.papers.zhang2017_drives import FRAME_S
from roadscope.benchmarks.papers.zhang2017_outline import fusion
from roadscope.benchmarks.papers.zhang2017_scene import Run, Shot
from roadscope.detectors.pose.body_fit import BodyFit
from roadscope.detectors.pose.body_likelihood import EXACTLY_DRAWN, ROUGHLY_DRAWN, Tolerance
from roadscope.detectors.pose.body_model import BodyModel, saloon
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.pose.matched_filter import fit_multi, fit_single
from roadscope.detectors.pose.ransac import fit_ransac
from roadscope.detectors.pose.smoother import Smoother
from roadscope.envs.world.ford_saloon import CORNER_RADII_M, LENGTH_M, WIDTH_M

LENGTH_SD_M, WIDTH_SD_M = 0.1, 0.05
"""Of the size of cars that a class has in common."""
STEPS = 5
"""From frame to frame, of which a tracker's velocity is the median."""
Poses = list[VehiclePose | None]
Method = Callable[[Run], Iterator[Poses]]
"""Yields, for each frame of a run, the poses that became known with it, in the order of frames;
at last those that were still to come. World frame, at the frames' stamps; None for no answer."""


def estimate(method: Method, run: Run) -> tuple[Poses, np.ndarray]:
    """Return the pose of each frame and the milliseconds that each took, where one came alone.

    Counted is the time of the processor, so that a busy machine makes nothing slower.
    """
    poses: Poses = []
    spent: list[float] = []
    steps = method(run)
    while True:
        start = thread_time()
        found = list(islice(steps, 1))
        took_ms = 1e3 * (thread_time() - start)
        if not found:
            return poses, np.array(spent)
        poses.extend(found[0])
        spent += [took_ms] * (len(found[0]) == 1)


def single(run: Run, **reading: Any) -> Iterator[Poses]:
    """Fit each frame alone; reading: options of `fit_single`."""
    for shot in run.shots:
        points = shot.points_xy
        yield [
            fit_single(points, shot.origin_xy, length_m=LENGTH_M, width_m=WIDTH_M, **reading)
            if len(points)
            else None
        ]


def multi(run: Run, **reading: Any) -> Iterator[Poses]:
    """Fit three frames in a row, the middle one's pose; at the ends the two that there are.

    reading: options of `fit_multi`.
    """
    yield []
    for k in range(len(run.shots)):
        yield [_middle(run, k, **reading)]


def _middle(run: Run, k: int, **reading: Any) -> VehiclePose | None:
    window = [j for j in (k - 1, k, k + 1) if 0 <= j < len(run.shots)]
    seen = [j for j in window if run.shots[j].target.any()]
    if k not in seen:
        return None
    shots = [run.shots[j] for j in seen]
    return fit_multi(
        [shot.points_xy for shot in shots],
        [shot.origin_xy for shot in shots],
        [FRAME_S * j for j in seen],
        length_m=LENGTH_M,
        width_m=WIDTH_M,
        at=seen.index(k),
        **reading,
    )


def ransac(run: Run, **reading: Any) -> Iterator[Poses]:
    """Fit each frame alone; reading: options of `fit_ransac`."""
    for k, shot in enumerate(run.shots):
        points, rng = shot.points_xy, np.random.default_rng([run.seed, k])
        yield [
            fit_ransac(points, shot.origin_xy, rng, length_m=LENGTH_M, width_m=WIDTH_M, **reading)
            if len(points)
            else None
        ]


def _ours_single(run: Run) -> Iterator[Poses]:
    fit = BodyFit(run.spec, outline(run.body), EXACTLY_DRAWN)
    for k, shot in enumerate(run.shots):
        yield [
            fit.fit(
                shot.scan,
                shot.target,
                shot.world_from_lidar,
                sensor_velocity=_velocity(run.shots, k) if run.drive.rolling else None,
                rolling=run.drive.rolling,
                velocity=_car_velocity(run.shots, k),
            )
        ]


def _car_velocity(shots: tuple[Shot, ...], k: int) -> np.ndarray | None:
    """Return roughly how the car moves, (2,) m/s: the median of the steps of its returns' mean.

    A tracker knows that much. Front and rear look alike from afar, and as a car is not the same
    from both its middle would be misplaced; and while a sweep passes over it, it moves on by some
    centimetres. A single step would mislead: a beam that grazes the roof comes and goes, and
    takes the mean along by a metre.
    """
    last = max(k, 1)
    means = [
        (j, shot.points_xy.mean(axis=0))
        for j, shot in enumerate(shots[max(last - STEPS, 0) : last + 1])
        if shot.target.any()
    ]
    if len(means) < 2:
        return None
    steps = [(b - a) / ((j - i) * FRAME_S) for (i, a), (j, b) in pairwise(means)]
    way: np.ndarray = np.median(steps, axis=0)
    return way


def _velocity(shots: tuple[Shot, ...], k: int) -> np.ndarray:
    """Return the (2,) velocity of the sensor, which it knows from its odometry."""
    before, after = shots[max(k - 1, 0)], shots[min(k + 1, len(shots) - 1)]
    frames = min(k + 1, len(shots) - 1) - max(k - 1, 0)
    velocity: np.ndarray = (after.origin_xy - before.origin_xy) / (max(frames, 1) * FRAME_S)
    return velocity


def _smoothed(
    frames: int, model: Callable[[str], BodyModel], tolerance: Tolerance = EXACTLY_DRAWN
) -> Method:
    """Join so many frames; the answer is for the middle one."""

    def run_smoother(run: Run) -> Iterator[Poses]:
        lag = frames // 2
        smoother = Smoother(run.spec, model(run.body), frames=frames, lag=lag, tolerance=tolerance)
        for k, shot in enumerate(run.shots):
            pose = smoother.update(
                shot.scan, shot.target, shot.world_from_lidar, rolling=run.drive.rolling
            )
            yield [pose] if k >= lag else []
        yield smoother.flush()

    return run_smoother


@cache
def outline(_: str) -> BodyModel:
    """Return the car's outline with corners of any radius."""
    return fusion()


@cache
def told_radius(body: str) -> BodyModel:
    """Return the car as it is, which is what the information floor supposes."""
    radius = CORNER_RADII_M[body]
    return fusion((radius, radius))


@cache
def any_saloon(_: str) -> BodyModel:
    """Return a car of known size whose corners, bonnet and boot are those of many."""
    return saloon((LENGTH_M, 0.0), (WIDTH_M, 0.0))


@cache
def sized_saloon(_: str) -> BodyModel:
    """Return a car of which not even the size is known, only how it is spread."""
    return saloon((LENGTH_M, LENGTH_SD_M), (WIDTH_M, WIDTH_SD_M))


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "single frame": single,
        "multi frame": multi,
        "RANSAC": ransac,
        "ours, 1 frame": _ours_single,
        "ours, 3 frames": _smoothed(3, outline),
        "ours, 7 frames": _smoothed(7, outline),
        "told radius, 7": _smoothed(7, told_radius),
        "any saloon, 7": _smoothed(7, any_saloon, ROUGHLY_DRAWN),
        "sized saloon, 7": _smoothed(7, sized_saloon, ROUGHLY_DRAWN),
    }
)
"""The paper's first."""
REPEATED = tuple(METHODS)[:6]
"""What is run on every drive; what knows more or less than ours is run on the simulated ones."""
SINGLE, MULTI, RANSAC = list(METHODS)[:3]
OURS = {"ours, 1 frame": 1, "ours, 3 frames": 3, "ours, 7 frames": 7}
"""Frames that stand behind each of ours: its floor is that of as many."""
