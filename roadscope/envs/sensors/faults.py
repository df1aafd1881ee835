"""Faults of sensing by name and severity: `fog:3`, `clock-offset:1`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from roadscope.core.checks import require
from roadscope.core.names import unknown
from roadscope.envs.sensors.weathers import RAIN_MM_H, VISIBILITY_M

SEVERITIES = range(1, 6)
NO_FAULT = "clear"
"""Name of the condition without any fault."""


@dataclass(frozen=True, slots=True)
class FaultKind:
    """A fault in its five severities.

    figures: value of each severity, in `unit`; comments beside the table explain them.
    sensors: the sensors whose measurements it changes; a rig without them is not affected.
    """

    summary: str
    figures: tuple[float, float, float, float, float]
    unit: str
    sensors: tuple[str, ...]


FAULTS: Mapping[str, FaultKind] = MappingProxyType(
    {
        # Visibility by day, as in the weather of the same name.
        "fog": FaultKind("Fog for LiDAR and camera alike.", VISIBILITY_M, "m", ("lidar", "camera")),
        "rain": FaultKind(
            "Rain for LiDAR and camera alike.", RAIN_MM_H, "mm/h", ("lidar", "camera")
        ),
        # Minutes after sunset, end of civil twilight, a lit town, full moon, stars and far towns.
        "night": FaultKind(
            "Darkness with headlights, the camera's gain up by 6 dB a step.",
            (16.0, 4.0, 1.0, 0.25, 0.04),
            "lx",
            ("camera",),
        ),
        # From above a wide camera's view down to the end of the road; windscreens scatter more
        # the flatter the light comes in.
        "glare": FaultKind(
            "A low sun ahead of the ego as it starts; at night halos of lamps.",
            (30.0, 20.0, 12.0, 7.0, 4.0),
            "deg",
            ("camera",),
        ),
        # From packets lost now and then to a link that is down for half a second at a time.
        "dropped-scans": FaultKind(
            "Frames arrive without their scan, in bursts.",
            (2.0, 5.0, 10.0, 20.0, 40.0),
            "%",
            ("lidar",),
        ),
        # From 0.1 s at a time (one lost message) to 2 s (a restart of the camera).
        "blackout": FaultKind(
            "Images are missing or black for a while.",
            (2.0, 5.0, 10.0, 20.0, 40.0),
            "%",
            ("camera",),
        ),
        # From a busy driver's latency to a whole turn of a LiDAR: at 30 m/s, 0.15 m to 3 m.
        "clock-offset": FaultKind(
            "Images are stamped later than they were taken.",
            (5.0, 10.0, 25.0, 50.0, 100.0),
            "ms",
            ("camera",),
        ),
        # From the error of a careful calibration to a bent mount: at 50 m, 0.2 m to 3.5 m.
        "extrinsic-error": FaultKind(
            "The calibration is wrong: turned by this angle, and shifted by 4 cm/deg.",
            (0.25, 0.5, 1.0, 2.0, 4.0),
            "deg",
            ("lidar", "camera"),
        ),
    }
)
"""All faults; new ones come last, since the position decides the seed."""

EXCLUSIVE = (("fog", "rain"),)
"""Faults that exclude each other: the air of an episode contains one kind of drops."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A kind of `FAULTS` in one severity, 1 (slight) to 5 (worst)."""

    kind: str
    severity: int

    def __post_init__(self) -> None:
        if self.kind not in FAULTS:
            raise ValueError(f"{unknown('fault', str(self.kind), FAULTS)}, each as NAME:1 to :5")
        sound = type(self.severity) is int and self.severity in SEVERITIES
        require(sound, self, "severity", f"1 to 5, as {self.kind}:3", self.severity)

    @staticmethod
    def parse(text: str) -> Fault:
        """Return the fault of a text such as `fog:3`; errors list the known names."""
        if not isinstance(text, str):
            raise TypeError(f"fault: expected text such as fog:3, got {text!r}")
        kind, _, severity = text.strip().partition(":")
        if kind not in FAULTS:
            raise ValueError(f"{unknown('fault', kind, FAULTS)}, each as NAME:1 to NAME:5")
        if severity not in map(str, SEVERITIES):
            raise ValueError(
                f"fault '{text}': expected a severity 1 to 5, {kind}:1 to {kind}:5, "
                f"got '{severity}'"
            )
        return Fault(kind, int(severity))

    def __str__(self) -> str:
        """Return the text that `parse` reads."""
        return f"{self.kind}:{self.severity}"

    @property
    def figure(self) -> float:
        """Value of the severity, in the kind's unit."""
        return FAULTS[self.kind].figures[self.severity - 1]


EXAMPLES = "'fog:3', 'night:2 + glare:1', 'clear' or a list of them"

Faults = str | Iterable[str | Fault]
"""A condition: `fog:3`, `night:2 + glare:1`, `clear`, or a list of faults."""


def faults_of(faults: Faults) -> tuple[Fault, ...]:
    """Return the faults of one condition in the order of `FAULTS`; raise for contradictions."""
    if not isinstance(faults, Iterable):
        raise TypeError(f"faults: expected {EXAMPLES}, got {faults!r}")
    parts = faults.split("+") if isinstance(faults, str) else list(faults)
    texts = [part.strip() if isinstance(part, str) else part for part in parts]
    named = [text for text in texts if text != NO_FAULT] if len(texts) == 1 else texts
    parsed = [each if isinstance(each, Fault) else Fault.parse(each) for each in named]
    kinds = [fault.kind for fault in parsed]
    for kind in kinds:
        if kinds.count(kind) > 1:
            raise ValueError(f"fault '{kind}' is given {kinds.count(kind)} times: choose one")
    for pair in EXCLUSIVE:
        if set(pair) <= set(kinds):
            raise ValueError(f"faults {' and '.join(pair)} exclude each other: choose one")
    order = list(FAULTS)
    return tuple(sorted(parsed, key=lambda fault: order.index(fault.kind)))


def condition_name(faults: Iterable[Fault]) -> str:
    """Return faults as the text of one condition, which `faults_of` reads."""
    return " + ".join(map(str, faults)) or NO_FAULT


def of_camera_alone(faults: Faults) -> tuple[str, ...]:
    """Return the faults that do not affect scans."""
    return tuple(str(f) for f in faults_of(faults) if "lidar" not in FAULTS[f.kind].sensors)


def summary_of(kind: str) -> str:
    """Return one line with the values of all severities."""
    fault = FAULTS[kind]
    figures = ", ".join(f"{figure:g}" for figure in fault.figures)
    return f"{fault.summary} {kind}:1 to {kind}:5 are {figures} {fault.unit}."
