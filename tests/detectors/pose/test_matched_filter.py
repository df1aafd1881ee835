import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.special import erf

from roadscope.detectors.pose import axis_difference, fit_single, peak

SIZE = {"length_m": 4.87, "width_m": 1.85}
ORIGIN = np.zeros(2)


def visible_faces(pose, origin=ORIGIN, spacing_m=0.12, noise_m=0.02, seed=0):
    """Returns of a brick, as many to each angle of view."""
    x, y, yaw = pose
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    half = np.array([SIZE["length_m"], SIZE["width_m"]]) / 2
    sensor = (np.asarray(origin) - (x, y)) @ turn
    faces = []
    for axis in (0, 1):
        if abs(sensor[axis]) > half[axis]:
            cos = abs(sensor[axis]) / np.hypot(*sensor)
            count = max(2, int(2 * half[1 - axis] * cos / spacing_m))
            face = np.empty((count, 2))
            face[:, axis] = np.sign(sensor[axis]) * half[axis]
            face[:, 1 - axis] = np.linspace(-0.97, 0.97, count) * half[1 - axis]
            faces.append(face)
    points = np.concatenate(faces) @ turn.T + (x, y)
    sights = points - origin
    ranges = np.hypot(*sights.T)[:, None]
    noise = noise_m * np.random.default_rng(seed).standard_normal(ranges.shape)
    return points + sights / ranges * noise


def reference_score(points, origin, angle, bin_m=0.02, sigma_m=0.04, alpha=0.5):
    """Sum of both responses at one angle, every bin against every place of the template."""
    mean = points.mean(axis=0)
    total = 0.0
    sides = SIZE["length_m"], SIZE["width_m"]
    for k, (extent, other) in enumerate((sides, sides[::-1])):
        axis = np.array([np.cos(angle + k * np.pi / 2), np.sin(angle + k * np.pi / 2)])
        sight = (mean - origin) / np.hypot(*(mean - origin))
        side = 1.0 if sight @ axis >= 0 else -1.0
        face, flank = other * (sight @ axis) ** 2, extent * (1 - (sight @ axis) ** 2)
        share = face / (face + flank)
        grid = np.arange(-300, 301) * bin_m - extent / 2
        places = side * (points - mean) @ axis
        weights = np.clip(1 - np.abs(places[:, None] - grid) / bin_m, 0, None).mean(axis=0)

        def template(u, extent=extent, share=share):
            box = (erf(u / sigma_m / 2**0.5) - erf((u - extent) / sigma_m / 2**0.5)) / 2
            edge = np.exp(-0.5 * (u / sigma_m) ** 2) / (sigma_m * np.sqrt(2 * np.pi))
            return share * edge + (1 - share) / extent * box, box

        fine = np.linspace(-1, extent + 1, 40001)
        energy = np.sqrt(np.trapezoid(template(fine)[0] ** 2, fine))
        held = np.flatnonzero(weights)
        body, box = template(grid[held] - grid[:, None])
        total += ((body / energy - alpha * (1 - box)) @ weights[held]).max()
    return total


@pytest.mark.parametrize(
    "pose", [(30, 3, 0.05), (25, -4, 0.8), (0, 18, 0.1), (-20, 9, 2.5)], ids=str
)
def test_agrees_with_the_slow_reference(pose):
    points = visible_faces(pose, spacing_m=0.2)
    fitted = fit_single(points, ORIGIN, **SIZE)
    angles = np.radians(np.arange(0, 180, 3))
    scores = [reference_score(points, ORIGIN, angle) for angle in angles]
    near = fitted.yaw + np.radians(np.arange(-2, 2.1, 0.5))
    best = near[np.argmax([reference_score(points, ORIGIN, angle) for angle in near])]
    assert np.degrees(abs(axis_difference(fitted.yaw, best))) <= 0.5
    assert fitted.score == pytest.approx(reference_score(points, ORIGIN, fitted.yaw), rel=0.01)
    assert fitted.score >= max(scores) * 0.99


@pytest.mark.parametrize("bearing", np.radians([0, 40, 115, 250]))
@pytest.mark.parametrize("heading", np.radians([0, 15, 45, 80, 130, 170]))
def test_finds_a_brick_from_any_side(bearing, heading):
    centre = 25.0 * np.array([np.cos(bearing), np.sin(bearing)])
    pose = (*centre, heading)
    fitted = fit_single(visible_faces(pose), ORIGIN, **SIZE)
    assert np.hypot(*(fitted.centre - centre)) < 0.08
    assert np.degrees(abs(axis_difference(fitted.yaw, heading))) < 1.5
    assert (fitted.length, fitted.width) == tuple(SIZE.values())


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=1, max_size=12),
    st.tuples(st.integers(-9, 9), st.integers(-9, 9)),
)
@example([(0, -2), (0, 3), (1, 7), (1, -9), (-1, -7), (-2, 7), (6, 0), (-9, 1)], (0, 0))
def test_any_finite_points_give_a_pose(points, origin):
    fitted = fit_single(np.array(points, float), np.array(origin, float), **SIZE)
    reach = np.abs(np.array(points)).max() + SIZE["length_m"]
    assert np.abs(fitted.centre).max() <= reach


def test_many_points_give_the_same_as_few_of_them():
    pose = (12.0, 5.0, 0.4)
    points = visible_faces(pose, spacing_m=0.001)
    assert len(points) > 1000
    many, few = (fit_single(p, ORIGIN, **SIZE) for p in (points, points[::20]))
    assert np.hypot(*(many.centre - few.centre)) < 0.02
    assert np.degrees(abs(axis_difference(many.yaw, few.yaw))) < 0.5


def test_a_quarter_turn_searched_loses_half_of_the_headings():
    headings = np.radians(np.arange(0, 180, 15))
    searched = {}
    for search_deg in (90.0, 180.0):
        fits = [
            fit_single(visible_faces((25, 5, yaw)), ORIGIN, search_deg=search_deg, **SIZE)
            for yaw in headings
        ]
        off = [abs(axis_difference(f.yaw, yaw)) for f, yaw in zip(fits, headings, strict=True)]
        searched[search_deg] = np.mean(np.array(off) > np.pi / 4)
    assert searched[180.0] == 0
    assert 0.25 < searched[90.0] < 0.75


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bin_m": 0}, "bin_m"),
        ({"sigma_m": np.nan}, "sigma_m"),
        ({"alpha": -1.0}, "alpha"),
        ({"length_m": 1.0}, "width_m"),
        ({"step_deg": 0}, "step_deg"),
        ({"search_deg": 45}, "search_deg"),
        ({"template": "round"}, "template"),
    ],
)
def test_settings_are_refused_by_name(options, message):
    with pytest.raises(ValueError, match=message):
        fit_single(np.array([[10.0, 0.0]]), ORIGIN, **{**SIZE, **options})


def test_a_plateau_counts_at_its_middle_and_a_peak_between_bins():
    flat = np.zeros(21)
    flat[8:15] = [0.9995, 1, 1, 1.0001, 1, 0.9999, 0.9995]
    assert peak(flat, 1e-3) == pytest.approx(1.0)
    single = -((np.arange(21) - 12.3) ** 2)
    assert peak(single, 1e-3) == pytest.approx(2.3)
