"""A suite: which episodes are run, what counts in them, and who is compared by default.

A suite is a TOML file; those of the package are frozen once published, and every board names
the version. Seeds come from a split, so that training, validation and test never share one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

from roadscope.benchmarks.ego import NO_POSES, TRUE_POSES
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.metrics.odometry import SHORT_M
from roadscope.core import RecordError
from roadscope.core.names import unknown

SUITES = (
    "quick", "standard", "detection", "tracking", "camera", "camera-unseen", "fusion", "odometry",
    "odometry-empty", "odometry-convoy", "odometry-ablation", "tracking-ego", "crossing",
)  # fmt: skip
"""Suites that ship with the package."""

SPLITS: Mapping[str, range] = {
    "train": range(0, 10_000),
    "validation": range(10_000, 20_000),
    "test": range(20_000, 30_000),
}
"""Seeds of each split; nothing is tuned on test seeds."""

KEYS = (
    "name", "version", "summary", "rig", "duration_s", "scenarios", "weathers", "lights", "faults",
    "split", "seeds", "eligibility", "detection", "tracking", "camera", "fusion", "odometry",
)  # fmt: skip


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
        compared with each, unless it names its own (`ego.split_ego`).
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
    """Read a suite from TOML text; errors begin with the label."""
    try:
        table = tomllib.loads(content)
    except tomllib.TOMLDecodeError as error:
        raise SuiteError(f"{label}: not TOML: {error}") from error
    try:
        return _suite(table)
    except (SuiteError, RecordError) as error:
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


def _suite(table: Mapping[str, Any]) -> Suite:
    _known_keys(table, KEYS, "")
    detection = _table(table, "detection", ("entries",))
    tracking = _table(table, "tracking", ("entries", "detectors", "ego"))
    camera = _table(table, "camera", ("entries", "every_s"))
    fusion = _table(table, "fusion", ("entries", "lidar", "camera", "every_s"))
    odometry = _table(table, "odometry", ("entries", "lengths_m"))
    eligibility = _table(table, "eligibility", ("range_m", "min_returns", "families"))
    duration = _seconds(table, "duration_s", None)
    return Suite(
        name=_take(table, "name", str),
        version=_take(table, "version", int),
        summary=_take(table, "summary", str, ""),
        scenarios=_strings(table, "scenarios"),
        seeds=_seeds(table),
        rig=_take(table, "rig", str),
        duration_s=duration,
        eligibility=_eligibility(eligibility),
        detectors=_strings(detection, "entries", ()),
        trackers=_strings(tracking, "entries", ()),
        public_detectors=_strings(tracking, "detectors", ()),
        weathers=_weathers(table),
        lights=_lights(table),
        faults=_faults(table),
        camera_detectors=_strings(camera, "entries", ()),
        image_every_s=_seconds(camera, "every_s", 0.5) or 0.5,
        fusions=_strings(fusion, "entries", ()),
        fused_lidar=_strings(fusion, "lidar", ()),
        fused_camera=_strings(fusion, "camera", ()),
        fused_every_s=_seconds(fusion, "every_s", 0.4) or 0.4,
        odometries=_strings(odometry, "entries", ()),
        odometry_lengths_m=_lengths(odometry),
        egos=_egos(tracking),
    )


def _seconds(table: Mapping[str, Any], key: str, default: float | None) -> float | None:
    value = _take(table, key, (int, float), default)
    if value is not None and not 0 < value < float("inf"):
        raise SuiteError(f"{key}: expected seconds above 0, got {value}")
    return None if value is None else float(value)


def _lengths(table: Mapping[str, Any]) -> tuple[float, ...]:
    given = _take(table, "lengths_m", list, list(SHORT_M))
    if not given or not all(type(v) in (int, float) and 0 < v < float("inf") for v in given):
        raise SuiteError(f"odometry.lengths_m: expected metres above 0, got {given}")
    return tuple(dict.fromkeys(float(v) for v in given))


def _egos(table: Mapping[str, Any]) -> tuple[str, ...]:
    """Read one text or several."""
    given = _take(table, "ego", (str, list), TRUE_POSES)
    named = _strings({"ego": [given] if isinstance(given, str) else given}, "ego")
    if "" in named:
        raise SuiteError(f"tracking.ego: expected {TRUE_POSES}, {NO_POSES} or an odometry")
    return named


def _weathers(table: Mapping[str, Any]) -> tuple[str, ...]:
    """Read names in full, so that `fog` and `fog-3` are one."""
    from roadscope.envs.sensors.weather import weather

    given = _strings(table, "weathers", ("clear",))
    if not given:
        raise SuiteError("weathers: expected at least one")
    try:
        return tuple(dict.fromkeys(weather(name).name for name in given))
    except ValueError as error:
        raise SuiteError(f"weathers: {error}") from error


def _lights(table: Mapping[str, Any]) -> tuple[str, ...]:
    from roadscope.envs.imaging.light import LIGHTS

    given = _strings(table, "lights", ("day",))
    if not given:
        raise SuiteError("lights: expected at least one")
    for name in given:
        if name not in LIGHTS:
            raise SuiteError(f"lights: {unknown('light', name, LIGHTS)}")
    return given


def _faults(table: Mapping[str, Any]) -> tuple[tuple[str, ...], ...]:
    """Read one set of faults a text, such as `night:2 + glare:1`; `clear` is none."""
    from roadscope.envs.sensors.faults import NO_FAULT, faults_of

    given = _strings(table, "faults", (NO_FAULT,))
    if not given:
        raise SuiteError("faults: expected at least one")
    if "faults" in table and "weathers" in table:
        raise SuiteError("weathers and faults: choose one; faults hold weather too, as fog:3")
    try:
        return tuple(dict.fromkeys(tuple(map(str, faults_of(text))) for text in given))
    except ValueError as error:
        raise SuiteError(f"faults: {error}") from error


def _eligibility(table: Mapping[str, Any]) -> Eligibility:
    default = Eligibility()
    band = _take(table, "range_m", list, list(default.range_m))
    if len(band) != 2 or not all(type(v) in (int, float) for v in band):
        raise SuiteError(f"eligibility.range_m: expected [near, far] in metres, got {band}")
    return Eligibility(
        range_m=(float(band[0]), float(band[1])),
        min_returns=_take(table, "min_returns", int, default.min_returns),
        families=_strings(table, "families", default.families),
    )


def _seeds(table: Mapping[str, Any]) -> tuple[int, ...]:
    split = _take(table, "split", str, "test")
    if split not in SPLITS:
        raise SuiteError(unknown("split", split, SPLITS))
    allowed, given = SPLITS[split], _take(table, "seeds", (int, list))
    if isinstance(given, int):
        if given > len(allowed):
            raise SuiteError(f"seeds: split '{split}' has {len(allowed)} seeds, got {given}")
        given = list(allowed[: max(given, 0)])
    if not given or not all(type(s) is int and s in allowed for s in given):
        raise SuiteError(
            f"seeds: expected how many, or a list within {allowed.start} to {allowed.stop - 1} "
            f"(split '{split}'), got {table['seeds']!r}"
        )
    return tuple(dict.fromkeys(given))


def _table(table: Mapping[str, Any], key: str, known: tuple[str, ...]) -> Mapping[str, Any]:
    found: Mapping[str, Any] = _take(table, key, dict, {})
    _known_keys(found, known, f"{key}.")
    return found


def _known_keys(table: Mapping[str, Any], known: tuple[str, ...], prefix: str) -> None:
    for key in table:
        if key not in known:
            raise SuiteError(unknown("key", prefix + key, [prefix + k for k in known]))


_NEEDED = object()


def _take(table: Mapping[str, Any], key: str, kind: Any, default: Any = _NEEDED) -> Any:
    value = table.get(key, default)
    if value is _NEEDED:
        raise SuiteError(f"key '{key}' is missing")
    if value is not default and (not isinstance(value, kind) or isinstance(value, bool)):
        kinds = kind if isinstance(kind, tuple) else (kind,)
        raise SuiteError(f"{key}: expected {' or '.join(map(_kind_name, kinds))}, got {value!r}")
    return value


def _kind_name(kind: type) -> str:
    names: dict[type, str] = {
        str: "text", int: "an integer", float: "a number", list: "a list", dict: "a table"
    }  # fmt: skip
    return names[kind]


def _strings(
    table: Mapping[str, Any], key: str, default: tuple[str, ...] | None = None
) -> tuple[str, ...]:
    value = _take(table, key, list, _NEEDED if default is None else list(default))
    if not all(isinstance(v, str) for v in value):
        raise SuiteError(f"{key}: expected a list of texts, got {value!r}")
    if default is None and not value:
        raise SuiteError(f"{key}: expected at least one")
    return tuple(dict.fromkeys(value))
