"""Binning and one-dimensional matched filter of the rotating line pair, compiled."""

from __future__ import annotations

import math

import numpy as np

from roadscope.core.jit import compiled

REACH = 4.0
"""Standard deviations after which the smoothed edge of a template is cut off."""


@compiled(borrowing=True)
def grid_half(reach: float, length: float, bin_m: float, sigma_m: float) -> int:
    """Bins to either side of the reference that hold every place the filter looks at.

    reach: greatest distance of a point from the reference, metres.
    """
    return math.ceil((reach + 0.5 * length + REACH * sigma_m) / bin_m) + 3


@compiled()
def gaussian_taps(sigma: float) -> np.ndarray:
    """Weights of a Gaussian for whole bins from its middle; sigma in bins."""
    half = math.ceil(REACH * sigma)
    taps = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    taps /= taps.sum()
    return taps


@compiled(borrowing=True)
def near_share(
    sight: np.ndarray, along: np.ndarray, extent: float, other: float, power: int
) -> float:
    """Share of the returns that lie on the face at the near end of an axis.

    Seen under the angle beta between the line of sight (2,) and the unit axis (2,), that face
    gives other * |cos beta|^power and the one along the axis extent * |sin beta|^power; power 0
    knows no near end.
    """
    if power == 0:
        return 0.0
    cos = abs(sight[0] * along[0] + sight[1] * along[1])
    sin = abs(sight[0] * along[1] - sight[1] * along[0])
    face, flank = other * cos**power, extent * sin**power
    return face / (face + flank) if face + flank > 0.0 else 0.0


@compiled(borrowing=True)
def respond(
    weighed: tuple[np.ndarray, np.ndarray],
    face: tuple[float, float, float],
    settings: tuple[float, float, float],
    taps: np.ndarray,
    work: np.ndarray,
) -> None:
    """Fill the filter's response for every place of the body's middle along one axis.

    weighed: (N,) places along the axis, metres from the reference, and (N,) returns that each one
    stands for. face: side, 1 where the sensor looks along the axis, -1 where against it; extent of
    the body along the axis, metres; share of the returns at the near end. settings: bin, sigma
    in metres and alpha. taps: of the Gaussian. work: (3, K), two rows of work space, then the
    response, entry i for the middle (i - K // 2) bins away.
    """
    side, extent, share = face
    bin_m, sigma_m, alpha = settings
    smooth, below, response = work
    low, high = _bin(weighed, side, extent / bin_m, bin_m, below)
    low, high = _smooth(below, low, high, taps, smooth)
    total = _accumulate(smooth, low, high, below)
    edge, plateau = template_weights(share, extent, bin_m, sigma_m)
    plateau += alpha
    size, far = len(response), extent / bin_m
    whole = math.floor(far)
    part = far - whole
    ends, last = high - whole - 1, min(size - 1, high)
    first = max(0, low - whole - 1)
    # Loops without a branch over views from zero: several bins at a time.
    response[:] = -alpha * total
    inside = response[first : last + 1]
    for i in range(len(inside)):
        inside[i] = (plateau - alpha) * total
    lower, upper = below[first + whole :], below[first + whole + 1 :]
    for i in range(min(ends, last) - first + 1):
        inside[i] -= plateau * (total - (1.0 - part) * lower[i] - part * upper[i])
    begun = response[low : last + 1]
    near, passed = smooth[low:], below[low:]
    for i in range(len(begun)):
        begun[i] += edge * near[i] - plateau * passed[i]
    if side < 0.0:
        for i in range(size // 2):
            response[i], response[size - 1 - i] = response[size - 1 - i], response[i]


@compiled(borrowing=True)
def _bin(
    weighed: tuple[np.ndarray, np.ndarray],
    side: float,
    extent: float,
    bin_m: float,
    counts: np.ndarray,
) -> tuple[int, int]:
    """Share every point between its two neighbouring bins; return the outer bins.

    Places are turned so that the near end comes first, and moved by half the extent (in bins):
    a near edge in a bin then means the middle of the body in it.
    """
    places, weights = weighed
    counts[:] = 0.0
    half = len(counts) // 2
    low, high = len(counts), 0
    scale, shift = side / bin_m, 0.5 * extent + half
    for k in range(len(places)):
        exact = scale * places[k] + shift
        i = math.floor(exact)
        upper = exact - i
        counts[i] += weights[k] * (1.0 - upper)
        counts[i + 1] += weights[k] * upper
        low, high = min(low, i), max(high, i + 1)
    return low, high


@compiled(borrowing=True)
def _smooth(
    counts: np.ndarray, low: int, high: int, taps: np.ndarray, smooth: np.ndarray
) -> tuple[int, int]:
    """Convolve the bins with the taps; return the outer bins reached, which the grid holds."""
    half = len(taps) // 2
    first, last = low - half, high + half
    smooth[first : last + 1] = 0.0
    for i in range(low, high + 1):
        count = counts[i]
        if count > 0.0:
            reached = smooth[i - half : i + half + 1]
            for k in range(len(taps)):
                reached[k] += count * taps[k]
    return first, last


@compiled(borrowing=True)
def _accumulate(smooth: np.ndarray, low: int, high: int, below: np.ndarray) -> float:
    """Fill how many points lie below each bin's middle, their edge being an erf; return all."""
    total = 0.0
    for i in range(low, high + 1):
        below[i] = total + 0.5 * smooth[i]
        total += smooth[i]
    return total


@compiled(borrowing=True)
def template_weights(
    share: float, extent: float, bin_m: float, sigma_m: float
) -> tuple[float, float]:
    """Return what one in the bin of the near edge and one on the plateau give, at unit energy."""
    energy = _energy(share, extent, sigma_m)
    return share / (bin_m * energy), (1.0 - share) / (extent * energy)


@compiled(borrowing=True)
def _energy(share: float, extent: float, sigma: float) -> float:
    """Norm of the template share * Gaussian + (1 - share) * plateau of the extent."""
    flat = 1.0 - share
    root = math.sqrt(math.pi)
    peak = share * share / (2.0 * root * sigma)
    both = share * flat / extent
    plateau = flat * flat / (extent * extent) * max(extent - 2.0 * sigma / root, 0.5 * extent)
    return math.sqrt(peak + both + plateau)


@compiled(borrowing=True, fastmath=True)
def greatest(values: np.ndarray) -> float:
    """Return the greatest of (N,) finite values, N at least 1, compared several at a time."""
    top: float = values[0]
    for i in range(len(values)):
        top = values[i] if values[i] > top else top
    return top


@compiled(borrowing=True)
def summit(response: np.ndarray, tie: float) -> tuple[float, float]:
    """Return the greatest response and its place in bins from the middle.

    Equal ones (within `tie`) are a plateau, whose middle counts; a single peak is placed by the
    parabola through its neighbours.
    """
    top, best = greatest(response), 0
    while response[best] < top:
        best += 1
    first = last = best
    while first > 0 and response[first - 1] >= top - tie:
        first -= 1
    while last + 1 < len(response) and response[last + 1] >= top - tie:
        last += 1
    place = 0.5 * (first + last)
    if last == first and 0 < best < len(response) - 1:
        before, after = response[best - 1], response[best + 1]
        bend = before - 2.0 * top + after
        if bend < 0.0:
            place += 0.5 * (before - after) / bend
    return top, place - len(response) // 2
