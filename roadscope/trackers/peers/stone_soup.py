"""Trackers of Stone Soup's parts: global nearest neighbour and joint probabilistic association."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from roadscope.core import Detections, Pose, Requirement, Tracks
from roadscope.trackers.gating import chi_square_gate
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.peers.adapter import Adapter
from roadscope.trackers.peers.stone_soup_parts import Filter, Likeliest, Nearest, Noise, StoneSoup
from roadscope.trackers.settings import check_positive, check_shares

STONE_SOUP = Requirement("stonesoup", "pip install roadscope[peers]")


class StoneSoupGnnTracker:
    """Stone Soup's `GNNWith2DAssignment` by Mahalanobis distance, with its Kalman filter."""

    requires: ClassVar = STONE_SOUP

    def __init__(
        self,
        *,
        gate_share: float = 0.997,
        confirm_hits: int = 3,
        coast_frames: int = 10,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up.

        gate_share: share of right pairs that the gate lets through, if the noise is as said.
        confirm_hits, coast_frames: see `LifeCycle`; Stone Soup leaves it to the user.
        shown_misses: see `Adapter`.
        position_m, speed_m_s, velocity_walk: see `Noise`.
        """
        if not 0 < gate_share < 1:
            raise ValueError(f"gate_share must lie between 0 and 1, got {gate_share!r}")
        noise = Noise(position_m, speed_m_s, velocity_walk)
        life = LifeCycle(confirm_hits, coast_frames)
        gate = float(np.sqrt(chi_square_gate(gate_share, 2)))
        self._adapter = Adapter(
            lambda family: StoneSoup(Nearest(Filter(noise, family), gate), life), shown_misses
        )

    def reset(self) -> None:
        """Forget all tracks."""
        self._adapter.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        return self._adapter.update(detections, ego_pose)


class StoneSoupJpdaTracker:
    """Stone Soup's `JPDAwithEHM2` (Horridge 2006): exact marginals, the fastest of its exact ones.

    How tracks begin and end Stone Soup leaves to the user. Here a detection that belongs to none
    more likely than not opens one, and a track is seen when some detection is likelier than none.
    """

    requires: ClassVar = STONE_SOUP

    def __init__(
        self,
        *,
        gate_share: float = 0.997,
        detection: float = 0.9,
        clutter_m2: float = 1e-4,
        confirm_hits: int = 3,
        coast_frames: int = 10,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up.

        gate_share: share of right pairs that the gate lets through, if the noise is as said.
        detection: probability that a target is detected.
        clutter_m2: false detections for each square metre.
        confirm_hits, coast_frames: see `LifeCycle`.
        shown_misses: see `Adapter`.
        position_m, speed_m_s, velocity_walk: see `Noise`.
        """
        if not 0 < gate_share < 1:
            raise ValueError(f"gate_share must lie between 0 and 1, got {gate_share!r}")
        check_shares(detection=detection)
        check_positive(clutter_m2=clutter_m2)
        noise = Noise(position_m, speed_m_s, velocity_walk)
        life = LifeCycle(confirm_hits, coast_frames)
        shares = {"prob_detect": detection, "prob_gate": gate_share}
        self._adapter = Adapter(
            lambda family: StoneSoup(
                Likeliest(Filter(noise, family), clutter_spatial_density=clutter_m2, **shares),
                life,
            ),
            shown_misses,
        )

    def reset(self) -> None:
        """Forget all tracks."""
        self._adapter.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        return self._adapter.update(detections, ego_pose)
