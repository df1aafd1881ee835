import numpy as np
import pytest
from shapely import MultiPoint, Polygon, affinity, box
from tracked_scenes import boxes, identities, make, run

from roadscope.core import Pose
from roadscope.trackers import birds_eye_pairs, ego_view_pairs


def cars(seed, n=6, spread=8.0):
    rng = np.random.default_rng(seed)
    places = np.column_stack([rng.uniform(5, 5 + spread, (n, 2)), rng.uniform(0.5, 1.0, n)])
    return np.column_stack([places, rng.uniform(1, 5, (n, 3)), rng.uniform(-4, 4, n)])


def from_above(row):
    x, y, _, length, width, _, yaw = row
    flat = box(-length / 2, -width / 2, length / 2, width / 2)
    return affinity.translate(affinity.rotate(flat, yaw, (0, 0), use_radians=True), x, y)


def ro_gdiou(one, other):
    """As the paper prints it, by shapely."""
    a, b = from_above(one), from_above(other)
    corners = np.array([*a.exterior.coords[:4], *b.exterior.coords[:4]])
    C, U = MultiPoint(corners).convex_hull.area, a.union(b).area
    d = max(np.linalg.norm(p - q) for p in corners for q in corners)
    c = np.linalg.norm(one[:2] - other[:2])
    return a.intersection(b).area / U - (C - U) / C - (c / d) ** 2


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("least", [-0.4, 0.2])
def test_the_overlap_in_birds_eye_view_is_the_papers(seed, least):
    ones, twos = cars(seed), cars(seed + 100, 5)
    near = birds_eye_pairs(ones, twos, least)
    overlaps = dict(zip(zip(near.rows, near.columns, strict=True), 1 - near.costs, strict=True))
    expected = {
        (i, j): share
        for i, one in enumerate(ones)
        for j, other in enumerate(twos)
        if (share := ro_gdiou(one, other)) > least
    }
    assert overlaps == pytest.approx(expected, abs=1e-9)


def view(row, eye):
    """Azimuth and elevation of a box's corners, where no azimuth is near half a turn."""
    flat = np.array(from_above(row).exterior.coords[:4]) - eye[:2]
    tops = row[2] - eye[2] + np.array([-0.5, 0.5]) * row[5]
    angles = [(np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))) for x, y in flat for z in tops]
    return Polygon(box(*np.min(angles, axis=0), *np.max(angles, axis=0)))


def diou(one, other):
    around = np.array(MultiPoint([*one.exterior.coords, *other.exterior.coords]).bounds)
    distance_m = one.centroid.distance(other.centroid)
    diagonal = np.hypot(*(around[2:] - around[:2]))
    return one.intersection(other).area / one.union(other).area - (distance_m / diagonal) ** 2


@pytest.mark.parametrize("seed", range(2))
def test_the_overlap_in_the_ego_view_is_that_of_angles(seed):
    eye = np.array([-3.0, 1.0, 1.2])
    ones, twos = cars(seed), cars(seed + 100, 5)
    near = ego_view_pairs(ones, twos, eye, -0.3)
    overlaps = dict(zip(zip(near.rows, near.columns, strict=True), 1 - near.costs, strict=True))
    expected = {
        (i, j): share
        for i, one in enumerate(ones)
        for j, other in enumerate(twos)
        if (share := diou(view(one, eye), view(other, eye))) > -0.3
    }
    assert overlaps == pytest.approx(expected, abs=1e-9)
    behind = Pose.planar(0.0, 0.0, 2.9)
    turned = [
        np.column_stack([behind.apply(b[:, :3]), b[:, 3:6], b[:, 6] + 2.9]) for b in (ones, twos)
    ]
    again = ego_view_pairs(*turned, behind.apply(eye[None])[0], -0.3)
    assert again.costs == pytest.approx(near.costs)


def test_the_second_view_assigns_detections_of_wrong_depth():
    """Seen at the same place of the image, but 8 m behind where it was expected."""
    episode = [boxes([(30 + 8 * (k > 5), 0)], k) for k in range(9)]
    assert len(identities(run(make("mctrack"), episode))) == 2
    assert len(identities(run(make("mctrack", least_again=-0.3), episode))) == 1


def test_a_braking_target_is_expected_where_it_stops():
    """From 20 m/s to rest in 4 s, unseen for 0.6 s: it is 20 cm, not 1 m, off."""
    stamps = 0.1 * np.arange(26)
    places = 20 * stamps - 2.5 * stamps**2
    episode = [boxes([(x, 0)] if k < 20 else [], k) for k, x in enumerate(places)]
    last = run(make("mctrack"), episode)[-1]
    straight = places[19] + 0.6 * (20 - 5 * 1.9)
    assert abs(last.centres[0, 0] - places[-1]) < 0.4
    assert abs(straight - places[-1]) > 0.8


def test_low_scores_and_doubles_are_ignored():
    tracks = run(
        make("mctrack"), [boxes([(5, 0), (5.5, 0), (20, 0)], k, [0.9, 0.8, 0.4]) for k in range(4)]
    )
    assert len(identities(tracks)) == 1
