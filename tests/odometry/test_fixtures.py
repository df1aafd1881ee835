"""What no road user can be, and the speed that it tells."""

import numpy as np
import pytest

from roadscope.core import LidarScan
from roadscope.odometry.inertial.edge_kernels import slim
from roadscope.odometry.inertial.speed_kernels import joined
from roadscope.odometry.inertial.speed_search import Ends, speed_of, standing_speed_of

COLUMNS = 1800
STEP_RAD = 2 * np.pi / COLUMNS
WIDE_M = 0.6


def is_slim(row):
    """Return which beams of one ring, as (COLUMNS,) ranges, met the middle of something slim."""
    column = np.arange(COLUMNS)
    return slim(row[None], np.zeros(COLUMNS, np.int64), column, row > 0, True, WIDE_M / STEP_RAD)


def wall(reach_m=50.0):
    return np.full(COLUMNS, reach_m)


def columns_of(width_m, range_m):
    return round(width_m / range_m / STEP_RAD)


@pytest.mark.parametrize("behind_m", [50.0, 0.0])
@pytest.mark.parametrize(("width_m", "expected"), [(0.2, True), (0.5, True), (0.8, False)])
def test_width_decides(width_m, expected, behind_m):
    row = wall(behind_m)
    across = np.arange(columns_of(width_m, 12.0)) - 3
    row[across] = 12.0
    middle = int(across[len(across) // 2]) % COLUMNS
    assert np.flatnonzero(is_slim(row)).tolist() == ([middle] if expected else [])


def test_what_is_half_hidden_is_not_slim():
    row = wall()
    row[100:160], row[160:166] = 6.0, 12.0
    assert not is_slim(row).any()


def test_a_beam_without_an_answer_does_not_part_a_lorry():
    row = wall()
    row[100:160] = 12.0
    row[[104, 110]] = 0.0
    assert not is_slim(row).any()


def street(speed_m_s, posts, walking_m_s=0.0):
    """Six scans of posts, 0.2 m wide, of (x, y, top above the ground) metres, on flat ground."""
    scans, rings = [], np.arange(16)
    up = np.tan(np.deg2rad(2.0 * rings - 15.0))
    for k in range(6):
        reach = np.full((16, COLUMNS), 0.0)
        reach[:7] = (1.9 / -up[:7])[:, None]
        for x, y, top_m in posts:
            x = x - 0.1 * k * (speed_m_s - walking_m_s)
            at_m, wide = np.hypot(x, y), 0.1 / np.hypot(x, y) / STEP_RAD
            middle = np.arctan2(y, x) / STEP_RAD
            across = np.arange(np.ceil(middle - wide), np.floor(middle + wide) + 1).astype(int)
            hit = (up * at_m < top_m - 1.9) & (up * at_m > -1.9)
            reach[np.ix_(hit, across % COLUMNS)] = at_m
        column, ring = np.nonzero(reach.T)
        flat, angle, n = reach[ring, column], column * STEP_RAD, len(ring)
        points = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), flat * up[ring]])
        scans.append(LidarScan(points.astype(np.float32), np.full(n, 0.5), ring, column,
                               np.zeros(n), 0.1 * k, "lidar"))  # fmt: skip
    return [Ends.of(scan) for scan in scans]


ROAD = [(x, y, 4.0) for x in (5, 17, 26, 41) for y in (-6, 7.3)]


@pytest.mark.parametrize("speed_m_s", [0.0, 9.0, 28.0])
def test_posts_lower_than_lorries_tell_the_speed(speed_m_s):
    seen = street(speed_m_s, ROAD)
    assert not any(each.tall.any() for each in seen)
    found = standing_speed_of(seen, 0.0)
    assert found.known
    assert found.ahead_m_s == pytest.approx(speed_m_s, abs=0.1)
    assert found.spread_m_s < 0.2


def test_points_are_joined_where_all_of_their_pairs_say():
    """Beside the minimum of the sum over pairs on a fine grid of speeds."""
    rng = np.random.default_rng(0)
    scans = np.repeat(np.arange(5), 12)
    ahead = np.column_stack([0.1 * scans + 0.01 * rng.random(60), np.zeros(60)])
    things = 20 * rng.random((12, 2))
    points = np.tile(things, (5, 1)) - 14.0 * ahead + 0.03 * rng.standard_normal((60, 2))
    apart = scans[:, None] != scans
    turned, moved = points[:, None] - points, ahead[:, None] - ahead

    def cost(speed):
        off = turned + speed * moved
        return -np.exp(-0.5 * (off**2).sum(axis=2) / 0.1**2)[apart].sum()

    speeds = np.arange(13.5, 14.5, 0.001)
    best = speeds[np.argmin([cost(speed) for speed in speeds])]
    order = np.argsort(points[:, 1])
    found, weight = joined(points[order], ahead[order], scans[order], 14.2, 0.1)
    assert found == pytest.approx(best, abs=0.005)
    assert found == pytest.approx(14.0, abs=0.05)
    assert weight > 3
    assert joined(points + 1000.0 * scans[:, None], ahead, scans, 14.2, 0.1)[1] == 0


def test_people_are_no_posts():
    seen = street(9.0, [(x, y, 1.8) for x, y, _ in ROAD], walking_m_s=7.0)
    assert not any(each.slim.any() for each in seen)
    assert not standing_speed_of(seen, 0.0).known
    assert not speed_of(seen, 0.0).known


def test_a_few_slim_things_decide_nothing():
    """Beside the sensor a piece of a lorry may be seen by itself."""
    assert not standing_speed_of(street(9.0, ROAD[:2]), 0.0).known
