"""How camera and actors move while a shutter is open."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from roadscope.core import Pose
from roadscope.envs.sensors.exposure import Motion
from roadscope.envs.sensors.rig import CameraMount
from roadscope.envs.traffic.timeline import Timeline


def motion_during(
    timeline: Timeline,
    mount: CameraMount,
    stamp_s: float,
    world_from_ego: Callable[[float], Pose] | None = None,
) -> Motion:
    """Return the mean motion over the exposure whose middle is the stamp.

    world_from_ego: where the ego is at a stamp, if not where the timeline has it.
    """
    placed = timeline.world_from_ego if world_from_ego is None else world_from_ego
    exposure_s = mount.spec.exposure_s
    opens_s, closes_s = stamp_s - exposure_s / 2, stamp_s + exposure_s / 2
    around = timeline.at(np.array([opens_s, closes_s]))
    ahead = np.stack([np.cos(around.yaws), np.sin(around.yaws)], axis=-1)
    centres = around.axles + timeline.centre_ahead_m[:, None] * ahead
    first, last = (placed(t) for t in (opens_s, closes_s))
    turned = np.arctan2(np.sin(last.yaw - first.yaw), np.cos(last.yaw - first.yaw))
    way = (last @ mount.ego_from_camera).translation - (first @ mount.ego_from_camera).translation
    return Motion(
        way / exposure_s, np.array([0.0, 0.0, turned / exposure_s]),
        (centres[1] - centres[0]) / exposure_s,
    )  # fmt: skip
