"""Cars and ways drawn from what our pose fit takes for possible, seen by Zhang 2017's LiDAR.

Body, pose and motion have the fit's own priors, so that its posterior can be held to what came
out: over such a population, and over no single car, squared errors in units of the covariance of
a right posterior have the mean 3 (Talts 2018, simulation-based calibration).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType

import numpy as np

from roadscope.benchmarks.papers.zhang2017_drives import FRAME_S, Drive
from roadscope.benchmarks.papers.zhang2017_floor import FEWEST
from roadscope.benchmarks.papers.zhang2017_scene import SENSOR_HEIGHT_M, Shot, hdl32e, shots_of
from roadscope.detectors.pose.body_fit import TURN_SD, VELOCITY_SD
from roadscope.detectors.pose.body_likelihood import pose_after
from roadscope.detectors.pose.body_model import MOTION, VALUES, BodyModel, BodyPart
from roadscope.detectors.pose.smoother import ACCELERATION_SD, SPEED_SD
from roadscope.envs.sensors.lidar_spec import LidarSpec
from roadscope.envs.world.ford_saloon import GLASS, SILVER, half_outline
from roadscope.envs.world.prisms import Prisms

FRAMES = 7
MIDDLE = FRAMES // 2
BANDS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"10-20 m": (10.0, 20.0), "20-30 m": (20.0, 30.0), "30-50 m": (30.0, 50.0),
     "50-80 m": (50.0, 80.0)}
)  # fmt: skip
"""Distances of the middle frame's car."""
CLEAR_M = 5.0
"""A car's centre comes no nearer to the sensor."""
UNTURNED = np.zeros(FRAMES)
"""Phases of the sweeps: cars stand all around, so they need none of their own."""
SLOWEST_M_S = 0.1
"""A tracker tells no less, or nothing were told of the heading."""
TRIES = 1000


@dataclass(frozen=True, slots=True)
class Passing:
    """Seven frames of one car.

    truth: (3,) x, y (metres) and yaw (radians) of the car in the middle frame, world frame.
    told: (2,) its velocity there as a tracker would have it, m/s.
    """

    shots: tuple[Shot, ...]
    truth: np.ndarray
    told: np.ndarray


@cache
def lidar() -> LidarSpec:
    """Return the paper's LiDAR, the beams of a column firing at once, as the ray caster has them.

    A fit that is told of their turns would look for a car at 60 m/s a millimetre from where it was
    cast, and some of the population are as fast.
    """
    spec = hdl32e()
    return replace(spec, firing_offsets_s=np.zeros(spec.beams))


def passing(model: BodyModel, band: str, seed: int | Sequence[int]) -> Passing:
    """Draw a car and its way until it returns at least three rays in the middle frame.

    model: of the fit, from whose spread the body is drawn. band: of `BANDS`. To leave out ways
    that what is seen excludes leaves the rest as a right posterior has them.
    """
    rng = np.random.default_rng(seed)
    for _ in range(TRIES):
        state = _state(BANDS[band], rng)
        body = body_of(model, rng.standard_normal(VALUES - MOTION))
        # Where on the body lies what is seen of it.
        drawn = state + np.concatenate(
            [model.drawn_m * rng.standard_normal(2), np.zeros(MOTION - 2)]
        )
        speed = max(state[3] + VELOCITY_SD * rng.standard_normal(), SLOWEST_M_S)
        drive = way_of(drawn)
        if np.hypot(*drive.car(FRAME_S * np.arange(FRAMES))[:, :2].T).min() < CLEAR_M:
            continue
        shots = shots_of(drive, lidar(), body, (SENSOR_HEIGHT_M, UNTURNED), rng)
        if shots[MIDDLE].target.sum() >= FEWEST:
            return Passing(shots, state[:3], speed * np.array([np.cos(state[2]), np.sin(state[2])]))
    raise ValueError(f"no car returned {FEWEST} rays in {TRIES} tries at {band}")


def way_of(state: np.ndarray) -> Drive:
    """Return the drive past a standing sensor whose middle frame has a state, x to acceleration."""
    return Drive("passing", _Way(state), _standing, FRAMES, rolling=True)


def _state(band: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """Draw x, y, yaw, speed, turn rate and acceleration (6,), everywhere as likely."""
    nearest, farthest = band
    distance = np.sqrt(rng.uniform(nearest**2, farthest**2))
    bearing, yaw = rng.uniform(-np.pi, np.pi, 2)
    speed, turn, gained = np.array([SPEED_SD, TURN_SD, ACCELERATION_SD]) * rng.standard_normal(3)
    # What goes backwards is taken to be turned round.
    place = distance * np.cos(bearing), distance * np.sin(bearing)
    return np.array([*place, yaw, abs(speed), turn, gained])


@dataclass(frozen=True, slots=True)
class _Way:
    """Where a state in the middle frame leads."""

    state: np.ndarray

    def __call__(self, stamps_s: np.ndarray) -> np.ndarray:
        """Return (T, 3) x, y and yaw."""
        return np.array([pose_after(self.state, t) for t in stamps_s - FRAME_S * MIDDLE])


def _standing(stamps_s: np.ndarray) -> np.ndarray:
    return np.zeros((len(stamps_s), 3))


def body_of(model: BodyModel, unknowns: np.ndarray) -> Prisms:
    """Return the body that (5,) standard normal unknowns mean, its windows of glass."""
    low, high = model.glass_m or (np.inf, np.inf)
    return Prisms.join(
        [
            Prisms.of(
                outline, part.bottom, part.top,
                reflectivity=GLASS if low <= part.bottom < high else SILVER,
            )
            for part in model.parts(np.append(np.zeros(MOTION), unknowns))
            for outline in _halves(part)
        ]
    )  # fmt: skip


def _halves(part: BodyPart) -> tuple[np.ndarray, np.ndarray]:
    """Return the outlines behind and ahead of a part's middle: one alone has too many corners."""
    middle = (part.rear + part.front) / 2
    # A flank that narrows from the middle on has no point of its own there.
    aft = -part.aft if part.aft < middle else np.inf
    fore = part.fore if part.fore > middle else np.inf
    behind = half_outline(-part.rear, aft, part.half, part.tail_half, part.radius)
    ahead = half_outline(part.front, fore, part.half, part.nose_half, part.radius)
    ahead[[0, -1], 0], behind[[0, -1], 0] = middle, -middle
    return -behind, ahead
