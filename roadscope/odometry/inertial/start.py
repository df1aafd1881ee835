"""The first scans, until they tell the speed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from roadscope.odometry.imu_buffer import ImuBuffer
from roadscope.odometry.inertial.filter import (
    GRAVITY_M_S2,
    InertialNoise,
    InertialState,
    started,
)
from roadscope.odometry.inertial.speed_search import CELL_M, Ends, Speed, speed_of
from roadscope.odometry.inertial.standstill import felt_still
from roadscope.odometry.inertial.track import InertialTrack, Stretch
from roadscope.odometry.rigid import exp_se3
from roadscope.odometry.voxels.sweep import Sweep

FEWEST, MOST = 4, 6
"""Two or three scans agree by chance; after the most the best speed is taken, clear or not."""
SPREAD_M_S = (0.5, 0.2, 0.1)
"""How far off a speed so found may be, ahead, to the side and up."""
HELD_M_S = (0.05, 0.05, 0.05)
"""The same of a sensor that is taken to stand."""
SLOW_M_S = 2 * SPREAD_M_S[0]
FELT_S = 0.1


class InertialStart:
    """Gathers scans and what was felt between them.

    anew: whether the sensor was followed before, and lost. One that was not and that feels nothing
    is taken to stand unless fixtures say that it moves.
    """

    def __init__(self, noise: InertialNoise, *, anew: bool = False) -> None:
        self.noise = noise
        self._taken: list[tuple[Sweep, Stretch, Ends]] = []
        self._rate, self._best = np.zeros(3), Speed(0.0, 0.0)
        self._anew, self._quiet = anew, False

    def __len__(self) -> int:
        return len(self._taken)

    def add(self, sweep: Sweep, stretch: Stretch, samples: ImuBuffer) -> None:
        """Take a further scan."""
        self._taken.append((sweep, stretch, Ends.of(sweep.scan)))
        first_s, last_s = self._taken[0][0].scan.stamp_s, sweep.scan.stamp_s
        rate = samples.mean_rate(first_s, last_s) if last_s > first_s else None
        self._rate = np.zeros(3) if rate is None else rate
        self._quiet = felt_still(samples, last_s, self.noise, last_s - first_s) is not None

    @property
    def held(self) -> bool:
        """Whether the sensor is taken to stand since the first scan."""
        return self._quiet and not self._anew and not self._best.by_fixtures

    def speed(self) -> Speed | None:
        """Return the speed ahead once it is clear, or enough scans were seen."""
        if len(self._taken) < 2:
            return None
        self._best = speed_of([ends for *_, ends in self._taken], float(self._rate[2]))
        if self._quiet and not self._anew:
            self._best = _held_still(self._best)
        if len(self._taken) < (FEWEST if self._best.clear else MOST):
            return None
        return self._best

    def guess(self) -> np.ndarray:
        """Return (4, 4) where the last scan was taken, as far as can be said, from the first."""
        if not self._taken:
            return np.eye(4)
        elapsed_s = self._taken[-1][0].scan.stamp_s - self._taken[0][0].scan.stamp_s
        # A way that is within a cell is none that was seen.
        ahead_m = self._best.ahead_m_s * elapsed_s
        ahead_m = ahead_m if abs(ahead_m) > CELL_M / 2 else 0.0
        return exp_se3(np.array([ahead_m, 0.0, 0.0, *(self._rate * elapsed_s)]))

    def track(
        self,
        speed: Speed,
        samples: ImuBuffer,
        lever: np.ndarray,
        made: Callable[[InertialState], InertialTrack],
    ) -> InertialTrack:
        """Begin at the first scan and follow the others."""
        stamp_s = self._taken[0][0].scan.stamp_s
        force = np.array([0.0, 0.0, GRAVITY_M_S2])
        if samples.covers(stamp_s, stamp_s + FELT_S):
            lengths, _, forces = samples.within(stamp_s, stamp_s + FELT_S)
            force = lengths @ forces / lengths.sum()
        ahead_m_s = max(SPREAD_M_S[0], speed.spread_m_s)
        held = self.held and not speed.ahead_m_s
        spread = HELD_M_S if held else (ahead_m_s, *SPREAD_M_S[1:])
        state = started(force, np.array([speed.ahead_m_s, 0.0, 0.0]), spread, self.noise)
        state.pose[:3, 3] = lever
        track = made(state)
        for i, (sweep, stretch, _) in enumerate(self._taken):
            track.predict(stretch, still=i == 0)
            points = track.seen(sweep)
            moving = track.moving(points, sweep.scan.stamp_s)
            if i:
                track.settle(track.matched(sweep, points, moving))
            track.remember(sweep, points, moving)
        return track


def _held_still(seen: Speed) -> Speed:
    """Return what was seen by a sensor that feels nothing: what is low may all be traffic."""
    if not seen.by_fixtures:
        return Speed(0.0, 0.0)
    return replace(seen, ahead_m_s=0.0) if abs(seen.ahead_m_s) < SLOW_M_S else seen
