"""What the faults of an episode do to a rig's measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from roadscope.core import Calibration, Pose
from roadscope.envs.imaging.light import Light
from roadscope.envs.sensors.fault_light import darkness, dazzling
from roadscope.envs.sensors.faults import FAULTS, Fault
from roadscope.envs.sensors.gaps import Gaps
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.weather import CLEAR, WEATHERS, Weather

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
