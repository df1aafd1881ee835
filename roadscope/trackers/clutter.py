"""How dense false detections are, and what scores say of them, counted while tracking."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from roadscope.core import Category
from roadscope.trackers.existence_targets import log_odds
from roadscope.trackers.learned import Learned
from roadscope.trackers.learned.choice import Choice
from roadscope.trackers.ticks import Tick

CELL_M = 10.0
"""Of the grid, around the ego, that tells where there are detections at all."""
FIRST_M2 = 1e-4
"""Density before anything was seen, false detections per square metre and tick."""
WEIGHT_M2 = 2e4
"""Area times ticks that this counts for: two false detections."""
DEEP_M = 25.0
"""Range at which scores are taken to be met where base rates are worked out."""


@dataclass(slots=True)
class Clutter:
    """Detections that no track was confirmed of, over the area in which anything is detected.

    The area is that of all cells in which there was a detection so far: sensors look into a part
    of their surroundings only.
    """

    count: float = 0.0
    area_m2: float = 0.0
    cells: set[tuple[int, int]] = field(default_factory=set)

    @property
    def density_m2(self) -> float:
        """False detections per square metre and tick."""
        return (self.count + FIRST_M2 * WEIGHT_M2) / (self.area_m2 + WEIGHT_M2)

    def seen(self, tick: Tick) -> None:
        """Take the places of a tick's detections."""
        found = tick.targets.centres
        if tick.world_from_ego is not None:
            found = tick.world_from_ego.inverse().apply(found)
        self.cells.update(map(tuple, np.floor(found[:, :2] / CELL_M).astype(np.int64).tolist()))
        self.area_m2 += len(self.cells) * CELL_M**2

    def lost(self, detections: int) -> None:
        """Take how many detections, of this tick or earlier, have come to nothing."""
        self.count += detections


class Scores:
    """What scores say by themselves, after `roadscope.trackers.learned`.

    Learned are log odds that a detection is right, at the base rate of the training data. How much
    likelier a score is of a target than of clutter is the same without the base rate.
    """

    def __init__(self, traits: str) -> None:
        """Take a name, a file or `auto`, as `ExistenceTracker` does."""
        self._choice = Choice(traits)
        self._known: Learned | None = None
        self._base = np.zeros(len(Category))

    def reset(self) -> None:
        """Forget all scores."""
        self._choice.reset()
        self._known = None

    def shares(self, tick: Tick) -> np.ndarray:
        """Return (M,) probabilities of being right, were targets as many as clutter."""
        targets = tick.targets
        odds, kinds = log_odds(targets.scores), targets.categories
        traits = self._choice.after(odds, kinds)
        if traits is not self._known:
            self._known, self._base = traits, self._choice.base_odds(DEEP_M)
        eye = np.zeros(2) if tick.world_from_ego is None else tick.world_from_ego.translation[:2]
        ranges = np.hypot(*(targets.centres[:, :2] - eye).T)
        told = traits.right(odds, kinds, ranges) - self._base[kinds]
        found: np.ndarray = 1 / (1 + np.exp(-told))
        return found
