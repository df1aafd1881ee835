"""Whether the covariance of our pose fit is right, over all cars and ways that it holds possible.

No fit that does not know a car's corners can have a consistent covariance for a car with sharp
ones and for one with round ones alike; over the population that its priors describe a right one
has, at every distance and with any number of frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from roadscope.benchmarks.papers.reproduction import (
    YES_OR_NO,
    Key,
    ReproductionRow,
    summarise,
)
from roadscope.benchmarks.papers.zhang2017_claims import FREEDOM, consistent
from roadscope.benchmarks.papers.zhang2017_methods import (
    OURS,
    outline,
    sized_saloon,
    told_radius,
)
from roadscope.benchmarks.papers.zhang2017_names import (
    CALIBRATED,
    CALIBRATED_INSIDE,
    COVERED,
    frames_name,
)
from roadscope.benchmarks.papers.zhang2017_population import BANDS, MIDDLE, Passing, lidar, passing
from roadscope.detectors.pose.body_fit import BodyFit
from roadscope.detectors.pose.body_likelihood import EXACTLY_DRAWN
from roadscope.detectors.pose.body_model import BodyModel
from roadscope.detectors.pose.estimate import VehiclePose, axis_difference
from roadscope.detectors.pose.smoother import Smoother

MODELS: Mapping[str, BodyModel] = MappingProxyType(
    {
        "any corners": outline(""),
        "sharp, told": told_radius("sharp"),
        "rounded, told": told_radius("rounded"),
        "sized saloon": sized_saloon(""),
    }
)
"""What the fit knows of the body; the cars are drawn accordingly. Ours knows the first."""
CARS = 4
"""Of each seed, model and band."""
LEVELS = (0.5, 0.9, 0.95)
EVERY_BAND = "all distances"


def calibrate(seed: int) -> dict[Key, float]:
    """Return mean NEES by what is known, distance and frames, and which shares are covered."""
    found: dict[Key, float] = {}
    for row, (name, model) in enumerate(MODELS.items()):
        values = {
            band: np.concatenate([squares(model, band, [seed, row, k]) for k in range(CARS)])
            for band in BANDS
        }
        values[EVERY_BAND] = np.concatenate(list(values.values()))
        for band, squared in values.items():
            means = np.nanmean(squared.reshape(-1, len(OURS)), axis=0)
            for frames, mean in zip(OURS.values(), means, strict=True):
                found[CALIBRATED.format(name), band, frames_name(frames)] = float(mean)
        every = values[EVERY_BAND].reshape(-1, len(OURS))
        for column, frames in enumerate(OURS.values()):
            found |= _covered(f"{name}, {frames_name(frames)}", every[:, column])
    return found


def squares(model: BodyModel, band: str, seed: Sequence[int]) -> np.ndarray:
    """Return the squared error of a passing car in units of its covariance, (3,) by frames."""
    seen = passing(model, band, seed)
    out = np.full(len(OURS), np.nan)
    for column, frames in enumerate(OURS.values()):
        pose = fitted(model, seen, frames)
        if pose is not None and pose.covariance is not None:
            away = _off(pose, seen.truth)
            out[column] = away @ np.linalg.solve(pose.covariance, away)
    return out


def fitted(model: BodyModel, seen: Passing, frames: int) -> VehiclePose | None:
    """Return the pose in the middle frame from so many frames around it."""
    if frames == 1:
        shot = seen.shots[MIDDLE]
        fit = BodyFit(lidar(), model, EXACTLY_DRAWN)
        return fit.fit(shot.scan, shot.target, shot.world_from_lidar, velocity=seen.told)
    lag, pose = frames // 2, None
    smoother = Smoother(lidar(), model, frames=frames, lag=lag, tolerance=EXACTLY_DRAWN)
    for shot in seen.shots[MIDDLE - lag : MIDDLE + lag + 1]:
        pose = smoother.update(shot.scan, shot.target, shot.world_from_lidar)
    return pose


def _off(pose: VehiclePose, truth: np.ndarray) -> np.ndarray:
    """Return estimate minus truth (3,), x, y and yaw up to half a turn."""
    turned = axis_difference(np.array([pose.yaw]), truth[2:])[0]
    return np.array([pose.x - truth[0], pose.y - truth[1], turned])


def _covered(method: str, squared: np.ndarray) -> dict[Key, float]:
    """Return the percentages of errors within the ellipsoids that should hold so many of them."""
    from scipy.special import chdtri

    known = squared[np.isfinite(squared)]
    return {
        (COVERED, method, f"{100 * level:.0f} %"): 100.0
        * float((known <= chdtri(FREEDOM, 1 - level)).mean())
        for level in LEVELS
    }


def calibrated(measured: Mapping[Key, Sequence[float]]) -> list[ReproductionRow]:
    """Return for each NEES of `calibrate` whether 3 is within its 95 % interval."""
    rows = []
    for name in MODELS:
        for (experiment, band, quantity), values in measured.items():
            if experiment == CALIBRATED.format(name):
                cars = CARS * (len(BANDS) if band == EVERY_BAND else 1)
                inside = [float(consistent(values, cars, 1))]
                place = CALIBRATED_INSIDE.format(name), band
                rows.append(summarise(place, quantity, YES_OR_NO, inside, None))
    return rows
