"""What is known of a vehicle's body before it is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import (
    AFT,
    AFT_REACH,
    AFT_X,
    AFT_Y,
    BOTTOM,
    COLUMNS,
    FORE,
    FORE_REACH,
    FORE_X,
    FORE_Y,
    FRONT,
    HALF,
    HIT,
    MOST_PARTS,
    NOSE,
    RADIUS,
    REAR,
    TAIL,
    TOP,
    Rays,
)
from roadscope.detectors.pose.body_lanes import Drawn

UNKNOWNS = 5
"""Length, width, corner radius, set-backs of the nose and of the tail."""
GLASS = 6.0
"""By how much less a window sends back than light paint: two surfaces of refractive index 1.5
reflect 4 % each (Fresnel), light paint half of the light."""


class Storey(NamedTuple):
    """One storey of a body: heights above the road and set-backs from the ends, metres.

    nose_sd_m, tail_sd_m: how well the set-backs are known. breadth: share of the width.
    """

    bottom_m: float
    top_m: float
    tail_m: float = 0.0
    nose_m: float = 0.0
    breadth: float = 1.0
    tail_sd_m: float = 0.0
    nose_sd_m: float = 0.0


@dataclass(frozen=True, slots=True)
class BodyModel:
    """A stack of storeys with rounded corners, symmetric about its long axis.

    length_m, width_m: mean and standard deviation. radius_m: least and greatest corner radius,
    small ones as likely as middling ones and the greatest half as likely; it is cut to what the
    narrowest storey has room for.
    axles: rear and front axle as shares of the length from the centre; narrowing: width at the
    tail and at the nose as shares of the width between the axles. drawn_m: standard deviation,
    along and across, of where what is seen lies on the body; one for all returns, so that no
    number of them makes the pose surer than that.
    glass_m: heights from and up to which the body is of glass, metres above the road.
    """

    length_m: tuple[float, float]
    width_m: tuple[float, float]
    radius_m: tuple[float, float] = (0.0, 0.4)
    storeys: tuple[Storey, ...] = (Storey(0.15, 1.5),)
    axles: tuple[float, float] = (-0.28, 0.3)
    narrowing: tuple[float, float] = (1.0, 1.0)
    drawn_m: float = 0.0
    glass_m: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("length_m", "width_m"):
            told = getattr(self, name)
            pair = np.shape(told) == (2,)
            if not (pair and 0 < told[0] < np.inf and 0 <= told[1] < told[0] / 2):
                raise ValueError(
                    f"{name} must be (mean, standard deviation) in metres, the mean positive and "
                    f"more than twice the deviation, got {told}"
                )
        least, most = self.radius_m
        if not 0 <= least <= most < self.width_m[0] / 2:
            raise ValueError(
                f"radius_m must be (least, greatest) from 0 to half the width, got {self.radius_m}"
            )
        if not 0 <= self.drawn_m < np.inf:
            raise ValueError(f"drawn_m must be zero or more metres, got {self.drawn_m}")
        if self.glass_m is not None and not 0 <= self.glass_m[0] < self.glass_m[1]:
            raise ValueError(f"glass_m must be (from, up to) in metres, got {self.glass_m}")
        if not 1 <= len(self.storeys) <= MOST_PARTS:
            raise ValueError(f"a body has 1 to {MOST_PARTS} storeys, got {len(self.storeys)}")

    @property
    def uncertain(self) -> np.ndarray:
        """Indices of those of the `UNKNOWNS` that are not known exactly."""
        spreads = (
            self.length_m[1],
            self.width_m[1],
            self.radius_m[1] - self.radius_m[0],
            max(storey.nose_sd_m for storey in self.storeys),
            max(storey.tail_sd_m for storey in self.storeys),
        )
        return np.flatnonzero(np.array(spreads) > 0)

    def sizes(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return lengths and widths (K,) in metres for (K, 5) standard normal unknowns."""
        length = self.length_m[0] + self.length_m[1] * unknowns[:, 0]
        width = self.width_m[0] + self.width_m[1] * unknowns[:, 1]
        floor_length, floor_width = 0.3 * self.length_m[0], 0.3 * self.width_m[0]
        return np.maximum(length, floor_length), np.maximum(width, floor_width)

    def glazed(self, rays: Rays) -> Rays:
        """Return the rays of one scan, those at the windows' height with what glass needs.

        A window seen at a slant sends nothing back where paint still would; taken for paint, a
        silent ray would tell for certain that the body does not reach there. Rays without a
        return of the body have the height that they have at its mean distance.
        """
        hits = rays.kind == HIT
        if self.glass_m is None or not hits.any():
            return rays
        reach = np.where(hits, rays.reach, rays.reach[hits].mean())
        height = rays.origin[:, 2] + rays.slope * reach
        low, high = self.glass_m
        dark = (low < height) & (height < high)
        return rays._replace(need=np.where(dark, GLASS * rays.need, rays.need))

    def parts(self, unknowns: np.ndarray) -> np.ndarray:
        """Return the parts (K, P, 16) as the likelihood wants them for (K, 5) unknowns."""
        parts = np.empty((len(unknowns), len(self.storeys), COLUMNS))
        shape = (*self.radius_m, *self.axles, *self.narrowing)
        length, width = self.sizes(unknowns)
        fill_parts(unknowns, np.stack([length, width]), np.array(self.storeys), shape, parts)
        return parts


@compiled(borrowing=True)
def fill_parts(
    unknowns: np.ndarray,
    sizes: np.ndarray,
    storeys: np.ndarray,
    shape: tuple[float, float, float, float, float, float],
    parts: np.ndarray,
) -> None:
    """Fill parts (K, P, 16).

    unknowns: (K, 5). sizes: (2, K) lengths and widths, metres. shape: least and greatest radius,
    axles, narrowing.
    """
    for k in range(len(parts)):
        length, width = sizes[0, k], sizes[1, k]
        # Folded at the least radius, so that a sharp body is no wall that a search runs along.
        share = min(0.5 * abs(1.0 + unknowns[k, 2]), 1.0)
        radius = shape[0] + (shape[1] - shape[0]) * share
        aft, fore = shape[2] * length, shape[3] * length
        for p in range(len(storeys)):
            bottom, top, tail, nose, breadth, tail_sd, nose_sd = storeys[p]
            rear = tail + tail_sd * unknowns[k, 4] - 0.5 * length
            front = max(0.5 * length - nose - nose_sd * unknowns[k, 3], rear + 0.3)
            half = 0.5 * breadth * width
            # How far an end lies beyond its axle, as a share of the body's overhang.
            behind = min(max((aft - rear) / (0.5 * length + aft), 0.0), 1.0)
            ahead = min(max((front - fore) / (0.5 * length - fore), 0.0), 1.0)
            part = parts[k, p]
            part[REAR], part[FRONT], part[HALF] = rear, front, half
            part[TAIL] = half * (1.0 - (1.0 - shape[4]) * behind)
            part[NOSE] = half * (1.0 - (1.0 - shape[5]) * ahead)
            room = 0.499 * min(front - rear, 2.0 * min(part[TAIL], part[NOSE]))
            curved = part[RADIUS] = min(radius, room)
            part[BOTTOM], part[TOP] = bottom, top
            # Flanks have narrowed to the ends' width where the corners begin.
            part[AFT], part[FORE] = max(aft, rear + curved), min(fore, front - curved)
            part[FORE_X], part[FORE_Y], part[FORE_REACH] = _flank(
                half - part[NOSE], front - curved - part[FORE], part[FORE], half
            )
            part[AFT_X], part[AFT_Y], part[AFT_REACH] = _flank(
                part[TAIL] - half, part[AFT] - (rear + curved), part[AFT], half
            )


@compiled(borrowing=True)
def _flank(less: float, over: float, x: float, half: float) -> tuple[float, float, float]:
    """Return normal and reach of a left flank that narrows by so much over a length from x on."""
    length = math.sqrt(less * less + over * over)
    if over <= 0.0:
        return 0.0, 1.0, half
    nx, ny = less / length, over / length
    return nx, ny, nx * x + ny * half


@cache
def drawn(model: BodyModel) -> Drawn:
    """Return a body as kernels draw it."""
    return Drawn(
        np.array([model.length_m, model.width_m]),
        np.array(model.storeys),
        (*model.radius_m, *model.axles, *model.narrowing),
    )


def saloon(length_m: tuple[float, float], width_m: tuple[float, float]) -> BodyModel:
    """Return a usual three-box car: bumpers and doors, bonnet and boot, glass and roof.

    Heights and set-backs are drawn by eye after one mid-size saloon, a Ford Fusion, rounded; their
    spread is guessed, as is that bumpers and flanks are drawn to 3 cm. They are no statistics.
    """
    return BodyModel(
        length_m,
        width_m,
        storeys=(
            Storey(0.16, 0.75),
            Storey(0.75, 0.88, 0.02, 0.18, 0.99, 0.015, 0.06),
            Storey(0.88, 1.00, 0.05, 0.70, 0.97, 0.03, 0.25),
            Storey(1.00, 1.20, 0.50, 1.45, 0.88, 0.20, 0.25),
            Storey(1.20, 1.48, 1.10, 1.95, 0.78, 0.30, 0.25),
        ),
        narrowing=(0.97, 0.96),
        drawn_m=0.03,
    )
