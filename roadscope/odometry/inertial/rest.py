"""What was held while a sensor stood, to go back to once it has left."""

from __future__ import annotations

from collections import deque

import numpy as np

from roadscope.odometry.inertial.filter import InertialNoise, InertialState
from roadscope.odometry.inertial.track import InertialTrack, Stretch

DOUBTED_S = 1.5
"""Who pulls away does so from nothing: for a second or more it is not told from noise, and
meanwhile its acceleration passes for a bias."""
RECENT_S, COMPARED_S = 0.5, 2.5
"""How long is felt what is compared with what was felt before, and how long both together."""
UNLIKELY = 4.0
"""Standard deviations."""
NEAR_M, DOUBT_M = 3.0, 0.3
"""Traffic that stood as well cannot be told from the world before it is seen from places so far
apart; until then it may have moved along."""


class Rest:
    """Keeps states of the last seconds of a rest, each with the stretch that it ended."""

    def __init__(self, noise: InertialNoise) -> None:
        self.noise = noise
        self._kept: list[tuple[InertialState, Stretch]] = []
        self._felt: deque[tuple[float, np.ndarray]] = deque()
        self._left_s, self._place = -np.inf, np.full(3, np.inf)

    @property
    def begins(self) -> bool:
        """Whether the sensor is not held to stand yet."""
        return not self._kept

    def may_be(self, stretch: Stretch, now_s: float) -> bool:
        """Say whether a stretch until now may be one of rest: it is felt as those before were.

        Who has just left does not stand again at once.
        """
        if not len(stretch.lengths_s) or now_s < self._left_s + DOUBTED_S:
            return False
        self._felt.append((stretch.elapsed_s, stretch.lengths_s @ stretch.forces))
        while sum(length for length, _ in self._felt) > COMPARED_S:
            self._felt.popleft()
        lengths = np.array([length for length, _ in self._felt])
        gained = np.array([each for _, each in self._felt])
        late = np.cumsum(lengths[::-1])[::-1] <= RECENT_S + 1e-3
        late_s, early_s = float(lengths[late].sum()), float(lengths[~late].sum())
        if min(late_s, early_s) < RECENT_S / 2:
            return True
        off = gained[late].sum(axis=0) / late_s - gained[~late].sum(axis=0) / early_s
        noise, walk = self.noise.force**2, self.noise.force_walk**2
        variance = noise * (1 / late_s + 1 / early_s) + walk * (late_s + early_s) / 2
        return bool(np.abs(off).max() < UNLIKELY * np.sqrt(variance))

    def doubt_m(self, track: InertialTrack) -> float:
        """Return how far what was seen in the rest may have moved together since it ended."""
        way_m = float(np.linalg.norm(track.state.pose[:3, 3] - self._place))
        return DOUBT_M if way_m < NEAR_M and not self._kept else 0.0

    def held(self, track: InertialTrack, stretch: Stretch) -> None:
        """Take it that the sensor stands at the end of a stretch."""
        self._kept.append((track.state.copied(), stretch))
        self._place = track.state.pose[:3, 3].copy()
        while sum(each.elapsed_s for _, each in self._kept[1:]) > DOUBTED_S:
            del self._kept[0]

    def left(self, track: InertialTrack, stretch: Stretch, now_s: float) -> bool:
        """Take it that the sensor stands no longer, and that since when is not known.

        Say whether it stood until now.
        """
        self._felt.clear()
        if not self._kept:
            return False
        track.state = self._kept[0][0]
        for _, each in self._kept[1:]:
            track.predict(each)
        track.predict(stretch)
        self._kept, self._left_s = [], now_s
        return True
