"""A pair of limits."""

from typing import NamedTuple


class Bounds(NamedTuple):
    """The least and the greatest value of a quantity, or the first and the last instant."""

    low: float
    high: float
