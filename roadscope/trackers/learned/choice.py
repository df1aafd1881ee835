"""Whose traits are those of the detector at hand, told by the scores met so far."""

from __future__ import annotations

import numpy as np

from roadscope.core import Category
from roadscope.trackers.learned import COUNT, SECTION_OF, Learned, Scores, names, read

AUTO = "auto"
UNKNOWN = "unknown"
EDGES = np.concatenate([[-9.22], np.linspace(-9.16, 9.16, 25), [9.22]])
"""Of log odds; scores of 0 and of 1 have an interval each."""
ROUNDING = 0.005
"""By how much the least and the greatest score learned of a detector may be off in its file."""
STRAYS = 0.05
"""Share of log odds that lie anywhere between the least and the greatest ever learned."""
CONCENTRATION = 30.0
"""Cases that a detector's shares count for: scenes differ, and each has shares of its own."""
SETTLED = 20.0
"""Lead in log likelihood from which on nothing is weighed any more."""
SECTIONS = tuple(dict.fromkeys(SECTION_OF.values()))
SECTION = np.array([SECTIONS.index(SECTION_OF[category]) for category in Category])
"""For each value of `Category` the number of its section."""


class Choice:
    """What is learned of the detector at hand; `auto`: of the shipped one whose scores are likest.

    Scores of each scene are taken to have shares of their own, drawn around those of the detector
    (Dirichlet), so a score that comes again and again tells less and less. Scores like no trained
    detector's are likest to those of `unknown`, which are all over the place; before any score it
    is as likely `unknown` as not, and so it is taken to be until another is likelier than all the
    rest together. The choice is made online.
    """

    def __init__(self, name: str) -> None:
        chosen = names() if name == AUTO else [name]
        told = [read(one) for one in chosen]
        self._traits = [traits for traits, _ in told]
        self._scores = [scores for _, scores in told]
        self._edges = _edges([scores.deciles for scores in self._scores])
        shares = [_shares(scores, self._edges).ravel() for scores in self._scores]
        self._shares = np.array(shares)
        self._unknown = chosen.index(UNKNOWN) if UNKNOWN in chosen else 0
        self._prior = np.zeros(len(chosen))
        self._prior[self._unknown] = np.log(max(len(chosen) - 1, 1))
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
        edges, traits = self._scores[self._best].deciles, self._traits[self._best]
        middles = (edges[:, 1:] + edges[:, :-1]) / 2
        kinds = np.repeat(np.arange(COUNT), middles.shape[1])
        told = traits.right(middles.ravel(), kinds, np.full(middles.size, range_m))
        shares = (1 / (1 + np.exp(-told))).reshape(middles.shape).mean(axis=1)
        found: np.ndarray = np.log(shares / (1 - shares))
        return found

    @property
    def _best(self) -> int:
        first = int(self._told.argmax())
        rest = np.delete(self._told, first)
        surely = self._told[first] > np.logaddexp.reduce(rest, initial=-np.inf)
        return first if surely else self._unknown

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
    found: np.ndarray = np.union1d(EDGES, ends[np.abs(ends) < EDGES[-2]])
    return found


def _shares(scores: Scores, edges: np.ndarray) -> np.ndarray:
    """Return (3, E - 1) shares of log odds between edges, for each section.

    Beyond the least and the greatest of n scores the next lies with a chance of 1 / (n + 2), the
    rule of succession. Deciles beyond the edges leave less than all: they make no score likely.
    """
    first = [int(np.flatnonzero(number == SECTION)[0]) for number in range(len(SECTIONS))]
    deciles, counts = scores.deciles[first], scores.counts[first, None]
    below = np.array([np.interp(edges, row, np.linspace(0, 1, len(row))) for row in deciles])
    within = np.diff(below)
    inside = within > 0
    beyond = np.where(inside.all(axis=1, keepdims=True), 0.0, 1 / (counts + 2))
    anywhere = (1 - STRAYS) * within + STRAYS * _evenly(edges, inside)
    found: np.ndarray = (1 - beyond) * anywhere + beyond * _evenly(edges, ~inside)
    return found


def _evenly(edges: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Spread 1 over the intervals of each of (3, E - 1) bool rows, by their widths."""
    widths = np.where(where, np.diff(edges), 0.0)
    shares: np.ndarray = widths / np.maximum(
        widths.sum(axis=1, keepdims=True), np.finfo(float).tiny
    )
    return shares
