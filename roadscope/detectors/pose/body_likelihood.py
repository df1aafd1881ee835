"""The likelihood of rays under bodies in motion, and the misfit of each ray.

A body is a stack of upright parts with convex outlines. A ray that meets a part returns from its
surface, with Gaussian noise; a ray that meets none has no return from the body. Edges are soft by
a few centimetres, because no body has exactly the shape of its model.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_model import (
    ACCELERATION,
    OUTLINE_POINTS,
    SPEED,
    TURN_RATE,
    YAW,
    BodyShape,
    Outlines,
    X,
    Y,
    fill_outlines,
    new_outlines,
)
from roadscope.detectors.pose.body_rays import HIT, PASSED, ROUGHNESS_M, BodyRays

SOFT_SD = 2.2
"""A soft edge reaches so many standard deviations to either side."""
NOISE_SD = 6.0
"""Returns farther than so many standard deviations from a surface did not come from it."""
GRAZING_COSINE = 0.3
"""Cosine of incidence where a ray meets a part only because its silhouette is soft."""
FAINTEST = 0.01
"""Least probability that a surface from which a return came sends enough light back."""
STEEP = 4
"""Default of `Tolerance.steep`, for bodies whose paints differ."""
AMPLE = 16.0
"""More than so many times the light that is needed makes no difference."""
MOST_MISFIT = 3.5
"""Greatest misfit of a ray that passed: one ray in 500 is lost on a body or goes through a
window."""
EDGE_M = 0.006
"""Default uncertainty of silhouettes: with a harder edge the likelihood has no slope for a
search."""
NO_PART = 100.0
"""Misfit of a return at a height where the body has no part."""
HEIGHT_SLACK_M = 0.02
"""A return may lie so far above or below the part from which it came."""


class Tolerance(NamedTuple):
    """What the likelihood assumes about errors.

    edge_m, height_m: errors of the model's silhouettes and of the heights of its parts.
    rough_m: departure of real surfaces from the model's; the rays' noise already includes it.
    outlier, outlier_m: share of returns that fit nothing, and the depth in metres over which they
    are spread evenly.
    lost, through: probability that a ray that meets the body has no return, or one from behind it.
    steep: how alike the body's paints are. The ratio of the light that a surface sends back to the
    light that is needed is taken to this power. The probability of a return then falls from high to
    low while the ratio changes by about 1.8 / steep.
    """

    edge_m: float
    height_m: float
    rough_m: float
    outlier: float = 0.003
    outlier_m: float = 10.0
    lost: float = 0.004
    through: float = 0.001
    steep: int = STEEP


ROUGHLY_DRAWN = Tolerance(edge_m=EDGE_M, height_m=0.012, rough_m=ROUGHNESS_M)
"""For real bodies, which have only roughly the shape of their model."""
EXACTLY_DRAWN = Tolerance(edge_m=0.0013, height_m=0.0025, rough_m=0.0, steep=32)
"""For bodies with exactly the shape of their model. Edges still have some width, because samples
represent the posterior worse with sharper ones. The body has one paint; its brightest return tells
within 3 to 6 % how much light it sends back."""


class Ray2D(NamedTuple):
    """A ray in the frame of a body, seen from above.

    x, y: of its start. dx, dy: of its unit direction. height: of the start above the road.
    slope: rise per metre.
    """

    x: float
    y: float
    dx: float
    dy: float
    height: float
    slope: float


class Place(NamedTuple):
    """Pose of a body at a time, world frame.

    x, y: metres. cosine, sine: of the yaw. time: seconds.
    """

    x: float
    y: float
    cosine: float
    sine: float
    time: float


class Intersection(NamedTuple):
    """Where a ray meets a part.

    depth: how far inside the silhouette the ray passes, negative outside. margin: distance from
    the nearer of bottom and top to the height at which it meets the part, negative outside.
    distance: along the ray. cosine: of incidence. All lengths in metres.
    """

    depth: float
    margin: float
    distance: float
    cosine: float


class PartsOnRay(NamedTuple):
    """The parts that a ray may meet, in arrays (P,); the first entries are filled, one for a part.

    distances: metres along the ray. chances: probability that the ray meets the part. bright:
    probability that the part sends enough light back.
    """

    distances: np.ndarray
    chances: np.ndarray
    bright: np.ndarray


class RayFits(NamedTuple):
    """How M rays fit K states.

    likelihoods: (K, M) density of a return (per metre), or probability of none. misfits: (K, M) in
    standard deviations: how far a return lies from the surface, or how far inside the silhouette a
    ray without a return from the body passes.
    """

    likelihoods: np.ndarray
    misfits: np.ndarray


@compiled(borrowing=True)
def pose_after(state: np.ndarray, time: float) -> tuple[float, float, float]:
    """Return x, y and yaw of a state (11,) after a time: constant turn rate and acceleration.

    The path is replaced by its chord, which is exact at a constant speed. time: seconds.
    """
    path = (state[SPEED] + 0.5 * state[ACCELERATION] * time) * time
    half = 0.5 * state[TURN_RATE] * time
    chord = path * (1.0 - half * half / 6.0) if abs(half) < 1e-3 else path * math.sin(half) / half
    heading = state[YAW] + half
    x, y = state[X] + chord * math.cos(heading), state[Y] + chord * math.sin(heading)
    return x, y, heading + half


@compiled(borrowing=True)
def intersection(
    ray: Ray2D, outlines: Outlines, p: int, bottom: float, top: float, edge_m: float
) -> Intersection:
    """Return where a ray meets a part.

    edge_m: a ray that misses the silhouette by less than this meets the part at its nearest point.
    """
    x, y, inverse = outlines.x, outlines.y, outlines.inverse
    # The outline is symmetric: half of its points give its extent to either side.
    left, right, offset = -np.inf, -np.inf, ray.dx * ray.y - ray.dy * ray.x
    for i in range(OUTLINE_POINTS // 2):
        up, along = abs(ray.dx) * y[p, i], ray.dy * x[p, i]
        left, right = max(left, up - along), max(right, up + along)
    depth = min(left - offset, right + offset)
    if depth < -edge_m:
        return Intersection(depth, 0.0, -1.0, 0.0)
    distance, far, cosine, nearest = 0.0, 0.0, GRAZING_COSINE, np.inf
    j = OUTLINE_POINTS - 1
    before = ray.dx * (y[p, j] - ray.y) - ray.dy * (x[p, j] - ray.x)
    for i in range(OUTLINE_POINTS):
        aside = ray.dx * (y[p, i] - ray.y) - ray.dy * (x[p, i] - ray.x)
        if depth <= 0.0:
            if abs(aside) < nearest:
                nearest = abs(aside)
                distance = ray.dx * (x[p, i] - ray.x) + ray.dy * (y[p, i] - ray.y)
        elif (before > 0.0) != (aside > 0.0):
            # The ray crosses the side from point j to point i: into the body, or out of it.
            share = before / (before - aside)
            crossed_x = x[p, j] + share * (x[p, i] - x[p, j])
            crossed_y = y[p, j] + share * (y[p, i] - y[p, j])
            along = ray.dx * (crossed_x - ray.x) + ray.dy * (crossed_y - ray.y)
            if before > 0.0:
                distance, cosine = along, (before - aside) * inverse[p, j]
            else:
                far = along
        before, j = aside, i
    height = ray.height + ray.slope * distance
    margin = min(top - height, height - bottom)
    # A ray that enters the outline above or below the part may meet its top or bottom.
    if depth > 0.0 and margin < 0.0 and ray.slope != 0.0:
        end, is_above = ray.height + ray.slope * far, height > top
        inside = top - end if is_above else end - bottom
        if inside > 0.0:
            level = top if is_above else bottom
            margin, distance = inside, (level - ray.height) / ray.slope
    return Intersection(depth, margin, distance, cosine)


@compiled(borrowing=True)
def soft_step(z: float) -> float:
    """Return about the probability that a standard normal is below z: 0 below -2.2, 1 above 2.2."""
    share = min(max(z, -SOFT_SD), SOFT_SD) / (2.0 * SOFT_SD) + 0.5
    return share * share * (3.0 - 2.0 * share)


@compiled(borrowing=True)
def brightness(need: float, crossing: Intersection, steep: int) -> float:
    """Return the probability that the surface where a ray meets a part sends enough light back."""
    if need == 0.0:
        return 1.0
    ratio = max(min(crossing.cosine / (need * crossing.distance**2), AMPLE), 0.0) ** steep
    return ratio / (1.0 + ratio)


def ray_fits(
    states: np.ndarray, shape: BodyShape, rays: BodyRays, tolerance: Tolerance, slack_m: float
) -> RayFits:
    """Return how each ray fits each state (K, 11).

    slack_m: for misfits, added to the noise of ranges and to the softness of silhouettes.
    """
    size, parts = (len(states), len(rays.slope)), len(shape.sections)
    fits = RayFits(np.empty(size), np.empty(size))
    on_ray = PartsOnRay(np.empty(parts), np.empty(parts), np.empty(parts))
    _fill_fits(fits, states, shape, rays, tolerance, slack_m, new_outlines(parts), on_ray)
    return fits


@compiled(borrowing=True)
def _fill_fits(
    fits: RayFits,
    states: np.ndarray,
    shape: BodyShape,
    rays: BodyRays,
    tolerance: Tolerance,
    slack_m: float,
    outlines: Outlines,
    on_ray: PartsOnRay,
) -> None:
    """Fill in how each ray fits each state; outlines and on_ray are work space.

    A kernel that made them itself would count references to all arrays, and take 1.3 times as long.
    """
    count, parts = len(rays.slope), len(shape.sections)
    edge, slack = SOFT_SD * tolerance.edge_m, SOFT_SD * tolerance.height_m
    for k in range(len(states)):
        fill_outlines(shape, states[k], outlines)
        place = place_after(states, k, 0.0)
        for m in range(count):
            if rays.time[m] != place.time:
                place = place_after(states, k, rays.time[m])
            ray = ray_in_body(place, rays, m)
            kind, reach, sigma = rays.kind[m], rays.reach[m], rays.sigma[m]
            is_hit, height = kind == HIT, ray.height + ray.slope * reach
            need = 0.0 if kind == PASSED else rays.need[m]
            reached = np.inf if is_hit else edge
            low, high = heights_at_body(ray, outlines, reached)
            if is_hit:
                low, high = min(low, height), max(high, height)
            count_on_ray, misfit = 0, NO_PART if is_hit else 0.0
            for p in range(parts):
                bottom, top = shape.sections[p, 0], shape.sections[p, 1]
                if low > top + slack or high < bottom - slack:
                    continue
                crossing = intersection(ray, outlines, p, bottom, top, reached)
                light = brightness(need, crossing, tolerance.steep)
                chance = soft_step(crossing.depth / tolerance.edge_m)
                chance *= soft_step(crossing.margin / tolerance.height_m)
                if chance > 0.0 and crossing.distance > 0.0:
                    on_ray.distances[count_on_ray] = crossing.distance
                    on_ray.chances[count_on_ray], on_ray.bright[count_on_ray] = chance, light
                    count_on_ray += 1
                if not is_hit and 0.0 < crossing.distance <= reach:
                    depth = min(crossing.depth, crossing.margin) / (tolerance.edge_m + slack_m)
                    misfit = max(misfit, min(depth, greatest_misfit(kind, light)))
                elif is_hit and bottom - HEIGHT_SLACK_M <= height <= top + HEIGHT_SLACK_M:
                    off = return_misfit(
                        reach, crossing, math.hypot(sigma, slack_m), tolerance.edge_m + slack_m
                    )
                    misfit = off if abs(off) < abs(misfit) else misfit
            fits.likelihoods[k, m] = likelihood_of(
                kind, reach, sigma, on_ray, count_on_ray, tolerance
            )
            fits.misfits[k, m] = misfit


@compiled(borrowing=True)
def likelihood_of(
    kind: int,
    reach: float,
    sigma: float,
    on_ray: PartsOnRay,
    count_on_ray: int,
    tolerance: Tolerance,
) -> float:
    """Return the density of a ray's return, or the probability of none."""
    is_hit = kind == HIT
    value, missed = (tolerance.outlier / tolerance.outlier_m, 0.0) if is_hit else (0.0, 1.0)
    silent = tolerance.through if kind == PASSED else tolerance.lost
    for i in range(count_on_ray):
        # Probability that the ray meets this part and no nearer one.
        meets_first, distance = on_ray.chances[i], on_ray.distances[i]
        for j in range(count_on_ray):
            if on_ray.distances[j] < distance:
                meets_first *= 1.0 - on_ray.chances[j]
        z = (reach - distance) / sigma
        if not is_hit and distance < reach:
            value += meets_first * max(1.0 - on_ray.bright[i], silent)
            missed *= 1.0 - on_ray.chances[i]
        elif is_hit and abs(z) < NOISE_SD:
            density = math.exp(-0.5 * z * z) / (math.sqrt(2.0 * math.pi) * sigma)
            bright = max(on_ray.bright[i], FAINTEST)
            value += meets_first * (1.0 - tolerance.outlier) * density * bright
    return value + missed


@compiled(borrowing=True)
def return_misfit(reach: float, crossing: Intersection, sigma: float, edge_m: float) -> float:
    """Return the misfit of a return: of its range or, beside the silhouette, of its direction."""
    off, cosine = crossing.distance - reach, crossing.cosine
    if crossing.depth > 0.0:
        return off * cosine / math.sqrt((sigma * cosine) ** 2 + edge_m**2 * (1.0 - cosine**2))
    return abs(crossing.depth) / edge_m


@compiled(borrowing=True)
def greatest_misfit(kind: int, light: float) -> float:
    """Return the greatest misfit of a ray that passed or has no return.

    Without a return it is less if the surface is perhaps too dark. light: probability that it is
    bright enough.
    """
    if kind == PASSED:
        return MOST_MISFIT
    return min(MOST_MISFIT, math.sqrt(-2.0 * math.log(max(1.0 - light, 1e-30))))


@compiled(borrowing=True)
def place_after(states: np.ndarray, k: int, time: float) -> Place:
    """Return the pose of the body of state k of (K, 11) after a time in seconds."""
    x, y, yaw = pose_after(states[k], time)
    return Place(x, y, math.cos(yaw), math.sin(yaw), time)


@compiled(borrowing=True)
def ray_in_body(place: Place, rays: BodyRays, m: int) -> Ray2D:
    """Return a ray in the frame of the body."""
    x, y = rays.origin[m, 0] - place.x, rays.origin[m, 1] - place.y
    dx, dy = rays.direction[m, 0], rays.direction[m, 1]
    return Ray2D(
        place.cosine * x + place.sine * y,
        place.cosine * y - place.sine * x,
        place.cosine * dx + place.sine * dy,
        place.cosine * dy - place.sine * dx,
        rays.origin[m, 2],
        rays.slope[m],
    )


@compiled(borrowing=True)
def heights_at_body(ray: Ray2D, outlines: Outlines, edge_m: float) -> tuple[float, float]:
    """Return the least and the greatest height of a ray over the rectangle around the body.

    For a ray that misses this rectangle by more than `edge_m` they are infinity and minus infinity.
    """
    half_length, half_width = outlines.size
    aside = abs(ray.dy) * half_length + abs(ray.dx) * half_width
    if abs(ray.dx * ray.y - ray.dy * ray.x) > aside + edge_m:
        return np.inf, -np.inf
    middle = ray.height - ray.slope * (ray.dx * ray.x + ray.dy * ray.y)
    rise = abs(ray.slope) * (abs(ray.dx) * half_length + abs(ray.dy) * half_width)
    return middle - rise, middle + rise
