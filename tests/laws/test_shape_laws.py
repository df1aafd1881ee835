"""What every shape promises of one cluster; one that is named in `SHAPES` is tested."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from law_scenes import DECIDED, LIMITED, MOUNT
from toy_lidar import scan

from roadscope.core import Bounds, Pose
from roadscope.detectors import Cloud, Horizon
from roadscope.detectors.shape import SHAPES, Cluster, clusters

TURNED = {
    # Headings a quarter degree apart are tried; which ones does not turn with the scene.
    "l-shape": (0.02, np.radians(0.3)),
    # One standard deviation of the size in the fit's posterior: the cost is as flat.
    "body": (0.3, np.radians(0.5)),
    # Bins begin at the mean of the returns, whose rounding turns with the scene.
    "matched-filter": (0.01, np.radians(0.2)),
}
MIXED = {"matched-filter": TURNED["matched-filter"]}
"""That rounding changes with the order of the sum, too."""
EXACT = (1e-6, 1e-6)
"""Metres and radians."""

every = pytest.mark.parametrize("name", SHAPES)
few = settings(max_examples=10, phases=[Phase.generate])
cars = st.integers(0, 2)


def sensed_car(pose=MOUNT, *, car=0, seed=0, side=1) -> tuple[Cluster, Horizon]:
    """Return one car's returns from a sensor at a pose, and what stands around."""
    taken = scan(DECIDED[car : car + 1], seed=seed, azimuths=LIMITED, noise_m=0.02, ground=False)
    cloud = Cloud.of(taken, pose)
    if side < 0:
        origin = cloud.origin * [1, -1]
        cloud = Cloud(cloud.points * [1, -1, 1], cloud.ring, -cloud.column, cloud.rows, origin)
    standing = np.ones(len(cloud), bool)
    (cluster,) = clusters(cloud, np.zeros(len(cloud), int))
    return cluster, Horizon.of(
        cloud, standing, Bounds(side * pose.yaw - 1.0, side * pose.yaw + 1.0)
    )


def assert_same(
    vehicles, expected, tolerance=EXACT, place=lambda centre: centre, yaw=lambda yaw: yaw
):
    """Compare vehicles to the expected ones, those brought elsewhere by `place` and `yaw`."""
    metres, radians = tolerance
    assert len(vehicles) == len(expected) > 0
    for here in expected:
        there = min(vehicles, key=lambda v: np.hypot(*(v.centre - place(np.array(here.centre)))))
        assert there.centre == pytest.approx(place(np.array(here.centre)), abs=metres)
        turned = (there.yaw - yaw(here.yaw) + np.pi / 2) % np.pi - np.pi / 2
        assert abs(turned) <= radians
        assert there.size == pytest.approx(here.size, abs=metres)
        assert there.category is here.category


@every
@few
@given(car=cars, seed=st.integers(0, 99), turn=st.floats(-3.1, 3.1), x=st.floats(-50, 50))
def test_rigid_motion_moves_the_vehicle(name, car, seed, turn, x):
    """Flanks are seen, so no shape has to guess which end of a body is its front."""
    motion = Pose.planar(x, -0.5 * x, turn)
    here, there = (
        SHAPES[name](*sensed_car(p, car=car, seed=seed)) for p in (MOUNT, motion @ MOUNT)
    )

    def place(centre):
        return motion.apply(np.append(centre, 0.0)[None])[0, :2]

    assert_same(there, here, TURNED.get(name, EXACT), place, lambda yaw: yaw + turn)


@every
@few
@given(car=cars, seed=st.integers(0, 99))
def test_left_and_right_are_alike(name, car, seed):
    here, there = (SHAPES[name](*sensed_car(car=car, seed=seed, side=side)) for side in (1, -1))
    assert_same(there, here, EXACT, lambda centre: centre * [1, -1], lambda yaw: -yaw)


@every
@few
@given(car=cars, seed=st.integers(0, 2**32 - 1))
def test_order_and_copies_of_returns_change_nothing(name, car, seed):
    cluster, around = sensed_car(car=car)
    rows = np.random.default_rng(seed).permutation(np.repeat(np.arange(len(cluster.points)), 2))
    of_returns = {name: getattr(cluster, name)[rows] for name in ("points", "ring", "column")}
    mixed = replace(cluster, **of_returns)
    here, there = (SHAPES[name](c, around) for c in (cluster, mixed))
    assert_same(there, here, MIXED.get(name, EXACT))


@every
@few
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 9), kind=st.sampled_from("alone"))
def test_any_few_returns_show_proper_vehicles_or_none(name, seed, count, kind):
    """Anywhere, on a line, on each other, in a column, around the sensor."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(7, 11, count), rng.uniform(-1, 3, count)])
    points[:, 1] = 1.0 + 0.3 * points[:, 0] if kind == "l" else points[:, 1]
    points = points[:1].repeat(count, axis=0) if kind == "o" else points
    points[:, 1] = 0.0 if kind == "n" else points[:, 1]
    points = points - points.mean(axis=0) if kind == "e" else points
    rows = np.arange(count)
    cloud = Cloud(
        np.column_stack([points, rng.uniform(0.2, 1.4, count)]), rows % 4, rows, rows, [0, 0]
    )
    (cluster,) = clusters(cloud, np.zeros(count, int))
    before = cluster.points.copy()
    for vehicle in SHAPES[name](cluster, Horizon.of(cloud, rows >= 0, Bounds(-1.0, 1.0))):
        assert np.isfinite((*vehicle.centre, *vehicle.size, vehicle.yaw, vehicle.fit)).all()
        assert min(vehicle.size) > 0
        assert vehicle.residual_m >= 0
    assert np.array_equal(cluster.points, before)


@every
def test_same_cluster_same_vehicles_to_the_bit(name):
    assert SHAPES[name](*sensed_car()) == SHAPES[name](*sensed_car())
