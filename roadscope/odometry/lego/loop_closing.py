"""Places where a drive comes back, and what the poses on the way become then.

T. Shan and B. Englot, "LeGO-LOAM", IROS 2018, section III-E: candidates lie near, ICP checks
them, and a pose graph takes the constraint in. They use iSAM2; here all is solved anew, seldom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from roadscope.odometry.lego.keyframes import Keyframe, KeyframeMap
from roadscope.odometry.lego.point_icp import onto, overlap
from roadscope.odometry.lego.pose_graph import Link, settled
from roadscope.odometry.loam.progress import misfit_of
from roadscope.odometry.rigid import inverse

NEAR_M = 15.0
"""Candidates lie nearer than this."""
DRIVEN_M = 50.0
"""So far was driven since at least: what is just behind is in the map anyway."""
AGAIN_M = 10.0
"""So far from the last loop the next is looked for."""
BESIDE = 10
"""So many keyframes either way make the map of a candidate's place."""
RESIDUAL_M = 0.2
AGREED, WITHIN_M = 0.5, 0.3
"""Least share of edges that lie so near to one of that map."""
DRIFTED = 0.05
"""Nobody drifts by more than this share of the way since. Without such a bound corridors, which
look alike farther on, close loops wherever they fit."""
STEP_SPREAD = np.array([0.05] * 3 + [0.005] * 3)
LOOP_SPREAD = np.array([0.05] * 3 + [0.005] * 3)
"""What is thought of a motion from keyframe to keyframe, and of one that closes a loop."""


class LoopClosing:
    """Remembers links between keyframes and finds further ones where a drive comes back."""

    def __init__(self) -> None:
        self.links: list[Link] = []
        self.closed = 0
        self._last_m = -np.inf

    def add(self, keyframes: Sequence[Keyframe]) -> None:
        """Link the last keyframe with the one before it."""
        if len(keyframes) > 1:
            last = len(keyframes) - 1
            self.links.append(_link(keyframes, last - 1, last, STEP_SPREAD))

    def closed_by(self, keyframes: Sequence[Keyframe]) -> list[Keyframe] | None:
        """Return all keyframes at their new places if the last one closes a loop."""
        last = len(keyframes) - 1
        if keyframes[last].driven_m - self._last_m < AGAIN_M:
            return None
        candidate = nearest_candidate(keyframes)
        if candidate is None:
            return None
        self._last_m = keyframes[last].driven_m
        there = place_again(keyframes, candidate)
        if there is None:
            return None
        motion = inverse(keyframes[candidate].map_from_lidar) @ there
        self.links.append(Link(candidate, last, motion, LOOP_SPREAD))
        self.closed += 1
        poses = settled(np.array([each.map_from_lidar for each in keyframes]), self.links)
        return [replace(k, map_from_lidar=p) for k, p in zip(keyframes, poses, strict=True)]


def nearest_candidate(keyframes: Sequence[Keyframe]) -> int | None:
    """Return the number of the nearest keyframe to the last one that is an earlier visit's."""
    last = keyframes[-1]
    earlier = [k for k in keyframes if last.driven_m - k.driven_m > DRIVEN_M]
    if not earlier:
        return None
    away_m = np.linalg.norm([k.place - last.place for k in earlier], axis=1)
    nearest = int(np.argmin(away_m))
    return nearest if away_m[nearest] < NEAR_M else None


def place_again(keyframes: Sequence[Keyframe], candidate: int) -> np.ndarray | None:
    """Return where the last keyframe is, (4, 4), by the map about an earlier one, if it fits."""
    beside = keyframes[max(candidate - BESIDE, 0) : candidate + BESIDE + 1]
    last, there = keyframes[-1], KeyframeMap(beside)
    if not len(there.edges) or not len(last.edges):
        return None
    # Edges, few and distinct, tell roughly; lines and planes then finely.
    rough = onto(last.edges, there.edges.points, last.map_from_lidar, NEAR_M)
    found = there.match(last, rough)
    if misfit_of(found) or found.residual_m > RESIDUAL_M:
        return None
    moved_m = np.linalg.norm(found.before_from_now[:3, 3] - last.place)
    if moved_m > DRIFTED * (last.driven_m - keyframes[candidate].driven_m):
        return None
    seen_again = overlap(last.edges, there.edges.points, found.before_from_now, WITHIN_M)
    return found.before_from_now if seen_again > AGREED else None


def _link(keyframes: Sequence[Keyframe], first: int, second: int, spread: np.ndarray) -> Link:
    a, b = keyframes[first].map_from_lidar, keyframes[second].map_from_lidar
    return Link(first, second, inverse(a) @ b, spread)
