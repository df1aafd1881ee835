"""Bodies of what stands on a road and is no road user."""

from __future__ import annotations

import numpy as np

from roadscope.envs.world.footprints import placed, rectangle
from roadscope.envs.world.materials import CONCRETE
from roadscope.envs.world.prisms import Prisms
from roadscope.envs.world.roadside import MOST_THINGS, OBSTACLE_KIND

REFLECTIVITY = 0.35
"""Concrete at 905 nm."""


def obstacle_prisms(obstacles: np.ndarray) -> Prisms:
    """Return one upright box an obstacle, world frame, owned by scenery of `OBSTACLE_KIND`.

    obstacles: (O, 6) as `Timeline.obstacles`: centre x and y, yaw, length, width, height.
    """
    boxes = []
    for number, (x, y, yaw, length, width, height) in enumerate(obstacles):
        outline = placed(rectangle(length, width), np.array([[x, y]]), np.array([yaw]))[0]
        owner = -2 - (OBSTACLE_KIND * MOST_THINGS + number)
        boxes.append(
            Prisms.of(
                outline, 0.0, height, owner=owner, reflectivity=REFLECTIVITY, material=CONCRETE
            )
        )
    return Prisms.join(boxes)
