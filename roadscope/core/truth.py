"""The ground truth of a frame. It travels beside frames and never reaches a plug-in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.pixel_truth import PixelTruth
from roadscope.core.pose import Pose
from roadscope.core.record import Record

GROUND = -1
"""Source of a return that came from the ground."""
WEATHER = 1 - 2**31
"""Source of a return that came from rain or fog; less than any number of scenery."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth(Record):
    """All road users but the ego at one instant, world frame.

    ids: (N,) int64.
    categories: (N,) int8, values of `Category`.
    centres: (N, 3) float64, metres, box centres.
    sizes: (N, 3) float64, metres, length width height.
    yaws: (N,) float64, radians.
    velocities: (N, 2) float64, m/s.
    lidar_returns: (N,) int64, returns of this tick's scan that came from the object.
    visible_pixels: (N,) int64, pixels of this tick's image that show the object.
    occluded_fraction: (N,) float64 in 0 to 1, share of the rays towards the object that hit
        something else before it; 1 if no ray of the sensor points at it. In recorded traffic,
        returns, pixels and this share are -1 where they are unknown.
    world_from_ego: pose of the ego at the stamp.
    stamp_s: seconds since reset.
    sources: (P,) int64, for each return of the scan the id of the object it came from,
        `GROUND`, `WEATHER`, or -2 and below for scenery.
    image_boxes: (N, 4) float64, pixels: left, top, right, bottom of the whole object in this
        tick's image, hidden parts included, cut at the image's edges. The box of an object outside
        the image has no extent. None without image.
    pixels: the truth of each pixel of this tick's image; None unless `pixel_truth` was asked for.
    """

    ids: np.ndarray
    categories: np.ndarray
    centres: np.ndarray
    sizes: np.ndarray
    yaws: np.ndarray
    velocities: np.ndarray
    lidar_returns: np.ndarray
    visible_pixels: np.ndarray
    occluded_fraction: np.ndarray
    world_from_ego: Pose
    stamp_s: float
    sources: np.ndarray
    image_boxes: np.ndarray | None = None
    pixels: PixelTruth | None = None

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            ids=(np.int64, ("N",)),
            categories=(np.int8, ("N",)),
            centres=(np.float64, ("N", 3)),
            sizes=(np.float64, ("N", 3)),
            yaws=(np.float64, ("N",)),
            velocities=(np.float64, ("N", 2)),
            lidar_returns=(np.int64, ("N",)),
            visible_pixels=(np.int64, ("N",)),
            occluded_fraction=(np.float64, ("N",)),
            sources=(np.int64, ("P",)),
            **({} if self.image_boxes is None else {"image_boxes": (np.float64, ("N", 4))}),
        )

    def __len__(self) -> int:
        return len(self.ids)
