"""The detections of one update, in the frame and the order in which trackers take them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Detections, Pose


@dataclass(frozen=True, slots=True, eq=False)
class TrackerTick:
    """The input of one update.

    detections: in the world frame if the ego pose is known, otherwise in the frame in which they
        came; sorted by content, so that no result depends on the order in which they came.
    period_s: seconds since the last tick, 0 at the first.
    world_from_ego: the ego pose, or None.
    ego_velocity: (2,) m/s in the world frame, or None until two poses are known.
    """

    detections: Detections
    period_s: float
    world_from_ego: Pose | None
    ego_velocity: np.ndarray | None

    @property
    def stamp_s(self) -> float:
        """Seconds since reset."""
        return self.detections.stamp_s

    @property
    def frame(self) -> str:
        """The frame of detections and tracks: `world` or `ego`."""
        return self.detections.frame

    @property
    def sensor_position(self) -> np.ndarray:
        """(3,) from where detections are seen, in their frame: the ego's origin."""
        return np.zeros(3) if self.world_from_ego is None else self.world_from_ego.translation

    @staticmethod
    def after(
        last: TrackerTick | None, detections: Detections, world_from_ego: Pose | None
    ) -> TrackerTick:
        """Return the tick that follows on another, or the first one.

        Raises `ValueError` if stamps do not increase, if the pose is given at some updates only, or
        if the frame of the detections changes.
        """
        detections = in_order(in_world(detections, world_from_ego))
        if not np.isfinite(detections.stamp_s):
            raise ValueError(f"stamps must be finite, got {detections.stamp_s} s")
        if last is None:
            return TrackerTick(detections, 0.0, world_from_ego, None)
        if (world_from_ego is None) != (last.world_from_ego is None):
            raise ValueError("the ego pose must be given at every update or at none")
        if detections.frame != last.frame:
            raise ValueError(
                "without the ego pose all detections must come in one frame: "
                f"'{detections.frame}' after '{last.frame}'"
            )
        period_s = detections.stamp_s - last.stamp_s
        if not period_s > 0:
            raise ValueError(f"stamps must increase: {detections.stamp_s} s after {last.stamp_s} s")
        velocity = None
        if world_from_ego is not None and last.world_from_ego is not None:
            moved = world_from_ego.translation - last.world_from_ego.translation
            velocity = moved[:2] / period_s
        return TrackerTick(detections, period_s, world_from_ego, velocity)


def in_world(detections: Detections, world_from_ego: Pose | None) -> Detections:
    """Return detections in the world frame if the pose is known, otherwise unchanged."""
    if world_from_ego is None or detections.frame == "world":
        return detections
    return detections.moved(world_from_ego, "world")


def in_order(detections: Detections) -> Detections:
    """Return detections sorted by content, x first."""
    xs = detections.centres[:, 0]
    order = np.argsort(xs)
    if not (np.diff(xs[order]) > 0).all():
        keys = [detections.scores, detections.categories, detections.yaws, *detections.sizes.T]
        order = np.lexsort([*keys, *detections.centres.T[::-1]])
    return detections.select(order)
