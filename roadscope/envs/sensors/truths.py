"""What was really there when a sweep or an image was taken, as records."""

from __future__ import annotations

from typing import Any

import numpy as np

from roadscope.core import GROUND, SKY, PixelTruth, Truth
from roadscope.core.pixel_truth import GROUND_CLASS, SCENERY_CLASS, SKY_CLASS
from roadscope.envs.sensors.camera import ImageTruth
from roadscope.envs.sensors.lidar import SweepTruth
from roadscope.envs.traffic.timeline import Timeline


def truth_at(timeline: Timeline, stamp_s: float, seen: SweepTruth) -> Truth:
    """Join what is known of the road users at the stamp with what the sweep saw of them."""
    sources = seen.owners.astype(np.int64)
    sources[sources >= 0] = timeline.ids[sources[sources >= 0]]
    rows, known = _known(timeline, stamp_s)
    return Truth(
        **known,
        lidar_returns=seen.returns[rows],
        visible_pixels=np.zeros(len(rows), np.int64),
        occluded_fraction=seen.occluded_fraction[rows],
        sources=sources,
    )


def truth_of_image(timeline: Timeline, stamp_s: float, seen: ImageTruth) -> Truth:
    """Join what is known of the road users at the stamp with what the image shows of them."""
    rows, known = _known(timeline, stamp_s)
    return Truth(
        **known,
        lidar_returns=np.zeros(len(rows), np.int64),
        visible_pixels=seen.visible_pixels[rows],
        occluded_fraction=seen.occluded_fraction[rows],
        sources=np.empty(0, np.int64),
        image_boxes=seen.boxes[rows],
    )


def pixel_truth_of(timeline: Timeline, stamp_s: float, seen: ImageTruth) -> PixelTruth:
    """Name actors in an image by their ids and say what they are."""
    owners = seen.owners
    actors = owners >= 0
    instances = owners.astype(np.int64)
    instances[actors] = timeline.ids[owners[actors]]
    categories = np.full(owners.shape, SCENERY_CLASS, np.int8)
    categories[owners == GROUND] = GROUND_CLASS
    categories[owners == SKY] = SKY_CLASS
    categories[actors] = timeline.categories[owners[actors]]
    return PixelTruth(seen.depth, instances, categories, stamp_s)


def _known(timeline: Timeline, stamp_s: float) -> tuple[np.ndarray, dict[str, Any]]:
    """Rows of the road users that are there but for the ego, and their states."""
    around = timeline.at(np.array([stamp_s - 1e-3, stamp_s, stamp_s + 1e-3]))
    centres = around.axles + timeline.centre_ahead_m[:, None] * directions(around.yaws)
    rows = np.flatnonzero(around.present[1])
    rows = rows[rows > 0]
    heights = timeline.sizes[rows, 2]
    return rows, {
        "ids": timeline.ids[rows],
        "categories": timeline.categories[rows],
        "centres": np.column_stack([centres[1, rows], heights / 2]),
        "sizes": timeline.sizes[rows],
        "yaws": around.yaws[1, rows],
        "velocities": (centres[2, rows] - centres[0, rows]) / 2e-3,
        "world_from_ego": timeline.world_from_ego(stamp_s),
        "stamp_s": stamp_s,
    }


def directions(yaws: np.ndarray) -> np.ndarray:
    """Return unit vectors (..., 2) of headings in radians."""
    return np.stack([np.cos(yaws), np.sin(yaws)], axis=-1)
