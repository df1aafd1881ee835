"""Pose from one frame: rotating line pair and matched filter (Zhang 2017, section 2)."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, TypedDict, Unpack

import numpy as np

from roadscope.detectors.pose.estimate import (
    VehiclePose,
    check_spread,
    positive,
    settled_origin,
    settled_points,
)
from roadscope.detectors.pose.pair_kernels import Filter
from roadscope.detectors.pose.rotating_pair import Frames, Plan, best_pair, planned

Template = Literal["echo", "extent", "plateau"]
POWERS: dict[Template, int] = {"echo": 2, "extent": 1, "plateau": 0}
TIE = 1e-3
"""Responses this near to the greatest count as equal: a side seen whole fits within its slack."""
ALONE_S = np.zeros(1)


class Reading(TypedDict, total=False):
    """How the paper is read: options of its fits, with the defaults of `settled_reading`.

    sigma_m: of the smoothed edges, twice the range noise. alpha: what a return off the body
    costs. bin_m, step_deg: of places and angles. search_deg: the paper turns the pair through
    90 deg; that cannot tell length from width, so 180 are searched here. template: a face's share
    goes with its extent and the cosine of incidence ("extent"), or once more with the cosine,
    since echoes fade with it ("echo"); "plateau" leaves the near edge out, which is the step
    function taken literally.
    """

    bin_m: float
    sigma_m: float
    alpha: float
    step_deg: float
    search_deg: float
    template: Template


def fit_single(
    points_xy: np.ndarray,
    origin: np.ndarray,
    *,
    length_m: float,
    width_m: float,
    **reading: Unpack[Reading],
) -> VehiclePose:
    """Return the rectangle of known size that fits one frame best (Zhang 2017, eq. 1-9).

    points_xy: (N, 2) metres, returns of one vehicle, at least one. origin: (2,) the sensor in
    the same frame. yaw points away from the sensor: a rectangle has no front.

    The bodies of eq. 1-9 are lost. Reading taken: along each axis a body shows an edge at its
    near end and a plateau as long as itself, weighed by the shares of returns of the two visible
    faces under the viewing angle, smoothed so that the edges are erf, minus alpha outside, at
    unit energy.
    """
    points, place = settled_points(points_xy), settled_origin(origin)
    check_spread(points)
    settings, plan = settled_reading(length_m, width_m, **reading)
    # Copies, for read-only arrays would be compiled for once more.
    frames = Frames(points.copy(), np.array([0, len(points)]), np.array([place]), ALONE_S, 0)
    x, y, yaw, score = best_pair(frames, settings, plan)
    return VehiclePose(x, y, yaw, length_m, width_m, score=score)


@lru_cache(maxsize=256)
def settled_reading(
    length_m: float,
    width_m: float,
    *,
    bin_m: float = 0.02,
    sigma_m: float = 0.04,
    alpha: float = 0.5,
    step_deg: float = 1.0,
    search_deg: float = 180.0,
    template: Template = "echo",
) -> tuple[Filter, Plan]:
    """Return the filter for a body of a known size and the angles to try; refuse what cannot be."""
    positive(length_m=length_m, width_m=width_m, sigma_m=sigma_m, bin_m=bin_m)
    if not 0 <= alpha < np.inf:
        raise ValueError(f"alpha must be finite and not negative, got {alpha!r}")
    if width_m > length_m:
        raise ValueError(f"width_m must not exceed length_m, got {width_m} and {length_m}")
    if template not in POWERS:
        raise ValueError(f"no template {template!r}; known: {', '.join(POWERS)}")
    if not 0 < step_deg <= 10:
        raise ValueError(f"step_deg must be above 0 and at most 10, got {step_deg!r}")
    if search_deg not in (90.0, 180.0):
        raise ValueError(f"search_deg must be 90 or 180, got {search_deg!r}")
    sides = float(length_m), float(width_m)
    settings = Filter(float(bin_m), float(sigma_m), float(alpha), *sides, POWERS[template], TIE)
    return settings, planned(step_deg, search_deg)


def away(angle: float, sight: np.ndarray) -> float:
    """Turn an axis by half a turn if need be, so that it leads away along the line of sight."""
    ahead = np.cos(angle) * sight[0] + np.sin(angle) * sight[1] >= 0
    return float(angle if ahead else angle + np.pi)
