"""Rays and a body on its way, as compiled inner loops see them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled

HIT, PASSED, EMPTY = 0, 1, 2
"""A return of the body, a return from behind it, no return."""
MOST_PARTS = 8
REAR, FRONT, HALF, TAIL, NOSE, AFT, FORE, RADIUS, BOTTOM, TOP = range(10)
AFT_X, AFT_Y, AFT_REACH, FORE_X, FORE_Y, FORE_REACH = range(10, 16)
COLUMNS = 16
"""Columns of a part: x of its rear and front end, half its width between the axles, at its rear
end and at its front end, x where the narrowing begins at the rear and at the front, radius of its
four corners, heights of its bottom and its top; metres, body frame. Then the unit normals of the
left flank behind and ahead of that and how far along them it is from the centre."""
FACET_REACH = float(np.cos(np.radians(15.0)))
FACET_X = tuple(float(v) for v in np.cos(np.radians([15.0, 45.0, 75.0])))
CORNER_X = tuple(float(v) for v in np.cos(np.radians([0.0, 30.0, 60.0, 90.0])))
"""A corner of radius 1 is cut into three facets, as in a mesh: how far they are from its centre,
x of their normals and of its four corner points; y is the same from the other end."""
POSE = 6
"""x, y, yaw, speed, turn rate, acceleration: the columns of a state before those of the body."""

STEEP = 2
"""How steeply surfaces fall silent where paints differ, see `Chances`."""
AMPLE = 16.0
"""How many times the light that is needed is as good as any more."""


class Rays(NamedTuple):
    """M rays, grouped by frame.

    origin: (M, 3) metres, world frame, z above the road. direction: (M, 2) unit vectors.
    slope: (M,) rise per horizontal metre. reach: (M,) horizontal metres to the return, inf for
    none. kind: (M,) int64, `HIT`, `PASSED` or `EMPTY`. sigma: (M,) metres, of the reach.
    time: (M,) seconds from the reference time. need: (M,) cosine of incidence that a surface
    needs to be seen at one metre; it grows with the range squared.
    """

    origin: np.ndarray
    direction: np.ndarray
    slope: np.ndarray
    reach: np.ndarray
    kind: np.ndarray
    sigma: np.ndarray
    time: np.ndarray
    need: np.ndarray


class Chances(NamedTuple):
    """What the likelihood knows of errors.

    edge_m, height_m: how exactly silhouettes and the heights of parts are as drawn.
    rough_m: departure of surfaces from the drawn ones; it is in the rays' noise already.
    outlier, outlier_m: share of returns that fit nothing, spread evenly over a depth.
    lost, through: chance that a ray that meets the body returns nothing, or from behind it.
    steep: how alike its paints are; the share of the light that is needed which a surface sends
    back is taken to the power 2**steep, so that it falls silent within about 1.8 / 2**steep.
    """

    edge_m: float
    height_m: float
    rough_m: float
    outlier: float
    outlier_m: float
    lost: float
    through: float
    steep: int = STEEP


@compiled(borrowing=True)
def place_after(state: np.ndarray, time: float) -> tuple[float, float, float, float]:
    """Return x, y, cosine and sine of the yaw of a state after a time."""
    x, y, yaw = pose_after(state, time)
    return x, y, math.cos(yaw), math.sin(yaw)


@compiled(borrowing=True)
def pose_after(state: np.ndarray, time: float) -> tuple[float, float, float]:
    """Return x, y, yaw of a state after a time: constant turn rate and acceleration.

    The way is taken along the chord, exact for a constant speed.
    """
    way = (state[3] + 0.5 * state[5] * time) * time
    half = 0.5 * state[4] * time
    chord = way * (1.0 - half * half / 6.0) if abs(half) < 1e-3 else way * math.sin(half) / half
    heading = state[2] + half
    return (
        state[0] + chord * math.cos(heading),
        state[1] + chord * math.sin(heading),
        state[2] + 2.0 * half,
    )


@compiled(borrowing=True)
def seen(need: float, near: float, cosine: float, steep: int = STEEP) -> float:
    """Return the chance that a surface sends enough back; steep: as in `Chances`."""
    if need == 0.0:
        return 1.0
    ratio = min(cosine / (need * near * near), AMPLE)
    for _ in range(steep):
        ratio *= ratio
    return ratio / (1.0 + ratio)
