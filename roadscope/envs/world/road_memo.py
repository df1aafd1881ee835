"""A cache of results that depend on a road alone, one for each process."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from hashlib import sha256
from typing import TypeVar

from roadscope.envs.traffic.road_maps import RoadMap

T = TypeVar("T")
CACHED_ROADS = 16
"""Number of cached results; the least recently used one is dropped first."""


def cached_per_road(function: Callable[[RoadMap], T]) -> Callable[[RoadMap], T]:
    """Return the function with a cache of its results for roads of the same content."""

    @lru_cache(maxsize=CACHED_ROADS)
    def cached(key: _Key) -> T:
        return function(key.road)

    @wraps(function)
    def call(road: RoadMap) -> T:
        return cached(_Key(road))

    return call


class _Key:
    """A road that is hashed and compared by its content."""

    def __init__(self, road: RoadMap) -> None:
        digest = sha256()
        for array in (road.points, road.widths, road.starts):
            digest.update(array.tobytes())
        self.road = road
        self._digest = digest.digest()

    def __hash__(self) -> int:
        return int.from_bytes(self._digest[:8], "little")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self._digest == other._digest
