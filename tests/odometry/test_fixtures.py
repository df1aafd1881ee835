"""Fixtures, which cannot be road users, and the speed from them."""

import numpy as np
import pytest
from toy_lidar import scan_of

from roadscope.benchmarks.formats import azimuth_steps, rings_of
from roadscope.odometry.inertial import (
    BeamTable,
    Ends,
    count_separate,
    gathered,
    joined,
    marked_fixtures,
    slim,
    speed_of,
    standing_speed_of,
)

COLUMNS = 1800
STEP_RAD = 2 * np.pi / COLUMNS
WIDE_M = 0.6


def is_slim(row):
    """Return which beams of one ring, as (COLUMNS,) ranges, hit the middle of a slim object."""
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


def test_a_half_hidden_object_is_not_slim():
    row = wall()
    row[100:160], row[160:166] = 6.0, 12.0
    assert not is_slim(row).any()


def test_a_missing_return_does_not_split_a_lorry():
    row = wall()
    row[100:160] = 12.0
    row[[104, 110]] = 0.0
    assert not is_slim(row).any()


@pytest.mark.parametrize("count", [0, 1, 40, 700])
def test_pairs_in_cells_equal_those_of_the_slow_twin(count):
    rng = np.random.default_rng(count)
    points, scans = np.round(rng.normal(0, 9, (count, 2)), 1), rng.integers(0, 6, count)
    ahead, speeds = rng.uniform(-0.1, 0.6, (count, 2)), np.array([-8.0, 0.0, 0.25, 30.0])
    expected = []
    for speed in speeds:
        scans_of_cells = {}
        for cell, scan in zip(
            np.floor((points + speed * ahead) / 0.4).tolist(), scans, strict=True
        ):
            scans_of_cells.setdefault(tuple(cell), set()).add(scan)
        expected.append(sum(len(each) * (len(each) - 1) // 2 for each in scans_of_cells.values()))
    assert gathered(points, ahead, scans, speeds, 0.4).tolist() == expected
    assert count < 700 or min(expected) > 0


def street(speed_m_s, posts, walking_m_s=0.0, wide_m=0.2):
    """Six scans of posts of (x, y, top above the ground) metres, on flat ground."""
    scans, rings = [], np.arange(16)
    up = np.tan(np.deg2rad(2.0 * rings - 15.0))
    for k in range(6):
        reach = np.full((16, COLUMNS), 0.0)
        reach[:7] = (1.9 / -up[:7])[:, None]
        for x, y, top_m in posts:
            x = x - 0.1 * k * (speed_m_s - walking_m_s)
            at_m, wide = np.hypot(x, y), wide_m / 2 / np.hypot(x, y) / STEP_RAD
            middle = np.arctan2(y, x) / STEP_RAD
            across = np.arange(np.ceil(middle - wide), np.floor(middle + wide) + 1).astype(int)
            hit = (up * at_m < top_m - 1.9) & (up * at_m > -1.9)
            reach[np.ix_(hit, across % COLUMNS)] = at_m
        column, ring = np.nonzero(reach.T)
        flat, angle = reach[ring, column], column * STEP_RAD
        points = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), flat * up[ring]])
        scans.append(scan_of(points, ring, column, 0.1 * k, "lidar"))
    return [Ends.of(scan) for scan in scans]


ROAD = [(x, y, 4.0) for x in (5, 17, 26, 41) for y in (-6, 7.3)]


@pytest.mark.parametrize("speed_m_s", [0.0, 9.0, 28.0])
def test_posts_lower_than_lorries_determine_the_speed(speed_m_s):
    sweep_ends = street(speed_m_s, ROAD)
    assert not any(each.tall.any() for each in sweep_ends)
    estimate = standing_speed_of(sweep_ends, 0.0)
    assert estimate.reliable
    assert estimate.ahead_m_s == pytest.approx(speed_m_s, abs=0.1)
    assert estimate.spread_m_s < 0.2


def test_the_fine_speed_is_the_least_squares_solution_of_all_pairs():
    """Beside the minimum of the sum over pairs on a fine grid of speeds."""
    rng = np.random.default_rng(0)
    scans = np.repeat(np.arange(5), 12)
    ahead = np.column_stack([0.1 * scans + 0.01 * rng.random(60), np.zeros(60)])
    things = 20 * rng.random((12, 2))
    points = np.tile(things, (5, 1)) - 14.0 * ahead + 0.03 * rng.standard_normal((60, 2))
    different_scans = scans[:, None] != scans
    turned, moved = points[:, None] - points, ahead[:, None] - ahead

    def cost(speed):
        off = turned + speed * moved
        return -np.exp(-0.5 * (off**2).sum(axis=2) / 0.1**2)[different_scans].sum()

    speeds = np.arange(13.5, 14.5, 0.001)
    best = speeds[np.argmin([cost(speed) for speed in speeds])]
    order = np.argsort(points[:, 1])
    estimate, weight = joined(points[order], ahead[order], scans[order], 14.2, 0.1)
    assert estimate == pytest.approx(best, abs=0.005)
    assert estimate == pytest.approx(14.0, abs=0.05)
    assert weight > 3
    different_scans = np.column_stack([points[:, 0] + 1000.0 * scans, points[:, 1]])[order]
    assert joined(different_scans, ahead[order], scans[order], 14.2, 0.1)[1] == 0


def test_people_are_not_fixtures():
    sweep_ends = street(9.0, [(x, y, 1.8) for x, y, _ in ROAD], walking_m_s=7.0)
    assert not any(each.slim.any() for each in sweep_ends)
    assert not standing_speed_of(sweep_ends, 0.0).reliable
    assert not speed_of(sweep_ends, 0.0).reliable


def test_an_object_as_wide_as_a_cab_is_not_a_fixture():
    assert not any(each.slim.any() for each in street(9.0, ROAD, wide_m=0.9))


def test_a_few_slim_objects_decide_nothing():
    """Beside the sensor a part of a lorry may look like a slim object."""
    assert not standing_speed_of(street(9.0, ROAD[:2]), 0.0).reliable


def test_slim_objects_are_counted_once():
    """Wherever they lie on a grid; a metre apart is one."""
    rng = np.random.default_rng(0)
    post = np.array([4.0, 6.0]) + 0.03 * rng.standard_normal((40, 2))
    assert count_separate(post, 2.0) == 1
    near, other, third = (
        post + np.array(offset) for offset in ((1.0, 0.0), (2.5, 0.0), (0.0, -9.0))
    )
    assert count_separate(np.vstack([post, near]), 2.0) == 1
    assert count_separate(np.vstack([post, other, third]), 2.0) == 3
    assert count_separate(np.empty((0, 2)), 2.0) == 0


def some(kind, count):
    """Ends of a scan: slim or tall ones, 5 m apart."""
    points = 5.0 * np.column_stack([np.arange(count), np.ones(count)])
    marks = {name: np.full(count, name == kind) for name in ("tall", "slim")}
    return Ends(points, np.zeros(count), np.full(count, kind == "tall"), **marks)


def both(tall, slim):
    one, other = some("tall", tall), some("slim", slim)
    names = "points", "times_s", "upright", "tall", "slim"
    return Ends(*(np.concatenate([getattr(one, n), getattr(other, n)]) for n in names))


@pytest.mark.parametrize(
    ("tall", "slim", "chosen"),
    [(7, 3, None), (8, 3, 8), (7, 4, 4), (8, 4, 12), (8, 9, 17), (40, 10, 10), (0, 10, 10)],
)
def test_slim_objects_decide_alone_where_there_are_many(tall, slim, chosen):
    fixtures = marked_fixtures([both(tall, slim)] * 3)
    assert (fixtures and [int(each.sum()) for each in fixtures]) == (chosen and [chosen] * 3)


def lorry(columns, low=0.5, high=3.9, open_rad=2 * np.pi):
    """A side 12 m long, 5 m to the left, on flat ground, in 16 beams; read without columns."""
    up = np.tan(np.deg2rad(2.0 * np.arange(16) - 15.0))
    angle = (np.arange(columns) + 0.5) * open_rad / columns - open_rad / 2
    angle, up = (a.ravel() for a in np.meshgrid(angle, up))
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = np.where(up < 0, -1.9 / up, np.inf)
        side = np.where(np.sin(angle) > 0, 5.0 / np.sin(angle), np.inf)
    height = 1.9 + side * up
    on_lorry = (np.abs(side * np.cos(angle)) < 6) & (low < height) & (height < high) & (side < flat)
    flat = np.where(on_lorry, side, flat)
    in_range = flat < 80
    flat, angle, up = flat[in_range], angle[in_range], up[in_range]
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle), flat * up])


def read(points):
    return scan_of(points, rings_of(points), azimuth_steps(points), 0.0, "lidar")


@pytest.mark.parametrize("columns", [400, 512, 720, 900, 1024, 1800, 2048])
def test_no_step_of_a_sensor_makes_fixtures_of_a_lorry(columns):
    """Columns of scans that are read from files may be finer than the sensor's own steps."""
    sweep_ends = Ends.of(read(lorry(columns)))
    assert not sweep_ends.slim.any()
    assert not sweep_ends.tall.any()


@pytest.mark.parametrize("columns", [512, 900, 1800])
def test_a_post_is_a_fixture_at_any_step(columns):
    points = lorry(columns, low=9.0)
    angle = np.arctan2(points[:, 1], points[:, 0])
    up = points[:, 2] / np.hypot(points[:, 0], points[:, 1])
    post = (np.abs(angle - 0.5) < 0.02) & (9.0 * up > -1.9)
    flat = np.hypot(points[:, 0], points[:, 1])
    points[post] *= (9.0 / flat[post])[:, None]
    above = np.tan(np.deg2rad([1.0, 3.0, 5.0, 7.0]))
    beams = np.unique(angle[post])
    top = np.array([[9 * np.cos(a), 9 * np.sin(a), 9 * u] for a in beams for u in above])
    assert Ends.of(read(np.vstack([points, top]))).slim_objects == 1


def test_the_edge_of_a_narrow_field_is_no_end():
    """A wall goes on beyond it; the last column is not beside the first."""
    columns = 440
    angle = np.deg2rad(110) * ((np.arange(columns) + 0.5) / columns - 0.5)
    up = np.tan(np.deg2rad([-6.0, -4.0, 8.0, 10.0]))
    ring, column = (a.ravel() for a in np.meshgrid(np.arange(4), np.arange(columns)))
    flat = np.where(ring < 2, 1.9 / np.abs(up[ring]), 20.0 / np.cos(angle[column]))
    points = np.column_stack(
        [flat * np.cos(angle[column]), flat * np.sin(angle[column]), flat * up[ring]]
    )
    table = BeamTable.of(points, ring, column)
    assert not table.closed
    assert table.step_rad == pytest.approx(np.deg2rad(0.25), rel=0.01)
    assert not table.ends().any()
    post = np.abs(angle[column] - 0.3) < np.deg2rad(0.6)
    points[post & (ring > 1)] *= 0.5
    assert (table := BeamTable.of(points, ring, column)).slim(points[:, 2] > 0.2, 0.6).sum() == 2
    assert table.ends().sum() > 0


def test_of_two_returns_in_one_cell_the_nearer_counts():
    row = np.array([[12.0, 0.0, 1.0], [50.0, 0.0, 4.0]])
    table = BeamTable.of(row, np.zeros(2, int), np.zeros(2, int))
    assert table.first.tolist() == [True, False]
    assert table.reach[0, 0] == pytest.approx(np.hypot(12, 1))


def test_without_visible_ground_nothing_counts_as_tall():
    """A sensor near the ground, whose beams meet it far off, among cars."""
    points = lorry(1800)
    high = points[points[:, 2] > -1.0] * [6.0, 6.0, 1.0]
    sweep_ends = Ends.of(read(high))
    assert sweep_ends.upright.any()
    assert not sweep_ends.tall.any()
    assert not sweep_ends.slim.any()
