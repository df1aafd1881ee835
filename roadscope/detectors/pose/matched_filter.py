"""Pose by a rotating line pair and a matched filter (Zhang 2017, sections 2 and 3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import Literal, NamedTuple, TypedDict, Unpack

import numpy as np

from roadscope.core.arguments import check_not_negative, check_positive
from roadscope.detectors.pose.estimate import (
    VehiclePose,
    check_spread,
    checked_origin,
    checked_points,
)
from roadscope.detectors.pose.filter_kernels import FilterSettings, Frames, free_scores, place_at

Template = Literal["echo", "extent", "plateau"]
POWERS: dict[Template, int] = {"echo": 2, "extent": 1, "plateau": 0}
TIE = 1e-3
"""Responses that differ by less are equal: a template longer than the visible part of a side fits
equally well at several positions. Chosen by hand."""
MOVING_M_S = 1.0
"""Above this speed the direction of motion decides which end is the front; chosen by hand."""


class FilterOptions(TypedDict, total=False):
    """Options of the matched filter; `filter_options` has the defaults.

    sigma_m: standard deviation of the smoothed edges, twice the range noise. alpha: penalty of a
    return outside the body. bin_m, step_deg: steps of positions and angles. search_deg: range of
    angles; with the paper's 90 deg length and width are confused, so the default is 180 deg.
    template: with "extent" the share of returns of a face is its extent times the cosine of
    incidence; with "echo" it is the extent times the square of the cosine, because echoes fade with
    incidence; "plateau" has no near edge, which is the paper's step function taken literally.
    """

    bin_m: float
    sigma_m: float
    alpha: float
    step_deg: float
    search_deg: float
    template: Template


class _Angles(NamedTuple):
    """The angles of a search: multiples of a step in radians, counted from the initial angle."""

    step: float
    number: int


def fit_single(
    points_xy: np.ndarray,
    origin: np.ndarray,
    *,
    length_m: float,
    width_m: float,
    **options: Unpack[FilterOptions],
) -> VehiclePose:
    """Return the rectangle of known size that fits one frame best (Zhang 2017, eq. 1-9).

    points_xy: (N, 2) metres, returns of one vehicle, at least one. origin: (2,) metres, the sensor
    in the same frame. yaw points away from the sensor, because a rectangle has no front. options:
    see `FilterOptions`.

    The bodies of eq. 1-9 are not known to us. Here the template along each axis has an edge at the
    near end of the body and a plateau as long as the body. They are weighted by the shares of
    returns of the two visible faces under the viewing angle, and smoothed, so that the edges are
    error functions. The template has unit energy, and alpha is subtracted outside.
    """
    points, place = checked_points(points_xy), checked_origin(origin)
    return fit_multi([points], [place], np.zeros(1), length_m=length_m, width_m=width_m, **options)


def fit_multi(
    frames: Sequence[np.ndarray],
    origins: Sequence[np.ndarray],
    stamps_s: Sequence[float] | np.ndarray,
    *,
    length_m: float,
    width_m: float,
    at: int | None = None,
    tied: bool = True,
    **options: Unpack[FilterOptions],
) -> VehiclePose:
    """Return the rectangle of known size in one of F frames, fitted to all (Zhang 2017, eq. 10-12).

    frames: F arrays (N, 2) of one vehicle's returns in metres, all in one fixed coordinate frame,
    at least one return in each. origins: F (2,) positions of the sensor in it. stamps_s: F stamps,
    rising. at: index of the frame whose pose is returned, by default the middle one; -1 is the
    newest. tied: see below. The rest as in `fit_single`. yaw points in the direction of motion, or
    away from the sensor if the body hardly moved.

    All frames share the heading and the position across it. Along it they are moved by one
    velocity, which is searched. With `tied=False` each frame has its own shift, which is the weaker
    assumption of figure 4; the velocity is then the slope of the shifts over time.
    """
    stamps = _checked_stamps(stamps_s, len(frames), len(origins))
    reference = _checked_index(at, len(frames))
    settings, angles = filter_options(length_m, width_m, **options)
    if not all(len(points) for points in frames):
        raise ValueError("a pose needs at least 1 point in each frame, got none in one")
    for points in frames:
        check_spread(checked_points(points))
    sensors = np.array([checked_origin(o) for o in origins])
    centred, point = _centred(frames, sensors, stamps, reference)
    angle = _best_angle(centred, settings, angles, tied)
    best = place_at(centred, angle, settings, tied)
    axis = np.array([np.cos(angle), np.sin(angle)])
    x, y = point + best.along[reference] * axis + best.across * np.array([-axis[1], axis[0]])
    moves = abs(best.velocity) >= MOVING_M_S
    forward = best.velocity >= 0 if moves else axis @ centred.sights[reference] >= 0
    yaw = angle if forward else angle + np.pi
    return VehiclePose(float(x), float(y), yaw, length_m, width_m, score=best.score)


def _centred(
    frames: Sequence[np.ndarray], origins: np.ndarray, stamps: np.ndarray, reference: int
) -> tuple[Frames, np.ndarray]:
    """Return the frames as the filter takes them, and the (2,) reference point.

    The reference point is the mean of the reference frame: the line pair passes through it.
    """
    means = np.array([np.mean(points, axis=0) for points in frames], np.float64)
    counts = [len(points) for points in frames]
    every, own_means = np.concatenate(frames).astype(np.float64), np.repeat(means, counts, axis=0)
    point = means[reference]
    from_mean, from_reference = (np.hypot(*(every - place).T).max() for place in (own_means, point))
    centred = Frames(
        every - own_means,
        np.array([0, *accumulate(counts)]),
        means - point,
        means - origins,
        stamps - stamps[reference],
        float(from_mean),
        float(from_reference),
    )
    return centred, point


def _best_angle(frames: Frames, settings: FilterSettings, angles: _Angles, tied: bool) -> float:
    """Return the angle of the greatest score, between the steps of the search.

    Frames with shifts of their own score at least as much as tied frames. So a tied score is
    computed only for angles whose free score is not below the best tied score so far.
    """
    start = initial_angle(frames)
    tried = start + angles.step * np.arange(angles.number)
    scores = free_scores(frames, tried, settings)
    is_tied = tied and len(frames.stamps) > 1
    if is_tied:
        bounds, scores = scores, np.full(len(tried), -np.inf)
        for k in np.argsort(-bounds, kind="stable"):
            if bounds[k] < scores.max():
                break
            scores[k] = place_at(frames, tried[k], settings, tied).score
    best = int(scores.argmax())
    beside = tried[best] + np.array([-angles.step, angles.step])
    if is_tied:
        before, after = (place_at(frames, angle, settings, tied).score for angle in beside)
    else:
        before, after = free_scores(frames, beside, settings)
    # The parabola through the best score and its neighbours stands for smaller steps.
    bend = before - 2 * scores[best] + after
    off = min(max(0.5 * (before - after) / bend, -0.5), 0.5) if bend < 0 else 0.0
    return float(tried[best] + angles.step * off)


def initial_angle(frames: Frames) -> float:
    """Return the direction of the line that fits the points best, radians.

    It minimises the squared distances from the line; the paper's slope of y over x cannot describe
    vertical lines. Points without a direction give the line of sight.
    """
    x, y = frames.points.T
    xx, xy, yy = (float(np.mean(product)) for product in (x * x, x * y, y * y))
    if math.hypot(xx - yy, 2 * xy) <= 1e-12:
        return math.atan2(frames.sights[0, 1], frames.sights[0, 0])
    return 0.5 * math.atan2(2 * xy, xx - yy)


@lru_cache(maxsize=256)
def filter_options(
    length_m: float,
    width_m: float,
    *,
    bin_m: float = 0.02,
    sigma_m: float = 0.04,
    alpha: float = 0.5,
    step_deg: float = 1.0,
    search_deg: float = 180.0,
    template: Template = "echo",
) -> tuple[FilterSettings, _Angles]:
    """Return the settings of the filter for a body of known size, and the angles to try.

    Raises `ValueError` for impossible options. A step that does not divide the search evenly is
    shortened.
    """
    check_positive(length_m=length_m, width_m=width_m, sigma_m=sigma_m, bin_m=bin_m)
    check_not_negative(alpha=alpha)
    if width_m > length_m:
        raise ValueError(f"width_m must not exceed length_m, got {width_m} and {length_m}")
    if template not in POWERS:
        raise ValueError(f"no template {template!r}; known: {', '.join(POWERS)}")
    if not 0 < step_deg <= 10:
        raise ValueError(f"step_deg must be above 0 and at most 10, got {step_deg!r}")
    if search_deg not in (90.0, 180.0):
        raise ValueError(f"search_deg must be 90 or 180, got {search_deg!r}")
    settings = FilterSettings(
        float(bin_m),
        float(sigma_m),
        float(alpha),
        float(length_m),
        float(width_m),
        POWERS[template],
        TIE,
    )
    count = math.ceil(search_deg / step_deg - 1e-9)
    return settings, _Angles(math.radians(search_deg / count), count)


def _checked_stamps(
    stamps_s: Sequence[float] | np.ndarray, frames: int, origins: int
) -> np.ndarray:
    stamps = np.asarray(stamps_s, np.float64)
    if not frames:
        raise ValueError("a multi-frame fit needs at least 1 frame, got none")
    if stamps.shape != (frames,) or origins != frames:
        raise ValueError(
            f"frames, origins and stamps must be equally many, got {frames}, {origins}, "
            f"{stamps.shape}"
        )
    if not np.isfinite(stamps).all() or not all(a < b for a, b in pairwise(stamps)):
        raise ValueError(f"stamps must be finite and rising, got {stamps}")
    return stamps


def _checked_index(at: int | None, frames: int) -> int:
    if at is None:
        return frames // 2
    if not -frames <= at < frames:
        raise ValueError(f"at must name one of {frames} frames, got {at}")
    return at % frames
