"""A score: a figure with its unit, its direction and what pooling needs."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal

Better = Literal["higher", "lower"]


@dataclass(frozen=True, slots=True)
class Score:
    """A figure of one episode.

    value: the figure; nan where nothing could be measured.
    unit: `1` for ratios, otherwise a unit or what is counted.
    better: which direction is better.
    n: number of samples behind the value.
    least, most: limits of possible values, for intervals.
    weight: weight of the episode when episodes are pooled: what the value was divided by.
    power: 2 for root mean squares: pooled is the mean of this power, then its root is taken.
    """

    value: float
    unit: str
    better: Better
    n: int
    least: float = 0.0
    most: float = math.inf
    weight: float = 1.0
    power: int = 1

    def to_json(self) -> dict[str, Any]:
        """Return a dictionary that JSON can hold: nan and infinity become None."""
        named = ((name, getattr(self, name)) for name in self.__slots__)
        return {k: None if _unbounded(v) else v for k, v in named}

    @staticmethod
    def from_json(named: dict[str, Any]) -> Score:
        """Undo `to_json`."""
        missing: dict[str, Any] = {"value": math.nan, "least": -math.inf, "most": math.inf}
        return Score(**{k: missing[k] if v is None else v for k, v in named.items()})


class ScoreFamily:
    """Base of frozen dataclasses whose fields are all scores."""

    __slots__ = ()
    __dataclass_fields__: ClassVar[dict[str, Any]]

    def named(self) -> dict[str, Score]:
        """Return the scores by name, in order."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def ratio(part: float, whole: float, better: Better = "higher") -> Score:
    """Return part / whole, 0 to 1, of a number of samples; nan without samples."""
    value = part / whole if whole else math.nan
    return Score(value, "1", better, int(whole), 0.0, 1.0, weight=whole)


def mean(total: float, n: int, unit: str, better: Better = "lower") -> Score:
    """Return total / n; nan without samples."""
    return Score(total / n if n else math.nan, unit, better, n, weight=n)


def averaged(value: float, n: int, least: float = 0.0) -> Score:
    """Return a figure over n samples, at most 1 and best there; nan without samples.

    least: its least possible value.
    """
    return Score(value if n else math.nan, "1", "higher", n, least, 1.0, weight=n)


def signed_mean(total: float, n: int) -> Score:
    """Return total / n of values in -1 to 1, best at 0; nan without samples."""
    return Score(total / n if n else math.nan, "1", "lower", n, -1.0, 1.0, weight=n)


def rms(squares: float, n: int, unit: str) -> Score:
    """Return sqrt(squares / n), lower is better; nan without samples."""
    value = math.sqrt(squares / n) if n else math.nan
    return Score(value, unit, "lower", n, weight=n, power=2)


def _unbounded(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)
