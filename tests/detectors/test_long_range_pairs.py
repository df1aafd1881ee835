"""All vehicles of a scan at once get the poses that each gets alone."""

import numpy as np
import pytest

from roadscope.core import Pose
from roadscope.detectors.long_range_pairs import BIN_M, FRAMES, STEP_DEG, pair_poses
from roadscope.detectors.moving.extraction import Candidate
from roadscope.detectors.moving.links import Chain, Sighting
from roadscope.detectors.pose.multi_frame import fit_multi

MOST = 30


def followed(rng, sightings, speed):
    """A chain of the rear and a flank of a car that drives ahead or towards the sensor."""
    chain, yaw = Chain(), rng.uniform(-1, 1)
    way = speed * np.array([np.cos(yaw), np.sin(yaw)])
    place = np.array([25.0, rng.uniform(-8, 8)])
    for k in range(sightings):
        count = int(rng.integers(12, 90))
        along, across = rng.uniform(-2.2, 2.2, count), rng.uniform(-0.9, 0.9, count)
        rear = rng.random(count) < 0.5
        local = np.column_stack([np.where(rear, -2.2, along), np.where(rear, across, 0.9)])
        turned = local @ np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        times_s = np.sort(rng.uniform(-0.04, 0.04, count))
        met = place + way * (0.1 * k + times_s[:, None]) + turned
        points = np.column_stack([met, rng.uniform(0.3, 1.4, count)])
        candidate = Candidate(
            points, np.arange(count), times_s, float(np.median(times_s)), np.zeros(2),
            np.array([*place, yaw]), 5.0,
        )  # fmt: skip
        chain.add(Sighting.of(candidate, 0.1 * k, Pose.identity()))
    return chain


@pytest.mark.parametrize("seed", range(5))
def test_vehicles_at_once_are_vehicles_one_by_one(seed):
    rng = np.random.default_rng(seed)
    chains = [followed(rng, n, v) for n, v in ((2, 8.0), (3, -9.0), (6, 12.0), (6, 0.4))]
    moving = [(chain, int(rng.integers(len(chain.sightings)))) for chain in chains]
    sizes = [(4.4, 1.82), (4.4, 1.82), (7.4, 2.4), (5.1, 1.9)]
    for (chain, at), (length, width), found in zip(
        moving, sizes, pair_poses(moving, sizes, MOST), strict=True
    ):
        first = max(0, min(at - 1, len(chain.sightings) - FRAMES))
        window = chain.sightings[first : first + FRAMES]
        alone = fit_multi(
            [s.at_stamp(chain.velocity, most=MOST) for s in window], [s.origin for s in window],
            [s.stamp_s for s in window], length_m=length, width_m=width, at=at - first,
            bin_m=BIN_M, step_deg=STEP_DEG,
        )  # fmt: skip
        one, other = (np.array([p.x, p.y, p.yaw, p.score]) for p in (found, alone))
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)
        assert (found.length, found.width) == (length, width)


def test_no_vehicle_has_no_pose():
    assert pair_poses([], [], MOST) == []
