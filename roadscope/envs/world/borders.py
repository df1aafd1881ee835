"""Outer borders of a road, and distances of things from its lanes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from roadscope.core.record import Record
from roadscope.core.tables import ArrayTable
from roadscope.envs.traffic.road_maps import RoadMap

SITE_M = 4.0
"""Length of the pieces into which borders are cut; guard rail posts stand 4 m apart."""
SAMPLE_M = 1.0
"""Spacing of centre line samples; a distance of 2 m is overestimated by at most 6 cm."""
SLACK_M = 0.3
"""A border is inner if another lane's centre is nearer than half its width plus this."""


@dataclass(frozen=True, slots=True, eq=False)
class Sites(ArrayTable, Record):
    """Pieces of lane borders, world frame.

    starts, ends: (S, 2) float64, metres, end points of the piece.
    start_normals, end_normals: (S, 2) float64, unit vectors away from the lane.
    slots: (S,) int64, number of the piece along its border.
    lanes: (S,) int64, lane and side: 2 i for the left of lane i, 2 i + 1 for its right.
    """

    starts: np.ndarray
    ends: np.ndarray
    start_normals: np.ndarray
    end_normals: np.ndarray
    slots: np.ndarray
    lanes: np.ndarray

    def __len__(self) -> int:
        return len(self.slots)

    @property
    def middles(self) -> np.ndarray:
        """(S, 2) middle of each piece."""
        result: np.ndarray = (self.starts + self.ends) / 2
        return result

    @property
    def normals(self) -> np.ndarray:
        """(S, 2) unit vector away from the lane at the middle."""
        mean = self.start_normals + self.end_normals
        result: np.ndarray = mean / np.linalg.norm(mean, axis=1, keepdims=True)
        return result

    @property
    def yaws(self) -> np.ndarray:
        """(S,) direction of the border with the outside to the right, radians."""
        normals = self.normals
        result: np.ndarray = np.arctan2(normals[:, 0], -normals[:, 1])
        return result

    @property
    def straight(self) -> np.ndarray:
        """(S,) bool, whether the piece turns by less than about 2 degrees: a radius above 100 m."""
        result: np.ndarray = (self.start_normals * self.end_normals).sum(axis=1) > np.cos(0.04)
        return result


class LaneDistances:
    """Distances to the nearest lanes of a road."""

    def __init__(self, road: RoadMap) -> None:
        """Sample all centre lines, about a metre apart."""
        from scipy.spatial import cKDTree

        lanes = [(i, *lane) for i, lane in enumerate(road.lanes()) if len(lane[0])]
        samples = [_along(points, widths, SAMPLE_M) for _, points, widths in lanes]
        none = np.empty((0, 2))
        self.points = np.concatenate([none, *(points for points, _, _ in samples)])
        self.half_widths = np.concatenate([none[:, 0], *(w / 2 for _, w, _ in samples)])
        numbers = np.array([i for i, _, _ in lanes], np.int64)
        self.lanes = np.repeat(numbers, [len(points) for points, _, _ in samples])
        self.widest_m = float(self.half_widths.max(initial=0.0))
        self._tree: Any = cKDTree(self.points)

    def outer(self, sites: Sites) -> np.ndarray:
        """Return (S,) whether no other lane's centre lies within half a lane of the middle."""
        if len(sites) == 0:
            return np.zeros(0, bool)
        reach = self.widest_m + SLACK_M
        distances, rows = self._tree.query(sites.middles, k=12, distance_upper_bound=reach)
        in_reach = np.isfinite(distances)
        rows = np.where(in_reach, rows, 0)
        other = self.lanes[rows] != (sites.lanes // 2)[:, None]
        near = in_reach & (distances <= self.half_widths[rows] + SLACK_M)
        # A lane that closes on itself may have its own far end nearer than the border.
        crossed = in_reach & (distances < self.half_widths[rows] - SLACK_M)
        result: np.ndarray = ~((near & other) | crossed).any(axis=1)
        return result

    def within(self, sites: Sites, depth_m: float) -> np.ndarray:
        """Return (S,) whether the middle lies at least that deep inside some other lane."""
        near = self._tree.query_ball_point(sites.middles, self.widest_m)
        counts = np.array([len(rows) for rows in near], np.int64)
        rows = np.concatenate([np.empty(0, np.int64), *(np.asarray(r, np.int64) for r in near)])
        sides = np.repeat(np.arange(len(sites)), counts)
        away = np.linalg.norm(self.points[rows] - sites.middles[sides], axis=1)
        deep = away < self.half_widths[rows] - depth_m
        deep &= self.lanes[rows] != sites.lanes[sides] // 2
        return np.bincount(sides[deep], minlength=len(sites)) > 0

    def clearances(self, outlines: np.ndarray, within_m: np.ndarray | float) -> np.ndarray:
        """Return (M,) distances of (M, K, 2) convex outlines from the nearest lane's edge, metres.

        Negative where an outline is on a lane. within_m: a number or (M,), the result where every
        lane is farther than that.
        """
        centres = outlines.mean(axis=1)
        radii = np.linalg.norm(outlines - centres[:, None], axis=2).max(axis=1)
        reach_m = np.maximum(radii + self.widest_m + within_m, 0.0)
        near = self._tree.query_ball_point(centres, reach_m)
        counts = np.array([len(rows) for rows in near], np.int64)
        result = np.broadcast_to(np.asarray(within_m, np.float64), len(outlines)).copy()
        if counts.sum() == 0:
            return result
        rows = np.concatenate([np.asarray(r, np.int64) for r in near])
        owner = np.repeat(np.arange(len(outlines)), counts)
        gaps = distances_to(outlines[owner], self.points[rows]) - self.half_widths[rows]
        np.minimum.at(result, owner, gaps)
        return result


def distances_to(outlines: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return (N,) distances of points from convex outlines, metres; 0 inside.

    outlines: (N, K, 2), counter-clockwise. points: (N, 2).
    """
    sides = np.roll(outlines, -1, axis=1) - outlines
    arms = points[:, None] - outlines
    squares = np.maximum((sides**2).sum(axis=2), 1e-18)
    t = np.clip((arms * sides).sum(axis=2) / squares, 0.0, 1.0)
    gaps = np.linalg.norm(arms - t[..., None] * sides, axis=2).min(axis=1)
    inside = (sides[..., 0] * arms[..., 1] - sides[..., 1] * arms[..., 0] >= 0).all(axis=1)
    return np.where(inside, 0.0, gaps)


def border_sites(road: RoadMap) -> Sites:
    """Return both borders of all lanes in pieces of about four metres."""
    parts = [
        _sites(points, widths, 2 * lane + side)
        for lane, (points, widths) in enumerate(road.lanes())
        for side in (0, 1)
        if len(points) and np.ptp(points, axis=0).max() > 0
    ]
    none = np.empty((0, 2)), np.empty(0, np.int64)
    empty = Sites(none[0], none[0], none[0], none[0], none[1], none[1])
    return Sites(
        *(np.concatenate([getattr(p, n) for p in [empty, *parts]]) for n in Sites.__slots__)
    )


def without_duplicates(sites: Sites) -> np.ndarray:
    """Return (S,), false where a border of lower number runs through the same place."""
    from scipy.spatial import cKDTree

    keep = np.ones(len(sites), bool)
    if len(sites) < 2:
        return keep
    pairs = cKDTree(sites.middles).query_pairs(SITE_M / 2, output_type="ndarray")
    first, second = pairs[:, 0], pairs[:, 1]
    lanes, normals = sites.lanes, sites.normals
    same = (lanes[first] != lanes[second]) & ((normals[first] * normals[second]).sum(1) > 0.5)
    later = np.where(lanes[first] > lanes[second], first, second)
    keep[later[same]] = False
    return keep


def _along(
    points: np.ndarray, widths: np.ndarray, step_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return even samples of a lane: (K, 2) points, (K,) widths, (K, 2) left unit normals."""
    arc_lengths = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    )
    length = arc_lengths[-1]
    at = np.linspace(0.0, length, max(1, round(length / step_m)) + 1)

    def xy(s: np.ndarray) -> np.ndarray:
        return np.stack(
            [np.interp(s, arc_lengths, points[:, 0]), np.interp(s, arc_lengths, points[:, 1])], 1
        )

    ahead = xy(np.minimum(at + 0.5, length)) - xy(np.maximum(at - 0.5, 0.0))
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    normals = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    return xy(at), np.interp(at, arc_lengths, widths), normals


def _sites(points: np.ndarray, widths: np.ndarray, lane: int) -> Sites:
    centres, wide, normals = _along(points, widths, SITE_M)
    normals = -normals if lane % 2 else normals
    edges = centres + normals * wide[:, None] / 2
    count = len(edges) - 1
    return Sites(
        edges[:-1], edges[1:], normals[:-1], normals[1:], np.arange(count), np.full(count, lane)
    )
