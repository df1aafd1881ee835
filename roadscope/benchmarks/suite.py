"""A suite: its episodes, which objects are eligible, and the entries of each board."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, TypeVar

from msgspec import Meta, Struct, structs

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.core.config import ConfigError
from roadscope.core.names import unknown

S = TypeVar("S", bound="BoardSettings")

Names = tuple[str, ...]
SomeNames = Annotated[Names, Meta(min_length=1)]
Positive = Annotated[float, Meta(gt=0, le=sys.float_info.max)]
"""A finite number above 0, of seconds or metres."""

SPLITS: Mapping[str, range] = {
    "train": range(0, 10_000),
    "validation": range(10_000, 20_000),
    "test": range(20_000, 30_000),
}
"""Seeds of each split; nothing is tuned on test seeds."""


class SuiteError(ValueError):
    """A suite cannot be read, or has unknown names or wrong values; `problems` has them all."""

    def __init__(self, text: str, problems: Iterable[str] = ()) -> None:
        """Take the whole text. problems: one text for each; left out, the whole text is one."""
        super().__init__(text)
        self.problems = tuple(problems) or (text,)


class BoardSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A suite's settings of one board: the table `[BOARD]` of its file.

    Boards add fields of their own in a subclass; each has a default. Repeated names in a list
    count once.

    entries: specs that every run compares.
    """

    entries: Names = ()

    def __post_init__(self) -> None:
        """Drop repeated names from lists."""
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if isinstance(value, tuple):
                structs.force_setattr(self, name, tuple(dict.fromkeys(value)))


@dataclass(frozen=True, slots=True)
class Suite:
    """The episodes and settings of a benchmark.

    scenarios: names of `roadscope.envs.traffic.scenarios.SCENARIOS`.
    seeds: of the episodes of each scenario.
    rig: a name of `roadscope.envs.sensors.rigs.RIGS` or a path to a TOML file.
    duration_s: length of an episode; None: that of its scenario.
    weathers: names of `roadscope.envs.sensors.weathers.WEATHERS`; every episode is sensed in each.
    lights: names of `roadscope.envs.imaging.light.LIGHTS`; every episode is sensed in each, those
        after the first only in the first weather.
    faults: sets of faults of `roadscope.envs.sensors.faults.FAULTS`; likewise. Fog and rain are
        faults too, so a suite has weathers or faults, not both.
    boards: the settings of each board, by the board's name.
    recorded: whether episodes are recorded sequences of a folder; then nothing is simulated.
    """

    name: str
    version: int
    summary: str
    scenarios: tuple[str, ...]
    seeds: tuple[int, ...]
    rig: str
    duration_s: float | None = None
    eligibility: Eligibility = field(default_factory=Eligibility)
    weathers: tuple[str, ...] = ("clear",)
    lights: tuple[str, ...] = ("day",)
    faults: tuple[tuple[str, ...], ...] = ((),)
    boards: Mapping[str, BoardSettings] = field(default_factory=dict)
    recorded: bool = False

    @property
    def title(self) -> str:
        """Name and version."""
        return f"{self.name} v{self.version}"

    @property
    def summary_with_seeds(self) -> str:
        """The summary and the number of seeds; sequences take their place in recorded data."""
        if self.recorded:
            return self.summary
        seeds = f"{len(self.seeds)} seed{'s' * (len(self.seeds) > 1)}"
        return f"{self.summary}, {seeds}" if self.summary else seeds

    def settings(self, board: str, kind: type[S]) -> S:
        """Return the settings of a board, whose class is `kind`; its defaults if there are none."""
        settings = self.boards.get(board, kind())
        assert isinstance(settings, kind), f"{board}: {type(settings)} is no {kind}"
        return settings

    def with_settings(self, board: str, **changes: Any) -> Suite:
        """Return the suite with some settings of a board changed."""
        settings = structs.replace(self.boards[board], **changes)
        return replace(self, boards={**self.boards, board: settings})


def check_names(suite: Suite) -> None:
    """Raise an error for unknown scenarios or rigs, and for episodes shorter than one sweep.

    The error names all unknown scenarios.
    """
    from roadscope.benchmarks.episode import Episode, check_episode
    from roadscope.envs.sensors.rigs import rig
    from roadscope.envs.traffic.scenarios import SCENARIOS

    problems = [
        unknown("scenario", name, SCENARIOS) for name in suite.scenarios if name not in SCENARIOS
    ]
    try:
        rig(suite.rig)
    except ValueError as error:
        problems.append(str(error))
    if problems:
        raise SuiteError(str(ConfigError(problems)), problems)
    for name in suite.scenarios:
        for light in suite.lights:
            check_episode(Episode(name, suite.seeds[0], suite.rig, suite.duration_s, light=light))
    first = Episode(suite.scenarios[0], suite.seeds[0], suite.rig, light=suite.lights[0])
    for faults in suite.faults:
        check_episode(replace(first, faults=faults))
