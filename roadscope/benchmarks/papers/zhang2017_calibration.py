"""Whether the covariance of our pose fit is right, over all cars and ways that it holds possible.

No fit that does not know a car's corners can have a consistent covariance for a car with sharp
ones and for one with round ones alike; over the population that its priors describe a right one
has, at every distance and with any number of frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from roadscope.benchmarks.papers.zhang2017_methods import any_saloon, outline, sized_saloon
from roadscope.benchmarks.papers.zhang2017_methods import told_radius as told
from roadscope.benchmarks.papers.zhang2017_population import MIDDLE, Passing
from roadscope.benchmarks.papers.zhang2017_scene import hdl32e
from roadscope.detectors.pose.body_fit import BodyFit
from roadscope.detectors.pose.body_model import BodyModel
from roadscope.detectors.pose.estimate import VehiclePose, axis_difference
from roadscope.detectors.pose.smoother import Smoother

MODELS: Mapping[str, BodyModel] = MappingProxyType(
    {
        "sharp corners, told": told("sharp"),
        "rounded corners, told": told("rounded"),
        "any corners": outline(""),
        "any saloon": any_saloon(""),
        "sized saloon": sized_saloon(""),
    }
)


def fitted(model: BodyModel, seen: Passing, frames: int) -> VehiclePose | None:
    """Return the pose in the middle frame from so many frames around it."""
    if frames == 1:
        shot = seen.shots[MIDDLE]
        fit = BodyFit(hdl32e(), model)
        return fit.fit(shot.scan, shot.target, shot.world_from_lidar, velocity=seen.told)
    lag = frames // 2
    smoother = Smoother(hdl32e(), model, frames=frames, lag=lag)
    for shot in seen.shots[MIDDLE - lag : MIDDLE + lag + 1]:
        pose = smoother.update(shot.scan, shot.target, shot.world_from_lidar)
    return pose


def off(pose: VehiclePose, truth: np.ndarray) -> np.ndarray:
    """Return estimate minus truth (3,), x, y and yaw up to half a turn."""
    turned = axis_difference(np.array([pose.yaw]), truth[2:])[0]
    return np.array([pose.x - truth[0], pose.y - truth[1], turned])
