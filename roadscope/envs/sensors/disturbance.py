"""Effects of the faults of an episode on a rig's measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from roadscope.core import Calibration, Pose
from roadscope.envs.imaging.light import Light, clear_sky, colour_of, exposure_gain, night
from roadscope.envs.sensors.faults import FAULTS, Fault
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.weathers import CLEAR, WEATHERS, Weather
from roadscope.envs.world.materials import Colour

# --------------------------------------------------------------------------------------------------
# Measurements that are lost in bursts; they do not depend on the order of requests.

PAGE = 1024
"""Number of draws that are made at once."""
BEFORE = 1 << 12
"""Bursts may begin up to this many measurements before the first; longer ones do not exist."""


@dataclass(frozen=True, slots=True)
class Gaps:
    """Random bursts of lost measurements; those of a higher severity include the milder ones.

    start: probability that a burst begins at a measurement. length: measurements in a burst.
    seed: of the draws, which do not depend on start and length.
    """

    start: float
    length: int
    seed: int

    @staticmethod
    def of(shares: Sequence[float], lengths: Sequence[int], seed: int) -> Gaps:
        """Return the gaps of the last of several severities.

        shares: of lost measurements by severity, 0 to 1. lengths: of the bursts by severity.

        A burst covers a measurement with probability 1 - (1 - start)^length. Probabilities and
        lengths never fall with severity, so that each severity includes the earlier ones.
        """
        starts = [1 - (1 - p) ** (1 / n) for p, n in zip(shares, lengths, strict=True)]
        return Gaps(max(starts), max(lengths), seed)

    def burst_start(self, index: int) -> int | None:
        """Return the start of the burst that covers a measurement (the first one), or None."""
        for begin in range(index - self.length + 1, index + 1):
            page, place = divmod(begin + BEFORE, PAGE)
            if page >= 0 and _draws(self.seed, page)[place] < self.start:
                return begin
        return None


@lru_cache(maxsize=64)
def _draws(seed: int, page: int) -> np.ndarray:
    return np.random.default_rng([seed, page]).random(PAGE)


# --------------------------------------------------------------------------------------------------
# The light of faults: darkness, and a low sun ahead.

HEADLIGHT_LX = 40.0
"""Illuminance by dipped headlights some 10 m ahead, where images show a light of 1."""
SUN_OFFSET_RAD = 0.1
"""The sun is at most this far from straight ahead."""
FLARES = (1.5, 2.0, 3.0, 4.5, 7.0)
"""Stray light of a windscreen as a multiple of that of a clean lens, by severity of the glare."""


def dark_night(fault: Fault, rng: np.random.Generator) -> Light:
    """Draw a night with the fault's illuminance; images are exposed for the light of headlights.

    With one seed, all severities are the same night except the light of the sky and the gain.
    """
    drawn = night(rng)
    factor = fault.figure / HEADLIGHT_LX / float(np.mean(drawn.horizon))
    zenith, horizon, ground = (
        _scaled(c, factor) for c in (drawn.zenith, drawn.horizon, drawn.ground)
    )
    return replace(
        drawn,
        sun=_scaled(drawn.sun, min(1.0, factor)),
        zenith=zenith,
        horizon=horizon,
        ground=ground,
        gain=1.0,
        iso=2.0**fault.severity,
    )


def with_glare(fault: Fault, light: Light, ahead_rad: float, rng: np.random.Generator) -> Light:
    """Return a light with glare: halos of lamps where these are lit, otherwise a low sun.

    ahead_rad: heading of the camera, world frame; the sun is within `SUN_OFFSET_RAD` of it.
    """
    offset_rad = float(rng.uniform(-SUN_OFFSET_RAD, SUN_OFFSET_RAD))
    flare = FLARES[fault.severity - 1]
    if light.lamps:
        return replace(light, flare=flare)
    elevation = float(np.radians(fault.figure))
    sky = clear_sky(elevation)
    return Light(
        ahead_rad + offset_rad,
        elevation,
        colour_of(sky.sun),
        colour_of(sky.zenith),
        colour_of(sky.horizon),
        clouds=0.0,
        gain=exposure_gain(sky, elevation),
        flare=flare,
    )


def _scaled(colour: Colour, factor: float) -> Colour:
    return colour_of(np.array(colour) * factor)


# --------------------------------------------------------------------------------------------------
# All faults of an episode.

SCANS_PER_BURST = (1, 1, 2, 3, 5)
SECONDS_PER_BLACKOUT = (0.1, 0.25, 0.5, 1.0, 2.0)
"""Length of bursts of lost scans and of blackouts by severity; chosen by hand."""
METRES_PER_DEGREE = 0.04
"""Shift of a bent mount for each degree of its turn; chosen by hand."""


@dataclass(frozen=True, slots=True)
class Disturbance:
    """The faults of an episode, by kind, and its seed; without faults, nothing changes.

    Every fault has its own random numbers, which do not depend on other faults. All severities of a
    kind use the same ones: errors have the same direction, and a higher severity has the bursts of
    the lower ones and more.
    """

    faults: Mapping[str, Fault]
    seed: int

    @staticmethod
    def of(faults: tuple[Fault, ...], seed: int) -> Disturbance:
        """Return the disturbance by the faults of `faults_of`."""
        return Disturbance({fault.kind: fault for fault in faults}, seed)

    def weather(self, chosen: Weather) -> Weather:
        """Return the weather; raise `ValueError` for chosen weather together with fog or rain."""
        air_faults = [self.faults[kind] for kind in ("fog", "rain") if kind in self.faults]
        if not air_faults:
            return chosen
        if chosen != CLEAR:
            raise ValueError(
                f"weather '{chosen.name}' and fault '{air_faults[0]}' both say what is in the air: "
                "leave one out"
            )
        return WEATHERS[f"{air_faults[0].kind}-{air_faults[0].severity}"]

    def light(self, chosen: Light, ahead_rad: float) -> Light:
        """Return the light of an image; ahead_rad: heading of the camera at its first image."""
        light = chosen
        if "night" in self.faults:
            light = dark_night(self.faults["night"], self._rng("night"))
        if "glare" in self.faults:
            light = with_glare(self.faults["glare"], light, ahead_rad, self._rng("glare"))
        return light

    def scan_lost(self, index: int) -> bool:
        """Return whether the index-th scan is lost."""
        fault = self.faults.get("dropped-scans")
        if fault is None:
            return False
        return self._gaps(fault, SCANS_PER_BURST).burst_start(index) is not None

    def image_lost(self, index: int, period_s: float) -> str | None:
        """Return `missing` or `black` if a blackout affects the index-th image, else None.

        period_s: from image to image.
        """
        fault = self.faults.get("blackout")
        if fault is None:
            return None
        lengths = tuple(max(1, round(s / period_s)) for s in SECONDS_PER_BLACKOUT)
        begin = self._gaps(fault, lengths).burst_start(index)
        if begin is None:
            return None
        return "black" if begin % 2 else "missing"

    @property
    def image_late_s(self) -> float:
        """Delay of the stamps of images, seconds."""
        fault = self.faults.get("clock-offset")
        return 0.0 if fault is None else 1e-3 * fault.figure

    def calibration(self, rig: Rig) -> Calibration:
        """Return the calibration that the user gets, wrong by the extrinsic error."""
        true, fault = rig.calibration(), self.faults.get("extrinsic-error")
        if fault is None:
            return true
        roots = _sequence("extrinsic-error", self.seed).spawn(len(true.ego_from_sensor))
        return Calibration(
            tuple(
                (name, pose @ _mounting_error(fault.figure, np.random.default_rng(root)))
                for (name, pose), root in zip(true.ego_from_sensor, roots, strict=True)
            )
        )

    def idle_on(self, rig: Rig) -> tuple[Fault, ...]:
        """Return the faults that do not affect a rig, since it lacks their sensor."""
        sensors = {"lidar", *(("camera",) if rig.camera is not None else ())}
        return tuple(f for f in self.faults.values() if not sensors & set(FAULTS[f.kind].sensors))

    def _gaps(self, fault: Fault, lengths: tuple[int, ...]) -> Gaps:
        shares = [figure / 100 for figure in FAULTS[fault.kind].figures]
        seed = int(_sequence(fault.kind, self.seed).generate_state(1)[0])
        return Gaps.of(shares[: fault.severity], lengths[: fault.severity], seed)

    def _rng(self, kind: str) -> np.random.Generator:
        return np.random.default_rng(_sequence(kind, self.seed))


def _sequence(kind: str, seed: int) -> np.random.SeedSequence:
    """Return the random sequence of a fault in an episode."""
    return np.random.SeedSequence(seed, spawn_key=(list(FAULTS).index(kind),))


def _mounting_error(angle_deg: float, rng: np.random.Generator) -> Pose:
    """Return a turn by an angle about a random axis, with a shift in a random direction."""
    axis, along = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    angle = np.radians(angle_deg)
    cross = np.cross(np.eye(3), axis)
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    matrix[:3, 3] = METRES_PER_DEGREE * angle_deg * along
    return Pose(matrix)
