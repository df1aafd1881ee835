"""Whether a target exists, and whether it can be seen: integrated tracking's Markov chain two.

A target is there and visible, there but hidden, or not there (Musicki and Evans 2004).
A hidden target is no missed detection: it is neither confirmed nor given up by not being seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.trackers.rows import Rows
from roadscope.trackers.settings import check_not_negative, check_positive, check_shares

SUREST_SCORE = 0.98
"""No score says more than this, nor less than one minus this."""


@dataclass(frozen=True, slots=True, eq=False)
class Existence(Rows):
    """Of N targets.

    visible, hidden: (N,) probabilities that they are there and can be seen, or cannot.
    """

    visible: np.ndarray
    hidden: np.ndarray

    def __len__(self) -> int:
        return len(self.visible)

    @staticmethod
    def first(there: np.ndarray) -> Existence:
        """Begin to believe in (N,) targets that were just seen, if they are there."""
        return Existence(there, np.zeros_like(there))

    @property
    def there(self) -> np.ndarray:
        """(N,) probabilities of existence."""
        there: np.ndarray = self.visible + self.hidden
        return there

    def missed(self, detection: float) -> Existence:
        """Take in that no detection came; detection: its probability for a visible target."""
        unseen = self.visible * (1 - detection)
        total = 1 - self.visible * detection
        return Existence(unseen / total, self.hidden / total)


@dataclass(frozen=True, slots=True)
class Sighting:
    """How targets come, hide and go, and how often detectors err.

    detection: probability that a visible target is detected.
    clutter_m2: false detections per square metre and tick.
    birth_m2: targets that show up, per square metre and tick.
    lifetime_s: mean time that a target stays in reach.
    visible_s, hidden_s: mean times for which it can be seen, and for which it cannot.
    score_weight: how much to believe scores; 1 takes them as probabilities that a detection is
        of a target, 0 not at all.
    """

    detection: float = 0.9
    clutter_m2: float = 1e-4
    birth_m2: float = 1e-5
    lifetime_s: float = 30.0
    visible_s: float = 10.0
    hidden_s: float = 1.0
    score_weight: float = 1.0

    def __post_init__(self) -> None:
        check_shares(detection=self.detection)
        if self.detection in (0, 1):
            raise ValueError(f"detection must lie between 0 and 1, got {self.detection!r}")
        check_positive(
            clutter_m2=self.clutter_m2, birth_m2=self.birth_m2, lifetime_s=self.lifetime_s,
            visible_s=self.visible_s, hidden_s=self.hidden_s,
        )  # fmt: skip
        check_not_negative(score_weight=self.score_weight)

    def moved_on(self, before: Existence, dt: float) -> Existence:
        """Let dt seconds pass: a chain in continuous time, so two short steps equal a long one."""
        hide, show = 1 / self.visible_s, 1 / self.hidden_s
        alive = np.exp(-dt / self.lifetime_s)
        settled = np.exp(-(hide + show) * dt)
        visible = before.there * show / (hide + show)
        visible = visible + (before.visible - visible) * settled
        return Existence(alive * visible, alive * (before.there - visible))

    def score_ratios(self, scores: np.ndarray) -> np.ndarray:
        """Return (M,) how much likelier each score is of a target than of clutter.

        Amplitude information (Lerro and Bar-Shalom 1993). Of scores that are probabilities where
        targets and clutter are equally frequent this ratio is s / (1 - s).
        """
        s = np.clip(scores, 1 - SUREST_SCORE, SUREST_SCORE)
        ratios: np.ndarray = (s / (1 - s)) ** self.score_weight
        return ratios

    def gains(self, scores: np.ndarray) -> np.ndarray:
        """Return (M,) how much more each detection counts as a known target's than as no one's.

        Per unit of its density, in square metres.
        """
        ratios = self.score_ratios(scores)
        gains: np.ndarray = ratios / (self.clutter_m2 + self.birth_m2 * self.detection * ratios)
        return gains

    def new_shares(self, scores: np.ndarray) -> np.ndarray:
        """Return (M,) probabilities that detections of no known target are of a new one."""
        births = self.birth_m2 * self.detection * self.score_ratios(scores)
        shares: np.ndarray = births / (births + self.clutter_m2)
        return shares
