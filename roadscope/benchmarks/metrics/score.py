"""One figure with what is needed to read it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar, Literal

Better = Literal["higher", "lower"]


@dataclass(frozen=True, slots=True)
class Score:
    """A figure of merit of one episode.

    value: the figure; NaN where nothing could be measured.
    unit: `1` for ratios, otherwise a unit or what is counted.
    better: which direction is better.
    n: number of samples behind the value.
    least, most: bounds of what the value can be, for intervals.
    weight: what the value was divided by; episodes are pooled with it.
    power: values are averaged as this power and its root is taken: 2 for RMS errors.
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
        """Return a dictionary that JSON can hold: NaN and infinity become None."""
        named = asdict(self)
        return {k: None if _unbounded(v) else v for k, v in named.items()}

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
    """Return a share between 0 and 1 of a whole number of samples."""
    value = part / whole if whole else math.nan
    return Score(value, "1", better, int(whole), 0.0, 1.0, weight=whole)


def mean(total: float, n: int, unit: str, better: Better = "lower") -> Score:
    """Return a total divided by its number of samples."""
    return Score(total / n if n else math.nan, unit, better, n, weight=n)


def signed_mean(total: float, n: int) -> Score:
    """Return a mean of values in -1 to 1 that is best at zero."""
    return Score(total / n if n else math.nan, "1", "lower", n, -1.0, 1.0, weight=n)


def rms(squares: float, n: int, unit: str) -> Score:
    """Return the root of a mean of squares, lower is better."""
    value = math.sqrt(squares / n) if n else math.nan
    return Score(value, unit, "lower", n, weight=n, power=2)


def _unbounded(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)
