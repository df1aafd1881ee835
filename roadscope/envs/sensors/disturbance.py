"""What the faults of an episode do to a rig's measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from roadscope.core import Calibration, Pose
from roadscope.envs.imaging.light import Light, night
from roadscope.envs.sensors.faults import FAULTS, Fault
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.weather import CLEAR, WEATHERS, Weather

# --------------------------------------------------------------------------------------------------
# Which measurements of a sensor are lost, in bursts, whatever order they are asked for in.

PAGE = 1024
"""Draws that are made at once."""
BEFORE = 1 << 12
"""Bursts may have begun before the first measurement; longer ones there are none."""


@dataclass(frozen=True, slots=True)
class Gaps:
    """Bursts that begin by chance at any measurement; more severe ones hold the milder ones.

    start: chance that a burst begins. length: measurements that it takes.
    seed: of the draws, which do not depend on the two.
    """

    start: float
    length: int
    seed: int

    @staticmethod
    def of(shares: Sequence[float], lengths: Sequence[int], seed: int) -> Gaps:
        """Make the last of a ladder of shares that are lost in bursts of some length.

        A burst covers a measurement with chance 1 - (1 - start)^length. That no step of the
        ladder undoes what an earlier one took, chances and lengths never fall along it.
        """
        starts = [1 - (1 - p) ** (1 / n) for p, n in zip(shares, lengths, strict=True)]
        return Gaps(max(starts), max(lengths), seed)

    def hit(self, index: int) -> int | None:
        """Return where the burst that covers a measurement began, the first if several do."""
        for begin in range(index - self.length + 1, index + 1):
            page, place = divmod(begin + BEFORE, PAGE)
            if page >= 0 and _draws(self.seed, page)[place] < self.start:
                return begin
        return None


@lru_cache(maxsize=64)
def _draws(seed: int, page: int) -> np.ndarray:
    return np.random.default_rng([seed, page]).random(PAGE)


# --------------------------------------------------------------------------------------------------
# The light of faults: the dark, and a sun that stands low ahead.

HEADLIGHT_LX = 40.0
"""Of dipped beams on the road where the pictures show a light of 1, some 10 m ahead."""
BESIDE_RAD = 0.1
"""The sun stands within so much of straight ahead."""
FLARES = (1.5, 2.0, 3.0, 4.5, 7.0)
"""How much more stray light than a clean lens a windscreen brings, by severity of the glare."""


def darkness(fault: Fault, rng: np.random.Generator) -> Light:
    """Draw a night as dark as the fault says; the pictures are exposed for what headlights show.

    Of one seed all severities are the same night but for the light of the sky and the gain.
    """
    drawn = night(rng)
    share = fault.figure / HEADLIGHT_LX / float(np.mean(drawn.horizon))
    zenith, horizon, ground = (
        _times(c, share) for c in (drawn.zenith, drawn.horizon, drawn.ground)
    )
    return replace(
        drawn,
        sun=_times(drawn.sun, min(1.0, share)),
        zenith=zenith,
        horizon=horizon,
        ground=ground,
        gain=1.0,
        iso=2.0**fault.severity,
    )


def dazzling(fault: Fault, light: Light, ahead_rad: float, rng: np.random.Generator) -> Light:
    """Return a light that dazzles: where lamps are lit, by their halos, otherwise by a low sun.

    ahead_rad: heading of the camera, world frame, that the sun stands close to.
    """
    beside = float(rng.uniform(-BESIDE_RAD, BESIDE_RAD))
    flare = FLARES[fault.severity - 1]
    if light.lamps:
        return replace(light, flare=flare)
    elevation = float(np.radians(fault.figure))
    low = max(0.0, 1.0 - elevation / 0.5)
    sun = np.array([0.85, 0.80 - 0.18 * low, 0.70 - 0.38 * low])
    horizon = np.array([0.58, 0.66 - 0.06 * low, 0.74 - 0.18 * low])
    zenith = np.array([0.16, 0.28, 0.52])
    # The camera exposes for what falls on level ground, as it does by any day.
    fallen = float(np.mean(sun)) * np.sin(elevation) + float(np.mean(zenith + horizon)) / 2
    return Light(
        ahead_rad + beside,
        elevation,
        _times(sun, 1.0),
        _times(zenith, 1.0),
        _times(horizon, 1.0),
        clouds=0.0,
        gain=min(1.7, 1.1 / fallen),
        flare=flare,
    )


def _times(colour: object, share: float) -> tuple[float, float, float]:
    red, green, blue = (float(v) for v in np.asarray(colour, np.float64) * share)
    return red, green, blue


# --------------------------------------------------------------------------------------------------
# What the faults of an episode do to a rig's measurements.

SCANS_PER_BURST = (1, 1, 2, 3, 5)
SECONDS_PER_BLACKOUT = (0.1, 0.25, 0.5, 1.0, 2.0)
METRES_PER_DEGREE = 0.04
"""A mount that gave way by an angle has shifted by about the lever of a hand's breadth or two."""


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Faults of one seed; without any, nothing differs.

    Every fault draws from a seed of its own, so that one more leaves the others as they are.
    Severities of a kind share their draws: the same direction, the same bursts and more.
    """

    faults: Mapping[str, Fault]
    seed: int

    @staticmethod
    def of(faults: tuple[Fault, ...], seed: int) -> Disturbance:
        """Take faults as `faults_of` gives them."""
        return Disturbance({fault.kind: fault for fault in faults}, seed)

    def weather(self, otherwise: Weather) -> Weather:
        """Return what is in the air; weather beside a fault of the air is refused."""
        given = [self.faults[kind] for kind in ("fog", "rain") if kind in self.faults]
        if not given:
            return otherwise
        if otherwise != CLEAR:
            raise ValueError(
                f"weather '{otherwise.name}' and fault '{given[0]}' both say what is in the air: "
                "leave one out"
            )
        return WEATHERS[f"{given[0].kind}-{given[0].severity}"]

    def light(self, otherwise: Light, ahead_rad: float) -> Light:
        """Return the light of an image; ahead_rad: heading of the camera as the ego sets out."""
        light = otherwise
        if "night" in self.faults:
            light = darkness(self.faults["night"], self._rng("night"))
        if "glare" in self.faults:
            light = dazzling(self.faults["glare"], light, ahead_rad, self._rng("glare"))
        return light

    def scan_lost(self, index: int) -> bool:
        """Say whether the index-th scan never arrives."""
        fault = self.faults.get("dropped-scans")
        if fault is None:
            return False
        return self._gaps(fault, SCANS_PER_BURST).hit(index) is not None

    def image_lost(self, slot: int, period_s: float) -> str | None:
        """Say whether the image of a period is `missing`, `black`, or neither."""
        fault = self.faults.get("blackout")
        if fault is None:
            return None
        lengths = tuple(max(1, round(s / period_s)) for s in SECONDS_PER_BLACKOUT)
        begin = self._gaps(fault, lengths).hit(slot)
        if begin is None:
            return None
        return "black" if begin % 2 else "missing"

    @property
    def image_late_s(self) -> float:
        """By how much the stamps of images are too late."""
        fault = self.faults.get("clock-offset")
        return 0.0 if fault is None else 1e-3 * fault.figure

    def calibration(self, rig: Rig) -> Calibration:
        """Return where the user believes the sensors to be."""
        true, fault = rig.calibration(), self.faults.get("extrinsic-error")
        if fault is None:
            return true
        roots = _sequence("extrinsic-error", self.seed).spawn(len(true.ego_from_sensor))
        return Calibration(
            tuple(
                (name, pose @ _slip(fault.figure, np.random.default_rng(root)))
                for (name, pose), root in zip(true.ego_from_sensor, roots, strict=True)
            )
        )

    def idle_on(self, rig: Rig) -> tuple[Fault, ...]:
        """Return the faults that a rig does not feel, for want of the sensor that they are of."""
        there = {"lidar", *(("camera",) if rig.camera is not None else ())}
        return tuple(f for f in self.faults.values() if not there & set(FAULTS[f.kind].sensors))

    def _gaps(self, fault: Fault, lengths: tuple[int, ...]) -> Gaps:
        shares = [figure / 100 for figure in FAULTS[fault.kind].figures]
        seed = int(_sequence(fault.kind, self.seed).generate_state(1)[0])
        return Gaps.of(shares[: fault.severity], lengths[: fault.severity], seed)

    def _rng(self, kind: str) -> np.random.Generator:
        return np.random.default_rng(_sequence(kind, self.seed))


def _sequence(kind: str, seed: int) -> np.random.SeedSequence:
    """Return the fault's child of an episode's seed."""
    return np.random.SeedSequence(seed, spawn_key=(list(FAULTS).index(kind),))


def _slip(angle_deg: float, rng: np.random.Generator) -> Pose:
    """Turn by an angle about a random axis, and shift in a random direction (Rodrigues)."""
    axis, along = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    angle = np.radians(angle_deg)
    cross = np.cross(np.eye(3), axis)
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    matrix[:3, 3] = METRES_PER_DEGREE * angle_deg * along
    return Pose(matrix)
