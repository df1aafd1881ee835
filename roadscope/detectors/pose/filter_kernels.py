"""Responses of the matched filter of Zhang 2017 (eq. 1 to 9) along the two axes of a line pair."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled

CUT_OFF_SD = 4.0
"""The Gaussian of a smoothed edge is cut off after so many standard deviations; chosen by hand."""
LAG_M = 0.5
"""The common velocity may move a frame this far from its own best position; chosen by hand."""


class Frames(NamedTuple):
    """The returns of one vehicle in F frames.

    points: (N, 2) metres from the mean of their frame, frame after frame. starts: (F + 1,) row
    of each frame's first point. means: (F, 2) of each frame, metres from the reference point.
    sights: (F, 2) from the sensor to the mean, metres. stamps: (F,) seconds from the stamp of the
    reference frame. from_mean, from_reference: greatest distance of a point from the mean of its
    frame and from the reference point, metres.
    """

    points: np.ndarray
    starts: np.ndarray
    means: np.ndarray
    sights: np.ndarray
    stamps: np.ndarray
    from_mean: float
    from_reference: float


class FilterSettings(NamedTuple):
    """Settings of the matched filter.

    bin_m: width of a bin. sigma_m: of the Gaussian that smooths the edges. alpha: penalty of a
    return outside the body. length_m, width_m: of the body. power: of the cosine in the share of
    returns of a face, 0 for no near edge. tie: responses that differ by less are equal.
    """

    bin_m: float
    sigma_m: float
    alpha: float
    length_m: float
    width_m: float
    power: int
    tie: float


class Placement(NamedTuple):
    """The best place of the body at one angle.

    along: (F,) positions of the body's centre along the long axis, one for each frame. across: its
    position along the other axis. Both are in metres from the reference point. velocity: along the
    long axis, metres per second.
    """

    score: float
    velocity: float
    across: float
    along: np.ndarray


class Line(NamedTuple):
    """One line of the pair.

    x, y: its unit vector. offset: coordinate of the points' origin along it, metres. points_away:
    whether it points away from the sensor.
    """

    x: float
    y: float
    offset: float
    points_away: bool


@compiled()
def near_face_share(
    sight: np.ndarray, line: Line, extent: float, other_extent: float, power: int
) -> float:
    """Return the share of the returns that lie on the face at the near end of a line.

    Under the viewing angle beta between the line of sight and this line, the face at the near end
    gives other_extent * |cos beta|^power returns and the one along the line
    extent * |sin beta|^power.
    """
    if power == 0:
        return 0.0
    cosine = abs(sight[0] * line.x + sight[1] * line.y)
    sine = abs(sight[0] * line.y - sight[1] * line.x)
    end, side = other_extent * cosine**power, extent * sine**power
    return end / (end + side) if end + side > 0.0 else 0.0


@compiled()
def axis_response(
    points: np.ndarray, line: Line, extent: float, share: float, settings: FilterSettings, bins: int
) -> np.ndarray:
    """Return the mean response (bins,) of returns (N, 2) to the template along one line.

    extent: of the body along the line, metres. share: of the near face. Entry i is the response
    with the body's centre at (i - bins // 2) * bin_m.

    The template is share * (Gaussian at the near edge) + (1 - share) * (plateau as long as the
    body), divided by the root of its energy, minus alpha outside the body.
    """
    bin_m, sigma, half = settings.bin_m, settings.sigma_m / settings.bin_m, bins // 2
    reach = math.ceil(CUT_OFF_SD * sigma)
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    taps /= taps.sum() * len(points)
    # The line is turned so that the near edge comes first, and moved by half the extent, so that
    # a near edge in a bin means a centre in this bin. Each return is shared by two bins.
    scale = (1.0 if line.points_away else -1.0) / bin_m
    shift = scale * line.offset + 0.5 * extent / bin_m + half
    counts = np.zeros(bins)
    for i in range(len(points)):
        exact = scale * (points[i, 0] * line.x + points[i, 1] * line.y) + shift
        lower = int(exact)
        counts[lower] += lower + 1 - exact
        counts[lower + 1] += exact - lower
    density = np.zeros(bins)
    for i in range(reach, bins - reach):
        if counts[i] > 0.0:
            smoothed = density[i - reach : i + reach + 1]
            for k in range(len(taps)):
                smoothed[k] += counts[i] * taps[k]
    # How many returns lie before the middle of each bin, and how many of them in the body.
    before = np.cumsum(density) - 0.5 * density
    energy = _template_energy(share, extent, settings.sigma_m)
    edge, plateau = share / (bin_m * energy), (1.0 - share) / (extent * energy)
    whole, part = int(extent / bin_m), extent / bin_m % 1.0
    response = np.empty(bins)
    for i in range(bins):
        last, after = min(i + whole, bins - 1), min(i + whole + 1, bins - 1)
        inside = (1.0 - part) * before[last] + part * before[after] - before[i]
        response[i] = edge * density[i] + plateau * inside - settings.alpha * (1.0 - inside)
    return response if line.points_away else response[::-1].copy()


@compiled()
def _template_energy(share: float, extent: float, sigma: float) -> float:
    """Return the root of the energy of share * Gaussian + (1 - share) * plateau."""
    rest, root = 1.0 - share, math.sqrt(math.pi)
    edge = share * share / (2.0 * root * sigma)
    both = share * rest / extent
    plateau = rest * rest / (extent * extent) * max(extent - 2.0 * sigma / root, 0.5 * extent)
    return math.sqrt(edge + both + plateau)


@compiled()
def peak(response: np.ndarray, tie: float) -> float:
    """Return the position of the greatest response, in bins from the middle.

    Of equal responses (within `tie`) the middle one counts. A single peak is interpolated by the
    parabola through its neighbours.
    """
    best = int(response.argmax())
    first = last = best
    while first > 0 and response[first - 1] >= response[best] - tie:
        first -= 1
    while last + 1 < len(response) and response[last + 1] >= response[best] - tie:
        last += 1
    place = 0.5 * (first + last)
    if first == last and 0 < best < len(response) - 1:
        before, after = response[best - 1], response[best + 1]
        place += 0.5 * (before - after) / (before - 2.0 * response[best] + after)
    return place - len(response) // 2


@compiled()
def pair_responses(
    frames: Frames, angle: float, settings: FilterSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Return the responses along (F, K) and across (M,) of a line pair at an angle.

    Along the long axis each frame has responses of its own, from its own mean. Across it all frames
    share one response, from the reference point. A frame's weight is its share of the returns.
    """
    length, width = settings.length_m, settings.width_m
    x, y = math.cos(angle), math.sin(angle)
    long_bins = _bins(frames.from_mean + 0.5 * length, settings)
    wide_bins = _bins(frames.from_reference + 0.5 * width, settings)
    along, across = np.empty((len(frames.stamps), long_bins)), np.zeros(wide_bins)
    for f in range(len(frames.stamps)):
        points = frames.points[frames.starts[f] : frames.starts[f + 1]]
        sight, mean = frames.sights[f], frames.means[f]
        weight = len(points) / len(frames.points)
        line = Line(x, y, 0.0, sight[0] * x + sight[1] * y >= 0.0)
        share = near_face_share(sight, line, length, width, settings.power)
        along[f] = weight * axis_response(points, line, length, share, settings, long_bins)
        line = Line(-y, x, mean[1] * x - mean[0] * y, sight[1] * x - sight[0] * y >= 0.0)
        share = near_face_share(sight, line, width, length, settings.power)
        across += weight * axis_response(points, line, width, share, settings, wide_bins)
    return along, across


@compiled()
def _bins(reach_m: float, settings: FilterSettings) -> int:
    """Return how many bins, an odd number, hold all positions of the body and smoothed returns."""
    half = math.ceil((reach_m + CUT_OFF_SD * settings.sigma_m) / settings.bin_m) + 3
    return 2 * half + 1


@compiled()
def free_scores(frames: Frames, angles: np.ndarray, settings: FilterSettings) -> np.ndarray:
    """Return the scores (A,) of angles if each frame has its own best position along the body."""
    scores = np.empty(len(angles))
    for a in range(len(angles)):
        along, across = pair_responses(frames, angles[a], settings)
        scores[a] = across.max()
        for f in range(len(along)):
            scores[a] += along[f].max()
    return scores


@compiled()
def place_at(frames: Frames, angle: float, settings: FilterSettings, tied: bool) -> Placement:
    """Return the best placement at an angle.

    tied: whether one velocity moves all frames. Otherwise each frame has its own position, and the
    velocity is the slope of these positions over time.
    """
    along, across = pair_responses(frames, angle, settings)
    stamps, bin_m, tie = frames.stamps, settings.bin_m, settings.tie
    means = frames.means[:, 0] * math.cos(angle) + frames.means[:, 1] * math.sin(angle)
    places = means.copy()
    score = across.max()
    for f in range(len(along)):
        places[f] += bin_m * peak(along[f], tie)
        score += along[f].max()
    times = stamps - stamps.mean()
    spread = (times * times).sum()
    velocity = (times * places).sum() / spread if spread > 0.0 else 0.0
    lateral = bin_m * peak(across, tie)
    if not tied or len(along) == 1:
        return Placement(score, velocity, lateral, places)
    # Steps of the velocity that move the outermost frame by one bin.
    step, count = bin_m / np.abs(stamps).max(), math.ceil(LAG_M / bin_m)
    scores = np.empty(2 * count + 1)
    for k in range(len(scores)):
        shifts = (stamps * (velocity + (k - count) * step) - means) / bin_m
        scores[k] = _shifted_sum(along, shifts).max()
    velocity += step * peak(scores, tie)
    total = _shifted_sum(along, (stamps * velocity - means) / bin_m)
    places = bin_m * peak(total, tie) + stamps * velocity
    return Placement(across.max() + total.max(), velocity, lateral, places)


@compiled()
def _shifted_sum(along: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Return the sum (K,) of the rows (F, K), each moved back by a shift (F,) in bins.

    Between bins a response is a straight line; beyond its row it is the row's least value.
    """
    size = along.shape[1]
    total = np.zeros(size)
    for f in range(len(along)):
        row, least, whole = along[f], along[f].min(), math.floor(shifts[f])
        part = shifts[f] - whole
        first, last = min(max(0, -whole), size), max(min(size, size - 1 - whole), 0)
        total[:first] += least
        for i in range(first, last):
            total[i] += (1.0 - part) * row[i + whole] + part * row[i + whole + 1]
        total[max(first, last) :] += least
    return total
