"""Search-based L-shape fitting (Zhang, Xu, Dong and Dolan 2017, "Efficient L-Shape Fitting")."""

from __future__ import annotations

import math
from functools import partial
from typing import Literal

import numpy as np

from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.completion import completions
from roadscope.detectors.shape.heading_kernels import (
    AREA,
    CLOSENESS,
    VARIANCE,
    line_heading,
    searched_heading,
)
from roadscope.detectors.shape.parts import bodies_in
from roadscope.detectors.shape.recognition import Vehicle

Criterion = Literal["area", "closeness", "variance"]
CRITERIA: dict[Criterion, int] = {"area": AREA, "closeness": CLOSENESS, "variance": VARIANCE}
NEAR_M = 0.05
"""Points nearer to a side than this count as on it; the paper has 0.01 m, less than any noise."""
TELLING, LEAST_M = 30, 0.03
"""Most outline points whose noise is taken to be independent, and the least noise believed in."""
MOST = 96
"""Outline points that are looked at: more of them say nothing new of the heading."""


def vehicles_by_l_shape(
    cluster: Cluster, horizon: Horizon, *, criterion: Criterion = "closeness"
) -> list[Vehicle]:
    """Return the road user whose two faces the outline of a cluster shows best.

    criterion: what the rectangle's heading is chosen by: `area` (least), `closeness` of the
    points to the sides, or `variance` (least) of their distances from the nearer side.
    """
    return bodies_in(cluster, horizon, partial(_vehicle, criterion=CRITERIA[criterion]))


def _vehicle(cluster: Cluster, horizon: Horizon, *, criterion: int) -> Vehicle | None:
    outline = _thinned(cluster.outline)
    yaws = [searched_heading(outline, criterion, NEAR_M)]
    if len(outline) > 1:
        yaws.append(line_heading(outline))
    candidates = (v for v in completions(cluster, yaws, horizon) if v is not None)
    return min(candidates, key=_misfit, default=None)


def _thinned(outline: np.ndarray) -> np.ndarray:
    """Take every so many points, the same ones counted from either end."""
    count = len(outline)
    if count <= MOST:
        return outline
    rows = np.arange(0, (count + 1) // 2, -(-count // MOST))
    thinned: np.ndarray = outline[np.unique(np.concatenate([rows, count - 1 - rows]))]
    return thinned


def _misfit(vehicle: Vehicle) -> float:
    """Return the negative log likelihood of an outline of unknown noise and of the body.

    The search tilts one noisy face until it looks like two; its line is the other candidate.
    """
    return min(vehicle.points, TELLING) * math.log(max(vehicle.residual_m, LEAST_M)) - vehicle.fit
