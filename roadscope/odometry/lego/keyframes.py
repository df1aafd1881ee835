"""Sets of features that a map is made of, each with where it was taken (Shan and Englot 2018)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from roadscope.odometry.cloud_kernels import placed, thinned
from roadscope.odometry.lego.point_map import PointMap
from roadscope.odometry.loam.feature_match import FeatureMatch, settle
from roadscope.odometry.loam.features import Features

EDGES_M, PLANES_M = 0.2, 0.4
"""No two edges, and no two planes, of a map are nearer to each other."""
MATCHED_M = 0.8
"""Planes that are matched lie in cubes of this size of their own: there are many."""
LOOKS = 8
ANYWHERE = (0.0, np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """Edges (E, 3) and planes (P, 3) of a scan, metres, lidar frame, and its place.

    map_from_lidar: (4, 4). few: rows of planes that are matched with maps. driven_m: way so far.
    """

    edges: np.ndarray
    planes: np.ndarray
    few: np.ndarray
    map_from_lidar: np.ndarray
    driven_m: float

    @property
    def place(self) -> np.ndarray:
        """(3,) metres, in the map's frame."""
        return self.map_from_lidar[:3, 3]


def keyframe(features: Features, map_from_lidar: np.ndarray, driven_m: float) -> Keyframe:
    """Return a scan's features as a keyframe, thinned."""
    edges = features.edges[thinned(features.edges, EDGES_M, ANYWHERE)]
    planes = features.planes[thinned(features.planes, PLANES_M, ANYWHERE)]
    few = thinned(planes, MATCHED_M, ANYWHERE)
    return Keyframe(edges, planes, few, map_from_lidar, driven_m)


class KeyframeMap:
    """Edges and planes of keyframes, together."""

    def __init__(self, keyframes: Iterable[Keyframe] = ()) -> None:
        self.edges, self.planes = PointMap(thin_m=EDGES_M), PointMap(thin_m=PLANES_M)
        for each in keyframes:
            self.add(each)

    def add(self, taken: Keyframe) -> None:
        """Add a keyframe's features."""
        self.edges.add(placed(taken.edges, taken.map_from_lidar))
        self.planes.add(placed(taken.planes, taken.map_from_lidar))

    def match(self, taken: Keyframe, start: np.ndarray) -> FeatureMatch:
        """Return where lines and planes put a keyframe; start: (4, 4) `map_from_lidar`."""
        planes = taken.planes[taken.few]
        looks = [
            lambda pose: self.edges.lines(taken.edges, pose),
            lambda pose: self.planes.planes(planes, pose),
        ]
        return settle(looks, start, most=LOOKS)
