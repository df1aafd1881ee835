"""Lanes as polylines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class RoadMap(Record):
    """The lanes of a place, sampled along their centre lines, world frame.

    points: (P, 2) float64, metres, centre lines of all lanes one after the other, each in
        driving direction.
    widths: (P,) float64, metres, full width of the lane at the point.
    starts: (L + 1,) int64, lane i owns rows starts[i] to starts[i + 1].
    """

    points: np.ndarray
    widths: np.ndarray
    starts: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            points=(np.float64, ("P", 2)),
            widths=(np.float64, ("P",)),
            starts=(np.int64, ("L",)),
        )

    @staticmethod
    def from_lanes(lanes: list[tuple[np.ndarray, np.ndarray]]) -> RoadMap:
        """Join lanes given as (K, 2) points and (K,) widths."""
        lengths = [len(points) for points, _ in lanes]
        return RoadMap(
            np.concatenate([points for points, _ in lanes]) if lanes else np.empty((0, 2)),
            np.concatenate([widths for _, widths in lanes]) if lanes else np.empty(0),
            np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        )

    def lanes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return each lane's (K, 2) points and (K,) widths."""
        return [
            (self.points[a:b], self.widths[a:b])
            for a, b in zip(self.starts[:-1], self.starts[1:], strict=True)
        ]

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Name the arrays for a file."""
        return {"road_points": self.points, "road_widths": self.widths, "road_starts": self.starts}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray]) -> RoadMap:
        """Undo `to_arrays`."""
        return RoadMap(arrays["road_points"], arrays["road_widths"], arrays["road_starts"])
