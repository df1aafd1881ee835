import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_lidar import cloud

from roadscope.detectors import Cloud
from roadscope.detectors.ground import PolarRule, polar_above_ground

RULE = PolarRule()
CAR = (25, 0, 4.6, 1.85, 1.5, 0)
SPINNING = {"azimuths": np.radians(np.arange(-180, 180, 0.5))}


def make(points, origin=(0.0, 0.0)):
    count = np.arange(len(points))
    return Cloud(
        np.reshape(np.array(points, float), (-1, 3)), count, count, count, np.array(origin)
    )


def above_ground_by_loop(returns, segment_deg=1.0, bin_m=0.5, clear_m=0.2, ceiling_m=2.5):
    """Algorithm 1 of the paper with its readings, a segment at a time, lines by `np.polyfit`."""
    mask, reach = np.zeros(len(returns), bool), returns.ranges
    segment = np.floor((returns.azimuths / (2 * np.pi) + 0.5) * 360 / segment_deg)
    bins = np.floor(reach / bin_m)
    for s in np.unique(segment):
        rows = np.flatnonzero(segment == s)
        prototypes = []
        for b in np.unique(bins[rows]):
            inside = rows[bins[rows] == b]
            lowest = inside[np.lexsort((reach[inside], returns.points[inside, 2]))[0]]
            prototypes.append((b, reach[lowest], returns.points[lowest, 2]))
        lines = lines_by_loop(prototypes)
        for row in rows:
            gaps = [max(line[0] - bins[row], bins[row] - line[1]) for line in lines]
            inside = [k for k, gap in enumerate(gaps) if gap <= 0]
            slope, offset = lines[inside[0] if inside else int(np.argmin(gaps))][2:]
            height = returns.points[row, 2] - slope * reach[row] - offset
            mask[row] = clear_m < height < ceiling_m
    return mask


def lines_by_loop(prototypes):
    lines, held, foot = [(0, 0, 0.0, 0.0)], [(0, 0.0, 0.0)], 1
    for b, r, z in prototypes:
        if len(held) >= 2:
            _, x, y = np.array([*held, (b, r, z)]).T
            slope, offset = np.polyfit(x, y, 1)
            off = slope * x + offset - y
            residual = max(np.sqrt(np.mean(off**2)), abs(off[-1]) / 2)
            fits = abs(slope) <= RULE.slope and residual <= RULE.residual_m
            if not fits or (abs(slope) <= RULE.flat_slope and abs(offset) > RULE.intercept_m):
                held, foot = [], 0
                continue
            held.append((b, r, z))
            if len(held) - foot == 3 and not foot:
                lines.append(None)
            if len(held) - foot >= 3:
                lines[-1] = (held[0][0], b, slope, offset)
        elif abs(z - lines[-1][2] * r - lines[-1][3]) <= RULE.resume_m:
            held.append((b, r, z))
    return lines


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(-0.12, 0.12), st.integers(1, 300))
def test_equals_the_algorithm_written_out(seed, slope, count):
    rng = np.random.default_rng(seed)
    reach, azimuth = rng.uniform(2, 60, count), rng.uniform(-0.1, 0.1, count)
    z = slope * np.maximum(reach - 15, 0) + rng.choice([0, 0, 0, 0.6, 1.5], count)
    z += 0.01 * rng.standard_normal(count)
    returns = make(np.column_stack([reach * np.cos(azimuth), reach * np.sin(azimuth), z]))
    assert np.array_equal(polar_above_ground(returns), above_ground_by_loop(returns))


@pytest.mark.parametrize("options", [{}, {"elevations": np.arange(-20.0, 2), **SPINNING}])
def test_flat_ground_goes_and_the_car_stays(options):
    returns = cloud([CAR], noise_m=0.03, **options)
    above_ground = polar_above_ground(returns)
    on_car = np.abs(returns.points[:, 0] - CAR[0]) < 2.5
    on_car &= np.abs(returns.points[:, 1]) < 1
    body = on_car & (returns.points[:, 2] > 0.35)
    assert not above_ground[~on_car].any()
    assert body.sum() > 10
    assert above_ground[body].all()


def test_ramp_is_ground_and_the_box_on_it_stands():
    """The road rises by 8 % from 20 m on; by heights above the wheels it would be a wall."""
    r = np.arange(5, 60, 0.5)
    z = 0.08 * np.maximum(r - 20, 0)
    box = (r > 45) & (r < 47)
    z[box] += 0.7
    above_ground = polar_above_ground(make(np.column_stack([r, np.zeros(len(r)), z])))
    assert np.array_equal(above_ground, box)


def test_roof_is_no_ground_even_without_any_other_return():
    r = np.arange(12, 16, 0.5)
    above_ground = polar_above_ground(
        make(np.column_stack([r, np.zeros(len(r)), np.full(len(r), 1.5)]))
    )
    assert above_ground.all()


def test_bumper_in_two_bins_is_no_ground():
    points = [(17.9, 0.0, 0.25), (18.1, 0.0, 0.25), (18.1, 0, 0.6)]
    assert polar_above_ground(make(points)).all()


def test_blind_zone_of_a_high_sensor():
    """First ground 20 m away, on the plane of the wheels, and a wall."""
    returns = make([(20, 0, 0.0), (23, 0, 0.01), (27, 0, -0.01), (32, 0, 0.02), (32.1, 0, 1.0)])
    assert polar_above_ground(returns).tolist() == [False] * 4 + [True]


def test_crowns_are_dropped_and_holes_are_no_obstacles():
    points = [(5.0, 0, 1), (5, 0, 2.4), (5, 0, 2.6), (9, 0, -1)]
    assert polar_above_ground(make(points)).tolist() == [True, True, False, False]


@given(st.integers(0, 2**32 - 1), st.integers(0, 359))
def test_turning_about_the_sensor_by_segments_changes_nothing(seed, steps):
    rng = np.random.default_rng(seed)
    azimuth = np.radians(rng.integers(0, 360, 80) + rng.uniform(0.01, 0.99, 80))
    reach, z = rng.uniform(3, 40, 80), rng.choice([0.0, 0.1, 0.8], 80)

    def turned(angle):
        x, y = reach * np.cos(azimuth + angle), reach * np.sin(azimuth + angle)
        return polar_above_ground(make(np.column_stack([x + 2, y - 1, z]), (2.0, -1.0)))

    assert np.array_equal(turned(0.0), turned(np.radians(steps)))


def test_one_very_far():
    assert polar_above_ground(make([(9.0, 0, 0.5), (1e7, 0, 0)])).tolist() == [True, False]
