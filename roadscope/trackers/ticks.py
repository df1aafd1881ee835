"""What one update brings, put into the frame and the order in which targets are followed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Detections, Pose


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """The detections of one update.

    targets: in the world frame when the ego's pose is known, otherwise as they came; sorted by
        content, so that nothing depends on the order in which they came.
    period_s: since the last tick; 0 at the first.
    world_from_ego: the ego's pose, or None.
    ego_velocity: (2,) m/s in the world frame, or None until two poses are known.
    """

    targets: Detections
    period_s: float
    world_from_ego: Pose | None
    ego_velocity: np.ndarray | None

    @property
    def stamp_s(self) -> float:
        """Seconds since reset."""
        return self.targets.stamp_s

    @property
    def frame(self) -> str:
        """Where targets are followed: `world` or `ego`."""
        return self.targets.frame

    @staticmethod
    def after(last: Tick | None, detections: Detections, world_from_ego: Pose | None) -> Tick:
        """Take the detections of an update that follows on another, or on none.

        Raises `ValueError` when stamps do not increase, or when the pose or the frame changes
        from known to unknown.
        """
        targets = in_order(in_world(detections, world_from_ego))
        if not np.isfinite(targets.stamp_s):
            raise ValueError(f"stamps must be finite, got {targets.stamp_s} s")
        if last is None:
            return Tick(targets, 0.0, world_from_ego, None)
        if (world_from_ego is None) != (last.world_from_ego is None):
            raise ValueError("the ego pose must be given at every update or at none")
        if targets.frame != last.frame:
            raise ValueError(
                f"without the ego pose all detections must come in one frame: '{targets.frame}' "
                f"after '{last.frame}'"
            )
        period_s = targets.stamp_s - last.stamp_s
        if not period_s > 0:
            raise ValueError(f"stamps must increase: {targets.stamp_s} s after {last.stamp_s} s")
        velocity = None
        if world_from_ego is not None and last.world_from_ego is not None:
            moved = world_from_ego.translation - last.world_from_ego.translation
            velocity = moved[:2] / period_s
        return Tick(targets, period_s, world_from_ego, velocity)


def in_world(detections: Detections, world_from_ego: Pose | None) -> Detections:
    """Return detections in the world frame if the pose is known, otherwise as they are."""
    if world_from_ego is None or detections.frame == "world":
        return detections
    return detections.moved(world_from_ego, "world")


def in_order(detections: Detections) -> Detections:
    """Sort detections by content, x first."""
    along = detections.centres[:, 0]
    order = np.argsort(along)
    if not (np.diff(along[order]) > 0).all():
        keys = [detections.scores, detections.categories, detections.yaws, *detections.sizes.T]
        order = np.lexsort([*keys, *detections.centres.T[::-1]])
    return detections.select(order)
