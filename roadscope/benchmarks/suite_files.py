"""Reads suites from TOML files.

The suites of roadscope do not change once published; every board names the version. Seeds come
from a split, so that training, validation and test never share a seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from msgspec import Struct, defstruct

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.suite import SPLITS, Names, Positive, SomeNames, Suite, SuiteError
from roadscope.core.config import ConfigError, read_config
from roadscope.core.names import unknown

if TYPE_CHECKING:
    from roadscope.benchmarks.boards import Board

T = TypeVar("T")

SUITES = (
    "quick",
    "standard",
    "detection",
    "uneven",
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
    "driving",
    "driving-camera",
    "driving-faults",
)
"""The suites of roadscope."""


class EligibilityTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[eligibility]`; range_m: nearest and farthest."""

    range_m: tuple[float, float] = Eligibility().range_m
    min_returns: int = Eligibility().min_returns
    families: Names = Eligibility().families


class SuiteTable(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The keys of a suite's file beside the tables of boards; `Suite` documents them.

    seeds: how many seeds of the split, or a list of them.
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


def load_suite(name_or_path: str | Path) -> Suite:
    """Return a suite of roadscope by its name, or read one from a `.toml` file."""
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
    from roadscope.benchmarks.boards import BOARDS

    try:
        return _suite(read_config(content, _file_record(BOARDS)), BOARDS)
    except ConfigError as error:
        raise SuiteError(f"{label}: {error}", error.problems) from error


def _file_record(boards: Mapping[str, Board]) -> type[SuiteTable]:
    """Return the record of a whole file: the common keys, and a table for each board."""
    tables: list[tuple[str, Any, Any]] = [
        (_field(name), board.settings_type, board.settings_type()) for name, board in boards.items()
    ]
    keys = {_field(name): name for name in boards}
    record = defstruct(
        "SuiteFile", tables, bases=(SuiteTable,), frozen=True, kw_only=True, rename=keys
    )
    return cast("type[SuiteTable]", record)


def _field(board: str) -> str:
    """Return the field of a board's table in the record of a file."""
    return board.replace("-", "_")


def _suite(table: SuiteTable, boards: Iterable[str]) -> Suite:
    """Return the suite of a table; problems between its keys are raised together."""
    problems: list[str] = []

    def checked(key: str, read: Callable[[], T], instead: T) -> T:
        """Return what `read` returns; if it fails, note the problem and return `instead`."""
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
        weathers=checked("weathers", lambda: _weathers(table.weathers or ("clear",)), ()),
        lights=checked("lights", lambda: _lights(table.lights), ()),
        faults=checked("faults", lambda: _faults(table.faults or ("clear",)), ()),
        boards={name: getattr(table, _field(name)) for name in boards},
    )
    if problems:
        raise ConfigError(problems)
    return suite


def _unique(values: Iterable[T]) -> tuple[T, ...]:
    """Drop repeated values."""
    return tuple(dict.fromkeys(values))


def _eligibility(table: SuiteTable) -> Eligibility:
    rule = table.eligibility
    return Eligibility(rule.range_m, rule.min_returns, _unique(rule.families))


def _weathers(names: Names) -> Names:
    """Return the full names, so that `fog` and `fog-3` are the same."""
    from roadscope.envs.sensors.weathers import weather

    return _unique(weather(name).name for name in names)


def _lights(names: Names) -> Names:
    from roadscope.envs.imaging.light import LIGHTS

    for name in names:
        if name not in LIGHTS:
            raise ValueError(unknown("light", name, LIGHTS))
    return _unique(names)


def _faults(texts: Names) -> tuple[Names, ...]:
    """Return one set of faults for each text, such as `night:2 + glare:1`; `clear` is none."""
    from roadscope.envs.sensors.faults import faults_of

    return _unique(tuple(map(str, faults_of(text))) for text in texts)


def _seeds(table: SuiteTable) -> tuple[int, ...]:
    if table.split not in SPLITS:
        raise ValueError(unknown("split", table.split, SPLITS))
    allowed, seeds = SPLITS[table.split], table.seeds
    if isinstance(seeds, int):
        if seeds > len(allowed):
            raise ValueError(f"split '{table.split}' has {len(allowed)} seeds, got {seeds}")
        seeds = tuple(allowed[: max(seeds, 0)])
    if not seeds or not all(seed in allowed for seed in seeds):
        raise ValueError(
            f"expected a number of seeds, or a list of seeds within {allowed.start} to "
            f"{allowed.stop - 1} "
            f"(split '{table.split}'), got {table.seeds!r}"
        )
    return _unique(seeds)
