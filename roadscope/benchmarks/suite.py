"""A suite: which episodes are run, what counts in them, and who is compared by default.

A suite is a TOML file; those of the package are frozen once published, and every board names
the version. Seeds come from a split, so that training, validation and test never share one.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, TypeVar

from msgspec import Meta, Struct

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.metrics.odometry import SHORT_M
from roadscope.core.config import ConfigError, read_config
from roadscope.core.names import unknown
from roadscope.core.spec import NO_POSES, TRUE_POSES

T = TypeVar("T")

SUITES = (
    "quick",
    "standard",
    "detection",
    "tracking",
    "camera",
    "camera-unseen",
    "fusion",
    "odometry",
    "odometry-empty",
    "odometry-convoy",
    "odometry-ablation",
    "tracking-ego",
    "crossing",
)
"""Suites that ship with the package."""

SPLITS: Mapping[str, range] = {
    "train": range(0, 10_000),
    "validation": range(10_000, 20_000),
    "test": range(20_000, 30_000),
}
"""Seeds of each split; nothing is tuned on test seeds."""

Names = tuple[str, ...]
SomeNames = Annotated[Names, Meta(min_length=1)]
Positive = Annotated[float, Meta(gt=0, le=sys.float_info.max)]
"""Seconds or metres; infinity is none."""


class DetectionTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[detection]`."""

    entries: Names = ()


class TrackingTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[tracking]`; ego: one text or several."""

    entries: Names = ()
    detectors: Names = ()
    ego: str | SomeNames = TRUE_POSES


class CameraTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[camera]`."""

    entries: Names = ()
    every_s: Positive = 0.5


class FusionTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[fusion]`."""

    entries: Names = ()
    lidar: Names = ()
    camera: Names = ()
    every_s: Positive = 0.4


class OdometryTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[odometry]`."""

    entries: Names = ()
    lengths_m: Annotated[tuple[Positive, ...], Meta(min_length=1)] = SHORT_M


class EligibilityTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[eligibility]`; range_m: nearest and farthest."""

    range_m: tuple[float, float] = Eligibility().range_m
    min_returns: int = Eligibility().min_returns
    families: Names = Eligibility().families


class SuiteTable(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A suite's file; what the keys mean is said in `Suite`.

    seeds: how many of the split, or which.
    """

    name: str
    version: int
    summary: str = ""
    rig: str
    duration_s: Positive | None = None
    scenarios: SomeNames
    weathers: SomeNames | None = None
    lights: SomeNames = ("day",)
    faults: SomeNames | None = None
    split: str = "test"
    seeds: int | tuple[int, ...]
    eligibility: EligibilityTable = EligibilityTable()
    detection: DetectionTable = DetectionTable()
    tracking: TrackingTable = TrackingTable()
    camera: CameraTable = CameraTable()
    fusion: FusionTable = FusionTable()
    odometry: OdometryTable = OdometryTable()


class SuiteError(ValueError):
    """A suite could not be read."""


@dataclass(frozen=True, slots=True)
class Suite:
    """A benchmark's conditions.

    scenarios: names of `roadscope.envs.traffic.scenarios.SCENARIOS`.
    seeds: one episode each per scenario.
    rig: a name of `roadscope.envs.sensors.rigs.RIGS` or a path to a TOML file.
    duration_s: length of an episode; None: as long as the scenario says.
    detectors, trackers: entries that every run compares.
    public_detectors: whose detections all trackers get; `oracle` stands for the eligible
        truth boxes themselves.
    weathers: names of `roadscope.envs.sensors.weather.WEATHERS`; every episode is sensed in each.
    lights: names of `roadscope.envs.imaging.light.LIGHTS`; further ones in the first weather.
    faults: sets of faults of `roadscope.envs.sensors.faults.FAULTS`, further ones likewise. They
        hold fog and rain too, so a suite names weathers or faults.
    camera_detectors: entries of the camera board, on an image every `image_every_s`.
    fusions: entries of the fusion board; all get, every `fused_every_s`, the detections of each
        of `fused_lidar` with those of each of `fused_camera`.
    egos: whose poses of the ego trackers are told: `truth`, `none` or odometries; every tracker is
        compared with each, unless it names its own (`gnn?ego=none`).
    odometries: entries of the odometry board; their drift is measured over stretches of
        `odometry_lengths_m`.
    """

    name: str
    version: int
    summary: str
    scenarios: tuple[str, ...]
    seeds: tuple[int, ...]
    rig: str
    duration_s: float | None
    eligibility: Eligibility
    detectors: tuple[str, ...]
    trackers: tuple[str, ...]
    public_detectors: tuple[str, ...]
    weathers: tuple[str, ...] = ("clear",)
    lights: tuple[str, ...] = ("day",)
    faults: tuple[tuple[str, ...], ...] = ((),)
    camera_detectors: tuple[str, ...] = ()
    image_every_s: float = 0.5
    fusions: tuple[str, ...] = ()
    fused_lidar: tuple[str, ...] = ()
    fused_camera: tuple[str, ...] = ()
    fused_every_s: float = 0.4
    odometries: tuple[str, ...] = ()
    odometry_lengths_m: tuple[float, ...] = SHORT_M
    egos: tuple[str, ...] = (TRUE_POSES,)

    @property
    def title(self) -> str:
        """Name and version."""
        return f"{self.name} v{self.version}"

    @property
    def summary_with_seeds(self) -> str:
        """The summary and the number of seeds."""
        seeds = f"{len(self.seeds)} seed{'s' * (len(self.seeds) > 1)}"
        return f"{self.summary}, {seeds}" if self.summary else seeds


def load_suite(name_or_path: str | Path) -> Suite:
    """Read a suite of the package by name, or one of your own from a `.toml` file."""
    text = str(name_or_path)
    if text in SUITES:
        content = resources.files("roadscope.benchmarks").joinpath(f"suites/{text}.toml")
        return parse_suite(content.read_text(encoding="utf-8"), text)
    if not text.endswith(".toml"):
        raise SuiteError(f"{unknown('suite', text, SUITES)}; or a path ending in .toml")
    try:
        content_text = Path(text).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise SuiteError(f"cannot read suite {text}: {reason}") from error
    suite = parse_suite(content_text, text)
    if not suite.rig.endswith(".toml"):
        return suite
    return replace(suite, rig=str(Path(text).parent / suite.rig))


def parse_suite(content: str, label: str) -> Suite:
    """Read a suite from TOML text; errors begin with the label and list all problems."""
    try:
        return _suite(read_config(content, SuiteTable))
    except ConfigError as error:
        raise SuiteError(f"{label}: {error}") from error


def check_names(suite: Suite) -> None:
    """Refuse scenarios and rigs that do not exist, and episodes shorter than one sweep."""
    from roadscope.benchmarks.episode import Episode, check_episode
    from roadscope.envs.sensors.rigs import rig
    from roadscope.envs.traffic.scenarios import SCENARIOS

    for name in suite.scenarios:
        if name not in SCENARIOS:
            raise SuiteError(unknown("scenario", name, SCENARIOS))
    rig(suite.rig)
    for name in suite.scenarios:
        for light in suite.lights:
            check_episode(Episode(name, suite.seeds[0], suite.rig, suite.duration_s, light=light))
    first = Episode(suite.scenarios[0], suite.seeds[0], suite.rig, light=suite.lights[0])
    for faults in suite.faults:
        check_episode(replace(first, faults=faults))


def _suite(table: SuiteTable) -> Suite:
    """Return the suite of a table; problems between its keys are raised together."""
    problems: list[str] = []

    def checked(key: str, read: Callable[[], T], instead: T) -> T:
        """Note what is wrong with a key and go on."""
        try:
            return read()
        except ValueError as error:
            problems.append(f"{key}: {error}")
            return instead

    if table.weathers is not None and table.faults is not None:
        problems.append("weathers and faults: choose one; faults hold weather too, as fog:3")
    suite = Suite(
        name=table.name,
        version=table.version,
        summary=table.summary,
        scenarios=_unique(table.scenarios),
        seeds=checked("seeds", lambda: _seeds(table), ()),
        rig=table.rig,
        duration_s=table.duration_s,
        eligibility=checked("eligibility", lambda: _eligibility(table), Eligibility()),
        detectors=_unique(table.detection.entries),
        trackers=_unique(table.tracking.entries),
        public_detectors=_unique(table.tracking.detectors),
        weathers=checked("weathers", lambda: _weathers(table.weathers or ("clear",)), ()),
        lights=checked("lights", lambda: _lights(table.lights), ()),
        faults=checked("faults", lambda: _faults(table.faults or ("clear",)), ()),
        camera_detectors=_unique(table.camera.entries),
        image_every_s=table.camera.every_s,
        fusions=_unique(table.fusion.entries),
        fused_lidar=_unique(table.fusion.lidar),
        fused_camera=_unique(table.fusion.camera),
        fused_every_s=table.fusion.every_s,
        odometries=_unique(table.odometry.entries),
        odometry_lengths_m=_unique(table.odometry.lengths_m),
        egos=checked("tracking.ego", lambda: _egos(table.tracking.ego), ()),
    )
    if problems:
        raise ConfigError(problems)
    return suite


def _unique(values: Iterable[T]) -> tuple[T, ...]:
    """Drop what was there before."""
    return tuple(dict.fromkeys(values))


def _eligibility(table: SuiteTable) -> Eligibility:
    rule = table.eligibility
    return Eligibility(rule.range_m, rule.min_returns, _unique(rule.families))


def _egos(given: str | Names) -> Names:
    """Read one text or several."""
    egos = _unique([given] if isinstance(given, str) else given)
    if "" in egos:
        raise ValueError(f"expected {TRUE_POSES}, {NO_POSES} or an odometry")
    return egos


def _weathers(names: Names) -> Names:
    """Read names in full, so that `fog` and `fog-3` are one."""
    from roadscope.envs.sensors.weather import weather

    return _unique(weather(name).name for name in names)


def _lights(names: Names) -> Names:
    from roadscope.envs.imaging.light import LIGHTS

    for name in names:
        if name not in LIGHTS:
            raise ValueError(unknown("light", name, LIGHTS))
    return _unique(names)


def _faults(texts: Names) -> tuple[Names, ...]:
    """Read one set of faults a text, such as `night:2 + glare:1`; `clear` is none."""
    from roadscope.envs.sensors.faults import faults_of

    return _unique(tuple(map(str, faults_of(text))) for text in texts)


def _seeds(table: SuiteTable) -> tuple[int, ...]:
    if table.split not in SPLITS:
        raise ValueError(unknown("split", table.split, SPLITS))
    allowed, given = SPLITS[table.split], table.seeds
    if isinstance(given, int):
        if given > len(allowed):
            raise ValueError(f"split '{table.split}' has {len(allowed)} seeds, got {given}")
        given = tuple(allowed[: max(given, 0)])
    if not given or not all(seed in allowed for seed in given):
        raise ValueError(
            f"expected how many, or a list within {allowed.start} to {allowed.stop - 1} "
            f"(split '{table.split}'), got {table.seeds!r}"
        )
    return _unique(given)
