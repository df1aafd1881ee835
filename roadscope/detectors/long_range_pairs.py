"""The matched filter of three frames inside a detector."""

from __future__ import annotations

from collections.abc import Sequence

from roadscope.detectors.moving.links import Chain
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.pose.matched_filter import fit_multi

FRAMES = 3
BIN_M, STEP_DEG = 0.04, 2.0
"""Bins as wide as the filter's edges, and a parabola finds the angle between two steps. Those of
the paper, half as wide, are no nearer and take twice as long."""


def pair_poses(
    moving: Sequence[tuple[Chain, int]], sizes: Sequence[tuple[float, float]], most: int
) -> list[VehiclePose]:
    """Return what `fit_multi` says of each vehicle in its sightings around one of them.

    moving: chains, and which sighting of each is answered. sizes: length and width of each, metres.
    most: returns of a sighting that are looked at, evenly chosen.
    """
    return [_pose(chain, at, size, most) for (chain, at), size in zip(moving, sizes, strict=True)]


def _pose(chain: Chain, at: int, size: tuple[float, float], most: int) -> VehiclePose:
    first = max(0, min(at - 1, len(chain.sightings) - FRAMES))
    window = chain.sightings[first : first + FRAMES]
    return fit_multi(
        [sighting.at_stamp(chain.velocity, most=most) for sighting in window],
        [sighting.origin for sighting in window],
        [sighting.stamp_s for sighting in window],
        length_m=size[0],
        width_m=size[1],
        at=at - first,
        bin_m=BIN_M,
        step_deg=STEP_DEG,
    )
