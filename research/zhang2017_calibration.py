"""Whether the covariance of our pose fit is right over all cars and motions that it holds possible.

No fit that does not know a car's corners can have a consistent covariance for a car with sharp
corners and for one with round corners alike. Over the population that its priors describe, a right
covariance is consistent: at every distance and with any number of frames, the squared errors in
units of the covariance (NEES) have the mean 3 (Talts 2018, simulation-based calibration). Body,
pose and motion of the cars are drawn from the priors of the fit. Zhang 2017's LiDAR senses them.

One seed takes some five seconds on one core, and compiling a minute or two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from research.studies import measured_over_seeds, show, study_parser
from roadscope.benchmarks.papers.reproduction import (
    FIRST_SEED,
    YES_OR_NO,
    FigureKey,
    ReproductionRow,
    summarise,
)
from roadscope.benchmarks.papers.zhang2017_claims import POSE_UNKNOWNS, consistent
from roadscope.benchmarks.papers.zhang2017_methods import (
    FEWEST_RETURNS,
    OURS,
    any_corners,
    known_radius,
    sized_saloon,
)
from roadscope.benchmarks.papers.zhang2017_scene import (
    FRAME_S,
    Drive,
    DriveSweep,
    RobotLidar,
    hdl32e,
    sense_sweeps,
)
from roadscope.benchmarks.papers.zhang2017_tables import frames_name
from roadscope.detectors.pose.body_fit import TURN_SD, VELOCITY_SD, BodyFit
from roadscope.detectors.pose.body_likelihood import EXACTLY_DRAWN, pose_after
from roadscope.detectors.pose.body_model import MOTION, VALUES, BodyModel, BodyPart
from roadscope.detectors.pose.estimate import VehiclePose, axis_difference
from roadscope.detectors.pose.smoother import ACCELERATION_SD, SPEED_SD, Smoother
from roadscope.envs.sensors.lidar_spec import LidarSpec
from roadscope.envs.world.prisms import Prisms
from roadscope.envs.world.saloon_body import GLASS, SILVER, half_outline

MODELS: Mapping[str, BodyModel] = MappingProxyType(
    {
        "any corners": any_corners(""),
        "sharp, known": known_radius("sharp"),
        "rounded, known": known_radius("rounded"),
        "sized saloon": sized_saloon(""),
    }
)
"""What the fit knows of the body; the cars are drawn accordingly. Ours knows the first."""
CARS = 4
"""Of each seed, model and band."""
FRAMES = 7
MIDDLE = FRAMES // 2
"""The frame whose pose is estimated."""


class Band(NamedTuple):
    """Nearest and farthest distance of the car in the middle frame, metres."""

    nearest_m: float
    farthest_m: float


BANDS: Mapping[str, Band] = MappingProxyType(
    {
        "10-20 m": Band(10.0, 20.0),
        "20-30 m": Band(20.0, 30.0),
        "30-50 m": Band(30.0, 50.0),
        "50-80 m": Band(50.0, 80.0),
    }
)
EVERY_BAND = "all distances"
CLEARANCE_M = 5.0
"""A car's centre comes no nearer to the sensor."""
NO_PHASES = np.zeros(FRAMES)
"""By how much the azimuths of each sweep are turned: cars stand all around, so they need not be."""
SLOWEST_M_S = 0.1
"""Least speed that the fit is given: a velocity of 0 has no direction."""
TRIES = 1000
LEVELS = (0.5, 0.9, 0.95)
CALIBRATED_NEES = "NEES over all possible cars, {}"
CALIBRATED_INSIDE = "3 within that over all possible cars, {}"
COVERED = "percent of all possible cars within the covariance's ellipsoid"
NOTES = {
    "NEES over all possible cars, any": "Bodies, poses and motions drawn from the fit's own "
    "priors: the corners' radius ('any corners'), the whole body ('sized saloon') or neither. 3 is "
    "expected. Squared error in units of the covariance of x, y and yaw.",
    "percent of all": "A normal posterior covers as many as the column says; one with edges is not "
    "normal, though its NEES is 3.",
}


# The population


@dataclass(frozen=True, slots=True)
class PassingCar:
    """Seven frames of one car.

    truth: (3,) x, y (metres) and yaw (radians) of the car in the middle frame, world frame.
    rough_velocity: (2,) m/s, its velocity in the middle frame as a tracker would know it.
    """

    sweeps: tuple[DriveSweep, ...]
    truth: np.ndarray
    rough_velocity: np.ndarray


@cache
def lidar() -> LidarSpec:
    """Return the paper's LiDAR with all beams of a column firing at once, as the ray caster has it.

    A fit that knows their firing times would look for a car at 60 m/s a millimetre from where it
    was cast, and some cars of the population are as fast.
    """
    spec = hdl32e()
    return replace(spec, firing_offsets_s=np.zeros(spec.beams))


def passing_car(model: BodyModel, band: str, seed: int | Sequence[int]) -> PassingCar:
    """Draw a car and its motion until it returns at least three rays in the middle frame.

    model: the fit's, from which the body is drawn. band: name of one of `BANDS`. Leaving out
    motions that the returns exclude leaves the others as a right posterior has them.
    """
    rng = np.random.default_rng(seed)
    for _ in range(TRIES):
        state = _drawn_state(BANDS[band], rng)
        body = body_of(model, rng.standard_normal(VALUES - MOTION))
        # What is visible lies a little off its place on the body.
        shift = np.concatenate([model.drawn_m * rng.standard_normal(2), np.zeros(MOTION - 2)])
        shown = state + shift
        speed = max(state[3] + VELOCITY_SD * rng.standard_normal(), SLOWEST_M_S)
        drive = drive_through(shown)
        if np.hypot(*drive.car(FRAME_S * np.arange(FRAMES))[:, :2].T).min() < CLEARANCE_M:
            continue
        shots = sense_sweeps(drive, RobotLidar(lidar()), body, NO_PHASES, rng)
        if shots[MIDDLE].target.sum() >= FEWEST_RETURNS:
            direction = np.array([np.cos(state[2]), np.sin(state[2])])
            return PassingCar(shots, state[:3], speed * direction)
    raise ValueError(f"no car returned {FEWEST_RETURNS} rays in {TRIES} tries at {band}")


def drive_through(state: np.ndarray) -> Drive:
    """Return the drive past a standing sensor with a state in the middle frame.

    state: (6,) x, y, yaw, speed, turn rate and acceleration.
    """
    return Drive("passing", _Motion(state), _standing, FRAMES, rolling=True)


def _drawn_state(band: Band, rng: np.random.Generator) -> np.ndarray:
    """Draw x, y, yaw, speed, turn rate and acceleration (6,); every place is as likely."""
    distance = np.sqrt(rng.uniform(band.nearest_m**2, band.farthest_m**2))
    bearing, yaw = rng.uniform(-np.pi, np.pi, 2)
    sds = np.array([SPEED_SD, TURN_SD, ACCELERATION_SD])
    speed, turn, acceleration = sds * rng.standard_normal(3)
    # A car that drives backwards is taken to be turned round.
    place = distance * np.cos(bearing), distance * np.sin(bearing)
    return np.array([*place, yaw, abs(speed), turn, acceleration])


@dataclass(frozen=True, slots=True)
class _Motion:
    """The motion with a given state (6,) in the middle frame."""

    state: np.ndarray

    def __call__(self, stamps_s: np.ndarray) -> np.ndarray:
        """Return (T, 3) x, y and yaw."""
        return np.array([pose_after(self.state, t) for t in stamps_s - FRAME_S * MIDDLE])


def _standing(stamps_s: np.ndarray) -> np.ndarray:
    return np.zeros((len(stamps_s), 3))


def body_of(model: BodyModel, unknowns: np.ndarray) -> Prisms:
    """Return the body for (5,) standard normal unknowns, with windows of glass."""
    low, high = model.glass_m or (np.inf, np.inf)
    return Prisms.join(
        [
            Prisms.of(
                outline,
                part.bottom,
                part.top,
                reflectivity=GLASS if low <= part.bottom < high else SILVER,
            )
            for part in model.parts(np.append(np.zeros(MOTION), unknowns))
            for outline in _half_outlines(part)
        ]
    )


def _half_outlines(part: BodyPart) -> tuple[np.ndarray, np.ndarray]:
    """Return the outlines behind and ahead of a part's middle; one alone has too many corners."""
    middle = (part.rear + part.front) / 2
    # A flank that narrows from the middle on has no point of its own there.
    aft = -part.aft if part.aft < middle else np.inf
    fore = part.fore if part.fore > middle else np.inf
    behind = half_outline(-part.rear, aft, part.half, part.tail_half, part.radius)
    ahead = half_outline(part.front, fore, part.half, part.nose_half, part.radius)
    ahead[[0, -1], 0], behind[[0, -1], 0] = middle, -middle
    return -behind, ahead


# Calibration


def measure(seed: int) -> dict[FigureKey, float]:
    """Return mean NEES by model, distance and frames, and the shares that are covered."""
    values: dict[FigureKey, float] = {}
    for row, (name, model) in enumerate(MODELS.items()):
        by_band = {
            band: np.array([squared_errors(model, band, [seed, row, k]) for k in range(CARS)])
            for band in BANDS
        }
        by_band[EVERY_BAND] = np.concatenate(list(by_band.values()))
        for band, squared in by_band.items():
            means = np.nanmean(squared, axis=0)
            for frames, mean in zip(OURS.values(), means, strict=True):
                key = FigureKey(CALIBRATED_NEES.format(name), band, frames_name(frames))
                values[key] = float(mean)
        for column, frames in enumerate(OURS.values()):
            squared = by_band[EVERY_BAND][:, column]
            values |= _covered(f"{name}, {frames_name(frames)}", squared)
    return values


def squared_errors(model: BodyModel, band: str, seed: Sequence[int]) -> np.ndarray:
    """Return the NEES of one passing car with 1, 3 and 7 frames (3,); NaN without a covariance."""
    car = passing_car(model, band, seed)
    out = np.full(len(OURS), np.nan)
    for column, frames in enumerate(OURS.values()):
        pose = fitted_pose(model, car, frames)
        if pose is not None and pose.covariance is not None:
            error = _error(pose, car.truth)
            out[column] = error @ np.linalg.solve(pose.covariance, error)
    return out


def fitted_pose(model: BodyModel, car: PassingCar, frames: int) -> VehiclePose | None:
    """Return the pose in the middle frame, fitted to a number of frames around it."""
    if frames == 1:
        shot = car.sweeps[MIDDLE]
        fit = BodyFit(lidar(), model, EXACTLY_DRAWN)
        return fit.fit(shot.scan, shot.target, shot.world_from_lidar, velocity=car.rough_velocity)
    lag, pose = frames // 2, None
    smoother = Smoother(lidar(), model, frames=frames, lag=lag, tolerance=EXACTLY_DRAWN)
    for shot in car.sweeps[MIDDLE - lag : MIDDLE + lag + 1]:
        pose = smoother.update(shot.scan, shot.target, shot.world_from_lidar)
    return pose


def _error(pose: VehiclePose, truth: np.ndarray) -> np.ndarray:
    """Return estimate minus truth (3,), x, y and yaw up to half a turn."""
    turned = axis_difference(np.array([pose.yaw]), truth[2:])[0]
    return np.array([pose.x - truth[0], pose.y - truth[1], turned])


def _covered(method: str, squared: np.ndarray) -> dict[FigureKey, float]:
    """Return the percentages of errors within the ellipsoids of each level."""
    from scipy.special import chdtri

    known = squared[np.isfinite(squared)]
    return {
        FigureKey(COVERED, method, f"{100 * level:.0f} %"): 100.0
        * float((known <= chdtri(POSE_UNKNOWNS, 1 - level)).mean())
        for level in LEVELS
    }


def judged(measured: Mapping[FigureKey, Sequence[float]]) -> list[ReproductionRow]:
    """Return for each mean NEES whether 3 is within its 95 % interval."""
    rows = []
    for name in MODELS:
        for (experiment, band, quantity), values in measured.items():
            if experiment == CALIBRATED_NEES.format(name):
                cars = CARS * (len(BANDS) if band == EVERY_BAND else 1)
                inside = [float(consistent(values, cars, 1))]
                key = FigureKey(CALIBRATED_INSIDE.format(name), band, quantity)
                rows.append(summarise(key, YES_OR_NO, inside))
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and print its tables."""
    options = study_parser("zhang2017_calibration", __doc__, seeds=30).parse_args(arguments)
    measured = measured_over_seeds(measure, FIRST_SEED, options)
    rows = [
        summarise(key, "%" if key.experiment == COVERED else "1", values)
        for key, values in measured.items()
    ]
    show(rows + judged(measured), NOTES, options)


if __name__ == "__main__":
    main()
