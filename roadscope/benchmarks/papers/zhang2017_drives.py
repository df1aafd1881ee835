"""The ways of the car and of the sensor in Zhang 2017's experiments, in closed form.

Both are seen in a fixed world frame whose origin is where the sensor stands, or starts. Stamps
are in seconds, poses (T, 3) x, y (metres) and yaw (radians) of the car's box centre and of the
sensor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np

FRAME_S = 0.1
STEP_M = 2.0
TURN = -np.pi / 36
"""Way and turn of the car from frame to frame in the simulated drives."""
ROBOT_M_S = 3.0
DEVIATION_M = 3.0
"""Most by which the car's distance from the robot departs from the one that is to be held."""
FOLLOWED_M = (10, 20, 30, 40, 50)
FOLLOWING_FRAMES = 500

Path = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, slots=True)
class Drive:
    """Where car and sensor are at any time, and how many frames are taken.

    rolling: whether both move on while a sweep goes round; otherwise each sweep is a snapshot.
    """

    name: str
    car: Path
    sensor: Path
    frames: int
    rolling: bool = False


def drive_of(name: str, seed: int) -> Drive:
    """Return a drive; the seed matters to `following` alone."""
    if name not in DRIVES:
        raise ValueError(f"no drive '{name}'; known: {', '.join(DRIVES)}")
    return DRIVES[name](name, seed)


def _straight(name: str, _: int) -> Drive:
    """Straight away from the sensor: 40 to 112 m.

    The paper starts at (40, 3.75, -pi) and speaks of a far vehicle; going ahead, a car with that
    heading would meet the sensor. Here it is read as a heading known up to half a turn, with the
    tail in sight; the other reading is `straight-past`.
    """
    return Drive(name, partial(_turning, (40.0, 3.75, 0.0), 0.0), _standing, 37)


def _straight_past(name: str, _: int) -> Drive:
    """Towards the sensor and past it: 40 to -32 m, the paper's (40, 3.75, -pi) as it stands."""
    return Drive(name, partial(_turning, (40.0, 3.75, -np.pi), 0.0), _standing, 37)


def _curve(name: str, _: int) -> Drive:
    """Along a circle of 23 m radius to the right, 34 to 74 m; 2 m a frame are taken as its arc."""
    return Drive(name, partial(_turning, (34.0, 0.0, np.pi / 2), TURN), _standing, 27)


def _following(distance_m: int, name: str, seed: int) -> Drive:
    """Robot and car on the same winding road, the distance held within 3 m.

    The paper gives neither road nor deviations: here the road is a sine of 60 to 120 m with
    slopes up to 0.1, and the deviation is two slow swings of 15 to 50 s, all drawn by the seed.
    """
    rng = np.random.default_rng([seed, distance_m])
    wave, phase = 2 * np.pi / rng.uniform(60.0, 120.0), rng.uniform(0.0, 2 * np.pi)
    road = _Road(rng.uniform(0.02, 0.1) / wave, wave, phase)
    share = rng.uniform(0.3, 0.7)
    swings = _Swings(
        DEVIATION_M * np.array([share, 1.0 - share]),
        2 * np.pi / rng.uniform(15.0, 50.0, 2),
        rng.uniform(0.0, 2 * np.pi, 2),
    )
    ahead = partial(_ahead, road, float(distance_m), swings)
    return Drive(name, ahead, partial(_along, road), FOLLOWING_FRAMES, rolling=True)


@dataclass(frozen=True, slots=True)
class _Road:
    """A road y = height * (sin(wave x + phase) - sin(phase)), metres."""

    height: float
    wave: float
    phase: float

    def at(self, x: np.ndarray) -> np.ndarray:
        """Return (T, 3) poses along the road."""
        y = self.height * (np.sin(self.wave * x + self.phase) - np.sin(self.phase))
        slope = self.height * self.wave * np.cos(self.wave * x + self.phase)
        return np.column_stack([x, y, np.arctan(slope)])


@dataclass(frozen=True, slots=True)
class _Swings:
    """Sines that add up to a deviation, metres."""

    heights: np.ndarray
    rates: np.ndarray
    phases: np.ndarray

    def at(self, stamps_s: np.ndarray) -> np.ndarray:
        """Return (T,) deviations."""
        turned = np.sin(np.multiply.outer(stamps_s, self.rates) + self.phases)
        deviations: np.ndarray = turned @ self.heights
        return deviations


def _along(road: _Road, stamps_s: np.ndarray) -> np.ndarray:
    return road.at(ROBOT_M_S * stamps_s)


def _ahead(road: _Road, distance_m: float, swings: _Swings, stamps_s: np.ndarray) -> np.ndarray:
    return road.at(ROBOT_M_S * stamps_s + distance_m + swings.at(stamps_s))


def _standing(stamps_s: np.ndarray) -> np.ndarray:
    return np.zeros((len(stamps_s), 3))


def _turning(start: tuple[float, float, float], turn: float, stamps_s: np.ndarray) -> np.ndarray:
    """Constant speed along the heading and constant turn rate."""
    k = stamps_s / FRAME_S
    yaw = start[2] + turn * k
    # sin(u) / u at half the turn: the chord of an arc.
    chord = STEP_M * k * np.sinc(turn * k / 2 / np.pi)
    middle = start[2] + turn * k / 2
    x, y = start[0] + chord * np.cos(middle), start[1] + chord * np.sin(middle)
    return np.column_stack([x, y, yaw])


DRIVES: Mapping[str, Callable[[str, int], Drive]] = MappingProxyType(
    {
        "straight": _straight,
        "straight-past": _straight_past,
        "curve": _curve,
        **{f"following-{metres}": partial(_following, metres) for metres in FOLLOWED_M},
    }
)
