"""Whose traits are those of the detector at hand, told by the scores met so far."""

from __future__ import annotations

import numpy as np

from roadscope.core import Category
from roadscope.trackers.learned import COUNT, SECTION_OF, Learned, names, read

AUTO = "auto"
UNKNOWN = "unknown"
EDGES = np.concatenate([[-9.22], np.linspace(-9.16, 9.16, 25), [9.22]])
"""Of log odds; scores of 0 and of 1 have an interval each."""
ROUNDING = 0.005
"""By how much the least and the greatest score learned of a detector may be off in its file."""
STRAYS = 0.05
"""Share of log odds that lie anywhere, between the least and the greatest ever learned."""
BEYOND = 0.02
"""By which that is less beyond these two. Detectors cut their scores off, so a few that lie below
are strong evidence: with 1 a fifth of the frames of a fusion by evidence, 7 to 24 in 100 of whose
scores lie below all of KITTI's detector, passed for those of that detector on validation seeds;
with this none."""
CONCENTRATION = 30.0
"""Cases that a detector's shares count for: scenes differ, and each has shares of its own."""
FOREIGN = 1.0
"""Log odds that a detector is none of those learned, before any score. With 3 it took KITTI's few
cyclists up to 27 frames to show whose they are, which took 0.01 of their HOTA."""
SETTLED = 20.0
"""Lead in log likelihood from which on nothing is weighed any more."""
SECTIONS = tuple(dict.fromkeys(SECTION_OF.values()))
SECTION = np.array([SECTIONS.index(SECTION_OF[category]) for category in Category])
"""For each value of `Category` the number of its section."""


class Choice:
    """What is learned of the detector at hand; `auto`: of the shipped one whose scores are likest.

    Scores of each scene are taken to have shares of their own, drawn around those of the detector
    (Dirichlet), so a score that comes again and again tells less and less. Scores like no trained
    detector's are likest to those of `unknown`, which are all over the place, and it is unknown
    that a detector is taken to be until scores tell otherwise. The choice is made online.
    """

    def __init__(self, name: str) -> None:
        chosen = names() if name == AUTO else [name]
        told = [read(one) for one in chosen]
        self._traits = [traits for traits, _ in told]
        self._deciles = [deciles for _, deciles in told]
        self._edges = _edges(self._deciles)
        shares = [_shares(deciles, self._edges).ravel() for deciles in self._deciles]
        self._shares = np.array(shares)
        self._prior = np.array([FOREIGN if one == UNKNOWN else 0.0 for one in chosen])
        self.reset()

    def reset(self) -> None:
        """Forget all scores."""
        self._told = self._prior.copy()
        self._counts = np.zeros(self._shares.shape[1])

    def after(self, log_odds: np.ndarray, categories: np.ndarray) -> Learned:
        """Take the scores of a tick, (N,) log odds, and return what they fit best."""
        if len(self._traits) > 1 and len(log_odds) and self._lead() < SETTLED:
            # The outermost intervals have no end.
            here = np.searchsorted(self._edges[1:-1], log_odds, "right")
            self._weigh(SECTION[categories] * (len(self._edges) - 1) + here)
        return self._traits[self._best]

    def base_odds(self, range_m: float) -> np.ndarray:
        """Return (7,) log odds that any detection of a category was right where it was learned."""
        edges, traits = self._deciles[self._best], self._traits[self._best]
        middles = (edges[:, 1:] + edges[:, :-1]) / 2
        kinds = np.repeat(np.arange(COUNT), middles.shape[1])
        told = traits.right(middles.ravel(), kinds, np.full(middles.size, range_m))
        shares = (1 / (1 + np.exp(-told))).reshape(middles.shape).mean(axis=1)
        found: np.ndarray = np.log(shares / (1 - shares))
        return found

    @property
    def _best(self) -> int:
        return int(self._told.argmax())

    def _lead(self) -> float:
        second, first = sorted(self._told.tolist())[-2:]
        return float(first - second)

    def _weigh(self, intervals: np.ndarray) -> None:
        """Take (N,) numbers of intervals in, whatever their order (Dirichlet and multinomial)."""
        from scipy.special import gammaln

        new = np.bincount(intervals, minlength=len(self._counts)).astype(float)
        met = np.flatnonzero(new)
        foretold = CONCENTRATION * self._shares[:, met] + self._counts[met]
        # What all have in common, widths and how many there were, is left out.
        self._told += (gammaln(foretold + new[met]) - gammaln(foretold)).sum(axis=1)
        self._counts += new


def _edges(detectors: list[np.ndarray]) -> np.ndarray:
    """Return (E,) `EDGES` and where what was learned of (7, 11) deciles each begins and ends."""
    least = [deciles[:, 0] - ROUNDING for deciles in detectors]
    most = [deciles[:, -1] + ROUNDING for deciles in detectors]
    ends = np.concatenate(least + most)
    found: np.ndarray = np.union1d(EDGES, ends[np.abs(ends) < EDGES[-1]])
    return found


def _shares(deciles: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return (3, E - 1) shares of log odds between edges, of (7, 11) deciles, for each section.

    Deciles beyond the edges leave less than all: they make no score likely.
    """
    first = [int(np.flatnonzero(number == SECTION)[0]) for number in range(len(SECTIONS))]
    below = np.array([
        np.interp(edges, deciles[k], np.linspace(0, 1, deciles.shape[1])) for k in first
    ])  # fmt: skip
    within = np.diff(below)
    anywhere = np.diff(edges) / (edges[-1] - edges[0])
    strays = STRAYS * np.where(within > 0, anywhere, BEYOND * anywhere)
    found: np.ndarray = (1 - STRAYS) * within + strays
    return found
