"""Cars parked beside the road. They are scenery: a detection of one is neither right nor wrong."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from roadscope.benchmarks.episode import Episode, timeline_of, traffic_of
from roadscope.benchmarks.metrics.image_labels import ParkedBoxes
from roadscope.core import GROUND, Pose, Truth
from roadscope.core.projection import Projection

if TYPE_CHECKING:
    from roadscope.envs.traffic.timeline import Timeline
    from roadscope.envs.world.prisms import Prisms
    from roadscope.envs.world.world import World

PARKED_RANGE_M = 150.0
"""Parked cars farther from the ego have no box in the image."""
LEAST_SIDE_PX = 2.0
"""Boxes with a shorter side are left out."""
BEHIND_M = 0.3
"""Least depth of corners: those beside or behind the camera are projected with this depth."""


def parked_owners(truth: Truth) -> set[int]:
    """Return the numbers (`Truth.sources`) of the parked cars that gave returns to a scan."""
    owners = np.unique(truth.sources[truth.sources < GROUND])
    return set(owners[_are_parked_cars(owners)].tolist())


def parked_centres(episode: Episode, owners: Iterable[int]) -> np.ndarray:
    """Return (P, 2) box centres of parked cars, metres, world frame. owners: their numbers."""
    numbers = sorted(owners)
    return _centres_of(_last_scenery(traffic_of(episode)), numbers) if numbers else np.empty((0, 2))


def parked_centres_on(timeline: Timeline, seed: int, owners: Iterable[int]) -> np.ndarray:
    """Return `parked_centres` along the drive of a timeline. seed: of the world."""
    numbers = sorted(owners)
    return _centres_of(_scenery_along(timeline, seed), numbers) if numbers else np.empty((0, 2))


@lru_cache(maxsize=1)
def _last_scenery(traffic: Episode) -> Prisms:
    """Return the scenery of an episode; a worker's next job is often on the same episode."""
    return _scenery_along(timeline_of(traffic), traffic.seed)


def _scenery_along(timeline: Timeline, seed: int) -> Prisms:
    from roadscope.envs.sensors.sensing import world_of

    return world_of(timeline, seed).scenery.along(timeline.axles[:, 0])


def _centres_of(scenery: Prisms, owners: Iterable[int]) -> np.ndarray:
    outlines = (scenery.footprints[scenery.owners == owner].reshape(-1, 2) for owner in owners)
    # A body's outline is point symmetric, so this is its centre at any yaw.
    return np.array([(o.min(axis=0) + o.max(axis=0)) / 2 for o in outlines])


def parked_among(episode: Episode, truths: Iterable[Truth]) -> np.ndarray:
    """Return (P, 2) centres, metres, world frame, of parked cars with returns in any scan."""
    return parked_centres(episode, set().union(*map(parked_owners, truths)))


def parked_boxes(world: World, world_from_ego: Pose, projection: Projection) -> ParkedBoxes:
    """Return the boxes of parked cars in the image, hidden ones too."""
    position = world_from_ego.translation[:2]
    scenery = world.scenery.around(position, PARKED_RANGE_M)
    cars = np.flatnonzero(_are_parked_cars(scenery.owners))
    if not len(cars):
        return ParkedBoxes(np.empty((0, 4)), np.empty(0))
    footprints, owners = scenery.footprints[cars], scenery.owners[cars]
    heights = np.stack([scenery.bottoms[cars], scenery.tops[cars]], axis=1)
    levels = np.broadcast_to(heights[:, :, None, None], (*heights.shape, footprints.shape[1], 1))
    flat = np.broadcast_to(footprints[:, None], (*levels.shape[:3], 2))
    points = world_from_ego.inverse().apply(np.concatenate([flat, levels], -1).reshape(-1, 3))
    ranges = np.hypot(*(footprints.mean(axis=1) - position).T)
    return _bounds(points.reshape(len(cars), -1, 3), owners, ranges, projection)


def _bounds(
    points: np.ndarray, owners: np.ndarray, ranges: np.ndarray, projection: Projection
) -> ParkedBoxes:
    """Return the boxes in the image around (M, Q, 3) points, ego frame, of each owner, (M,)."""
    # Corners beside or behind the camera lie far outside the image, on their side of it.
    homogeneous = points @ projection.matrix[:, :3].T + projection.matrix[:, 3]
    depths = homogeneous[..., 2:]
    pixels = homogeneous[..., :2] / np.maximum(depths, BEHIND_M)
    limits = np.array([projection.width, projection.height], float)
    boxes, ranges_m = [], []
    for owner in np.unique(owners):
        mine = owners == owner
        if depths[mine].max() <= BEHIND_M:
            continue
        low = np.clip(pixels[mine].min(axis=(0, 1)), 0, limits)
        high = np.clip(pixels[mine].max(axis=(0, 1)), 0, limits)
        if ((high - low) >= LEAST_SIDE_PX).all():
            boxes.append(np.concatenate([low, high]))
            ranges_m.append(ranges[mine].mean())
    return ParkedBoxes(np.array(boxes).reshape(-1, 4), np.array(ranges_m))


def _are_parked_cars(owners: np.ndarray) -> np.ndarray:
    from roadscope.envs.world.roadside import KINDS, kinds_of

    parked: np.ndarray = kinds_of(owners) == list(KINDS).index("parked_cars")
    return parked
