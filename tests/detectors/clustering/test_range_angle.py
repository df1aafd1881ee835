import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_lidar import cloud

from roadscope.core import wrap_angle
from roadscope.detectors import Cloud
from roadscope.detectors.clustering import (
    SPACINGS,
    TURN_ERROR,
    cluster_range_angle,
    quick_azimuth,
    spacing,
)

STEP = 0.02
ANGLE = np.radians(5.0)


def random_cloud(seed, count=70):
    """Bodies at several ranges all around, beams and columns 0.02 rad apart."""
    rng = np.random.default_rng(seed)
    ring, column = rng.integers(0, 6, count), np.sort(rng.integers(0, 314, count))
    reach = 2.0 + 3 * (column // 60) + 0.05 * rng.standard_normal(count)
    azimuth = np.pi - STEP * column
    x, y, z = reach * np.cos(azimuth), reach * np.sin(azimuth), reach * STEP * ring
    return Cloud(np.column_stack([x, y, z]), ring, column, np.arange(count), np.zeros(2))


def grown_as_printed(returns, eps_m, min_points, angle=ANGLE):
    """Steps 1 to 3 of section 2.1: a seed, then the farthest in six directions, then the rest."""
    limit = eps_m + SPACINGS * spacing(returns) * np.minimum.outer(returns.ranges, returns.ranges)
    gaps = np.linalg.norm(returns.points[:, None] - returns.points, axis=-1)
    turns = np.abs(wrap_angle(np.subtract.outer(returns.azimuths, returns.azimuths)))
    linked = (gaps <= limit) & (turns <= angle)
    free, labels, count = np.ones(len(returns), bool), np.full(len(returns), -1), 0
    for seed in range(len(returns)):
        if not free[seed]:
            continue
        members, pending = [seed], [seed]
        free[seed] = False
        while pending:
            middle = pending.pop(0)
            new = np.flatnonzero(linked[middle] & free)
            free[new] = False
            members += new.tolist()
            if len(new):
                offsets = returns.points[new] - returns.points[middle]
                six = new[np.concatenate([offsets.argmax(axis=0), offsets.argmin(axis=0)])]
                pending = [*six.tolist(), *pending]
            if not pending:
                pending = [m for m in members if (linked[m] & free).any()]
        if len(members) >= min_points:
            labels[members] = count
            count += 1
    return labels


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.02, 0.3, 2.0]), st.integers(1, 9))
def test_equals_growth_as_printed(seed, eps_m, min_points):
    returns = random_cloud(seed)
    labels = cluster_range_angle(returns, eps_m=eps_m, min_points=min_points)
    assert np.array_equal(labels, grown_as_printed(returns, eps_m, min_points))


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.02, 0.1, 0.3]))
def test_equals_growth_as_printed_in_a_thicket(seed, eps_m):
    """Many returns of one cell and one ring, some of which are linked."""
    rng = np.random.default_rng(seed)
    ring, column = rng.integers(0, 5, 150), np.sort(rng.integers(0, 60, 150))
    reach, azimuth = 4.0 + 0.3 * rng.standard_normal(150), 0.3 - STEP * column / 4
    height = reach * STEP * ring + 0.3 * rng.standard_normal(150)
    places = np.column_stack([reach * np.cos(azimuth), reach * np.sin(azimuth), height])
    returns = Cloud(places, ring, column, np.arange(150), np.zeros(2))
    labels = cluster_range_angle(returns, eps_m=eps_m, min_points=1)
    assert np.array_equal(labels, grown_as_printed(returns, eps_m, 1))


@pytest.mark.parametrize("angle_deg", [0.5, 60.0, 100.0, 170.0])
@given(seed=st.integers(0, 2**32 - 1))
def test_any_angle(angle_deg, seed):
    returns = random_cloud(seed)
    labels = cluster_range_angle(returns, eps_m=6.0, angle_deg=angle_deg, min_points=3)
    expected = grown_as_printed(returns, 6.0, 3, np.radians(angle_deg))
    assert np.array_equal(labels, expected)


def test_two_alone_are_linked_within_any_angle():
    """Here the limit itself reaches farther round than a quarter of a turn."""
    angle_rad = np.radians(128.0)
    places = 0.25 * np.array([[1.0, 0.0, 0.0], [np.cos(angle_rad), np.sin(angle_rad), 0.0]])
    none = np.zeros(2, int)
    returns = Cloud(places, none, np.arange(2), np.arange(2), np.zeros(2))
    for angle_deg, together in ((120.0, False), (130.0, True), (360.0, True)):
        labels = cluster_range_angle(returns, eps_m=0.5, angle_deg=angle_deg, min_points=1)
        assert (labels[0] == labels[1]) == together


def test_the_quick_azimuth_is_off_by_less_than_sectors_allow():
    turns = np.concatenate([np.linspace(-np.pi, np.pi, 4001), np.arange(-4, 5) * np.pi / 4])
    quick = [quick_azimuth(2.0 * np.cos(a), 2.0 * np.sin(a)) for a in turns]
    assert np.abs(wrap_angle(np.array(quick) - turns)).max() < TURN_ERROR
    assert quick_azimuth(0.0, 0.0) == 0.0


def test_a_wall_is_one_cluster_wherever_it_goes():
    returns = cloud([(14, 0, 1.0, 20.0, 1.5, 0)], ground=False)
    assert np.ptp(np.degrees(returns.azimuths)) > 5.0
    assert set(cluster_range_angle(returns)) == {0}


def test_spacing_is_the_wider_of_beams_and_columns():
    car = [(15, 0, 4.6, 1.85, 1.5, 0)]
    returns = cloud(car, ground=False)
    assert np.degrees(spacing(returns)) == pytest.approx(0.8, rel=0.01)
    wide = np.radians(np.arange(-20, 20, 1.0))
    assert np.degrees(spacing(cloud(car, ground=False, azimuths=wide))) == pytest.approx(1.0)
    assert spacing(returns.select(np.arange(1))) == 0.0


def test_distant_bodies_are_separate_and_few_points_are_outliers():
    cars = [(14, 0, 4.6, 1.85, 1.5, 0), (14, 6, 4.6, 1.85, 1.5, 0), (60, -9, 4.6, 1.85, 1.5, 0)]
    returns = cloud(cars, ground=False)
    labels = cluster_range_angle(returns)
    near, left = np.abs(returns.points[:, 1]) < 1.5, returns.points[:, 1] > 4
    assert set(labels[near]) == {0}
    assert set(labels[left]) == {1}
    assert set(labels[returns.points[:, 1] < -5]) == {-1}


def test_printed_distance_links_no_two_beams():
    """Literally 2 cm: on a VLP-16, beams are farther apart from 0.6 m on."""
    returns = cloud([(14, 0, 4.6, 1.85, 1.5, 0)], ground=False)
    gaps = np.linalg.norm(returns.points[:, None] - returns.points, axis=-1)
    assert gaps[returns.ring[:, None] != returns.ring].min() > 0.02


@pytest.mark.parametrize("name", ["eps_m", "angle_deg", "min_points"])
def test_bad_options_are_named(name):
    with pytest.raises(ValueError, match=f"{name} must be positive and finite, got -1"):
        cluster_range_angle(cloud([]), **{name: -1})
