"""The pose estimators that Zhang 2017's experiments compare, how they are run, and their errors.

Every estimator knows which returns are the car's. The paper's and ours know the car's size; `sized
saloon` only knows how the sizes of such cars are spread. Ours also knows beams and noise, and of
the body its outline without the radius of its corners; one estimator fits the sharp and the rounded
body. For comparison there are one that knows the radius too, and two that only know how saloons are
built.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from itertools import islice, pairwise
from time import thread_time
from types import MappingProxyType
from typing import Any

import numpy as np

from roadscope.benchmarks.papers.zhang2017_scene import FRAME_S, DriveSweep, SensedDrive
from roadscope.detectors.pose.body_fit import BodyFit
from roadscope.detectors.pose.body_likelihood import EXACTLY_DRAWN, ROUGHLY_DRAWN, Tolerance
from roadscope.detectors.pose.body_model import BodyModel, BodySection, SizePrior, saloon
from roadscope.detectors.pose.estimate import VehiclePose, axis_difference
from roadscope.detectors.pose.matched_filter import fit_multi, fit_single
from roadscope.detectors.pose.ransac import fit_ransac
from roadscope.detectors.pose.smoother import Smoother
from roadscope.envs.world.saloon_body import (
    AXLES_M,
    CORNER_RADII_M,
    GLASS,
    LENGTH_M,
    NARROWING,
    SLABS,
    WIDTH_M,
)

Poses = list[VehiclePose | None]
Method = Callable[[SensedDrive], Iterator[Poses]]
"""Yields, for each frame of a drive, the poses that became known with it, in the order of frames;
at the end those that are still missing. World frame, at the frames' stamps; None: no answer."""


def estimate(method: Method, run: SensedDrive) -> tuple[Poses, np.ndarray]:
    """Return the pose of each frame, and the milliseconds of each frame that was answered alone.

    The time is that of the processor, so that a busy machine makes nothing slower.
    """
    poses: Poses = []
    times_ms: list[float] = []
    steps = method(run)
    while True:
        start = thread_time()
        step = list(islice(steps, 1))
        took_ms = 1e3 * (thread_time() - start)
        if not step:
            return poses, np.array(times_ms)
        poses.extend(step[0])
        times_ms += [took_ms] * (len(step[0]) == 1)


# --------------------------------------------------------------------------------------------------
# The paper's methods: single frame, multi frame, and RANSAC to compare with.


def single(run: SensedDrive, **options: Any) -> Iterator[Poses]:
    """Fit each frame alone; reading: options of `fit_single`."""
    for sweep in run.sweeps:
        points = sweep.points_xy
        yield [
            fit_single(points, sweep.origin_xy, length_m=LENGTH_M, width_m=WIDTH_M, **options)
            if len(points)
            else None
        ]


def multi(run: SensedDrive, **options: Any) -> Iterator[Poses]:
    """Fit three frames in a row, the middle one's pose; at the ends the two that there are.

    reading: options of `fit_multi`.
    """
    yield []
    for k in range(len(run.sweeps)):
        yield [_middle_of_three(run, k, **options)]


def _middle_of_three(run: SensedDrive, k: int, **options: Any) -> VehiclePose | None:
    window = [j for j in (k - 1, k, k + 1) if 0 <= j < len(run.sweeps)]
    with_returns = [j for j in window if run.sweeps[j].target.any()]
    if k not in with_returns:
        return None
    sweeps = [run.sweeps[j] for j in with_returns]
    return fit_multi(
        [sweep.points_xy for sweep in sweeps],
        [sweep.origin_xy for sweep in sweeps],
        [FRAME_S * j for j in with_returns],
        length_m=LENGTH_M,
        width_m=WIDTH_M,
        at=with_returns.index(k),
        **options,
    )


def ransac(run: SensedDrive, **options: Any) -> Iterator[Poses]:
    """Fit each frame alone; reading: options of `fit_ransac`."""
    for k, sweep in enumerate(run.sweeps):
        points, rng = sweep.points_xy, np.random.default_rng([run.seed, k])
        yield [
            fit_ransac(points, sweep.origin_xy, rng, length_m=LENGTH_M, width_m=WIDTH_M, **options)
            if len(points)
            else None
        ]


# --------------------------------------------------------------------------------------------------
# What ours knows of the car.

LENGTH_SD_M, WIDTH_SD_M = 0.1, 0.05
"""Standard deviations of the sizes of cars of one class; chosen by hand."""


def ford_fusion(least_radius_m: float = 0.0, most_radius_m: float = 0.4) -> BodyModel:
    """Return the Ford Fusion with the maker's sizes and corners of a range of radii."""
    rear, front = AXLES_M
    windows = [slab for slab in SLABS if slab.reflectivity == GLASS]
    return BodyModel(
        SizePrior(LENGTH_M, 0.0),
        SizePrior(WIDTH_M, 0.0),
        (least_radius_m, most_radius_m),
        tuple(
            BodySection(slab.bottom_m, slab.top_m, slab.from_tail_m, slab.from_nose_m, slab.breadth)
            for slab in SLABS
        ),
        (rear / LENGTH_M, front / LENGTH_M),
        NARROWING,
        glass_m=(windows[0].bottom_m, windows[-1].top_m),
    )


@cache
def any_corners(_: str) -> BodyModel:
    """Return the car's outline with corners of any radius."""
    return ford_fusion()


@cache
def known_radius(body: str) -> BodyModel:
    """Return the car as it is."""
    radius_m = CORNER_RADII_M[body]
    return ford_fusion(radius_m, radius_m)


@cache
def any_saloon(_: str) -> BodyModel:
    """Return a car of known size whose corners, bonnet and boot are those of many."""
    return saloon(SizePrior(LENGTH_M, 0.0), SizePrior(WIDTH_M, 0.0))


@cache
def sized_saloon(_: str) -> BodyModel:
    """Return a car of unknown size, of which the spread of sizes is known."""
    return saloon(SizePrior(LENGTH_M, LENGTH_SD_M), SizePrior(WIDTH_M, WIDTH_SD_M))


# --------------------------------------------------------------------------------------------------
# Our methods: the fit of a body to single frames, and over several.

VELOCITY_STEPS = 5
"""Steps from frame to frame of which the car's velocity is the median."""


def _ours_single(run: SensedDrive) -> Iterator[Poses]:
    fit = BodyFit(run.spec, any_corners(run.body), EXACTLY_DRAWN)
    rolling = run.drive.rolling
    for k, sweep in enumerate(run.sweeps):
        yield [
            fit.fit(
                sweep.scan,
                sweep.target,
                sweep.world_from_lidar,
                sensor_velocity=_sensor_velocity(run.sweeps, k) if rolling else None,
                rolling=rolling,
                velocity=_car_velocity(run.sweeps, k),
            )
        ]


def _car_velocity(sweeps: tuple[DriveSweep, ...], k: int) -> np.ndarray | None:
    """Return roughly the car's velocity, (2,) m/s: the median of the steps of its returns' mean.

    A tracker knows that much. It is needed because front and rear look alike from afar while the
    car is not symmetric, and because the car moves by some centimetres while a sweep passes over
    it. A single step would mislead: a beam that grazes the roof comes and goes, and displaces the
    mean by a metre.
    """
    last = max(k, 1)
    means = [
        (j, sweep.points_xy.mean(axis=0))
        for j, sweep in enumerate(sweeps[max(last - VELOCITY_STEPS, 0) : last + 1])
        if sweep.target.any()
    ]
    if len(means) < 2:
        return None
    steps = [(b - a) / ((j - i) * FRAME_S) for (i, a), (j, b) in pairwise(means)]
    velocity: np.ndarray = np.median(steps, axis=0)
    return velocity


def _sensor_velocity(sweeps: tuple[DriveSweep, ...], k: int) -> np.ndarray:
    """Return the (2,) velocity of the sensor, which it knows from its odometry."""
    before, after = sweeps[max(k - 1, 0)], sweeps[min(k + 1, len(sweeps) - 1)]
    frames = min(k + 1, len(sweeps) - 1) - max(k - 1, 0)
    velocity: np.ndarray = (after.origin_xy - before.origin_xy) / (max(frames, 1) * FRAME_S)
    return velocity


def _smoothed(
    frames: int, model: Callable[[str], BodyModel], tolerance: Tolerance = EXACTLY_DRAWN
) -> Method:
    """Return the method that joins a number of frames; its answer is for the middle one."""

    def run_smoother(run: SensedDrive) -> Iterator[Poses]:
        lag = frames // 2
        smoother = Smoother(run.spec, model(run.body), frames=frames, lag=lag, tolerance=tolerance)
        for k, sweep in enumerate(run.sweeps):
            pose = smoother.update(
                sweep.scan, sweep.target, sweep.world_from_lidar, rolling=run.drive.rolling
            )
            yield [pose] if k >= lag else []
        yield smoother.flush()

    return run_smoother


SINGLE, MULTI, RANSAC = "single frame", "multi frame", "RANSAC"
OURS = {"ours, 1 frame": 1, "ours, 3 frames": 3, "ours, 7 frames": 7}
"""How many frames each of our methods joins."""
METHODS: Mapping[str, Method] = MappingProxyType(
    {
        SINGLE: single,
        MULTI: multi,
        RANSAC: ransac,
        "ours, 1 frame": _ours_single,
        "ours, 3 frames": _smoothed(3, any_corners),
        "ours, 7 frames": _smoothed(7, any_corners),
        "known radius, 7": _smoothed(7, known_radius),
        "any saloon, 7": _smoothed(7, any_saloon, ROUGHLY_DRAWN),
        "sized saloon, 7": _smoothed(7, sized_saloon, ROUGHLY_DRAWN),
    }
)
"""By name; those of the paper first."""
ON_EVERY_DRIVE = (SINGLE, MULTI, RANSAC, *OURS)
"""The other methods run on the simulated drives only."""

# --------------------------------------------------------------------------------------------------
# Other readings of what the paper leaves open.

READINGS: Mapping[str, Method] = MappingProxyType(
    {
        "single (taken)": single,
        "single, extent only": partial(single, template="extent"),
        "single, no near edge": partial(single, template="plateau"),
        "single, over 90 deg": partial(single, search_deg=90.0),
        "multi (taken)": multi,
        "multi, extent only": partial(multi, template="extent"),
        "multi, no near edge": partial(multi, template="plateau"),
        "multi, over 90 deg": partial(multi, search_deg=90.0),
        "multi, free shifts": partial(multi, tied=False),
        "RANSAC (taken)": ransac,
        "RANSAC, main is flank": partial(ransac, long_side="main"),
    }
)
"""By name; those that are taken stand beside the others."""

# --------------------------------------------------------------------------------------------------
# Errors.

FEWEST_RETURNS = 3
"""Frames with fewer returns of the car are not scored."""
LATERAL, LONGITUDINAL, HEADING, POSITION = ("lateral", "longitudinal", "heading", "position")
FROM_PARTS = "position from parts"
"""Root of the sum of squares of lateral and longitudinal, which an RMSE of positions is."""
RMSE_UNITS = {LATERAL: "m", LONGITUDINAL: "m", HEADING: "deg", POSITION: "m", FROM_PARTS: "m"}
"""The columns of tables 1 and 2: RMSE across and along the car's true heading, of the heading,
and of the distance. The paper does not say along which axes; on the straight its own are those of
the world."""
MEDIAN_POSITION, MEDIAN_HEADING = "median position", "median heading"
TURNED, NO_ANSWER = "turned by 90 deg", "no answer"
OTHER_UNITS = {MEDIAN_POSITION: "m", MEDIAN_HEADING: "deg", TURNED: "%", NO_ANSWER: "%"}
"""Columns of the tables beside them."""
TURNED_RAD = np.pi / 4
"""A heading with a greater error has taken a side for the rear."""


def scored(run: SensedDrive) -> np.ndarray:
    """Return (K,) bool: frames with at least `FEWEST_RETURNS` returns of the car."""
    return np.array([sweep.target.sum() >= FEWEST_RETURNS for sweep in run.sweeps])


def errors(run: SensedDrive, poses: Poses) -> np.ndarray:
    """Return (K, 3) estimate minus truth along and across the car, metres, and in heading, radians.

    NaN where there is no estimate. A rectangle has no front: headings count up to half a turn.
    """
    differences, yaw = _differences(run, poses), run.truth[:, 2]
    c, s = np.cos(yaw), np.sin(yaw)
    along = c * differences[:, 0] + s * differences[:, 1]
    across = c * differences[:, 1] - s * differences[:, 0]
    return np.column_stack([along, across, differences[:, 2]])


def _differences(run: SensedDrive, poses: Poses) -> np.ndarray:
    """Return (K, 3) estimate minus truth, world frame, NaN where there is no estimate."""
    rows = np.full((len(run.sweeps), 3), np.nan)
    for k, pose in enumerate(poses):
        if pose is not None:
            rows[k] = pose.x, pose.y, pose.yaw
    truth = run.truth
    turned = axis_difference(rows[:, 2], truth[:, 2])
    return np.column_stack([rows[:, :2] - truth[:, :2], turned])


def rmse(run: SensedDrive, errors_of_frames: np.ndarray) -> dict[str, float]:
    """Return the columns of tables 1 and 2 from the (K, 3) errors."""
    used = errors_of_frames[scored(run) & np.isfinite(errors_of_frames[:, 0])]
    return named_columns((used**2).mean(axis=0) if len(used) else np.full(3, np.nan))


def named_columns(squares: np.ndarray) -> dict[str, float]:
    """Return the columns of tables 1 and 2 from mean squares.

    squares: (3,) along, across (square metres) and in heading (square radians).
    """
    return {
        LATERAL: float(np.sqrt(squares[1])),
        LONGITUDINAL: float(np.sqrt(squares[0])),
        HEADING: float(np.degrees(np.sqrt(squares[2]))),
        POSITION: float(np.sqrt(squares[0] + squares[1])),
        FROM_PARTS: float(np.hypot(np.sqrt(squares[0]), np.sqrt(squares[1]))),
    }


def medians_and_shares(run: SensedDrive, errors_of_frames: np.ndarray) -> dict[str, float]:
    """Return medians and the percentages of scored frames that RMSE hides."""
    used = errors_of_frames[scored(run)]
    answered = used[np.isfinite(used[:, 0])]
    if not len(answered):
        return {MEDIAN_POSITION: np.nan, MEDIAN_HEADING: np.nan, TURNED: 0.0, NO_ANSWER: 100.0}
    distances, turns = np.hypot(answered[:, 0], answered[:, 1]), np.abs(answered[:, 2])
    return {
        MEDIAN_POSITION: float(np.median(distances)),
        MEDIAN_HEADING: float(np.degrees(np.median(turns))),
        TURNED: 100.0 * float((turns > TURNED_RAD).sum() / len(used)),
        NO_ANSWER: 100.0 * (1.0 - len(answered) / len(used)),
    }


def nees(run: SensedDrive, poses: Poses) -> float:
    """Return the mean over scored frames of squared errors in units of the covariance (NEES).

    3 is expected of x, y and yaw. NaN where the method gives no covariance.
    """
    values = [
        float(error @ np.linalg.solve(pose.covariance, error))
        for error, pose, counts in zip(_differences(run, poses), poses, scored(run), strict=True)
        if counts and pose is not None and pose.covariance is not None
    ]
    return float(np.mean(values)) if values else np.nan
