import numpy as np
import pytest

from research.tracker_samples import CollectedSamples, TraitSamples, error_pairs
from research.tracker_traits import calibrated, lasting, source, spread
from roadscope.trackers import read_detector


def samples(n=4000, seed=0):
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(5, 60, n)
    errors = rng.standard_normal((n, 4)) * (0.1, 0.05, 0.04, 0.02) * (1 + 0.03 * ranges)[:, None]
    odds = rng.uniform(-4, 9, n)
    right = rng.random(n) < 1 / (1 + np.exp(2 - 0.7 * odds))
    changes = rng.standard_normal((n, 4)) * (2.0, 1.5, 0.1, 0.2)
    judged = np.column_stack([odds, ranges, right])
    velocities = np.column_stack([rng.uniform(0, 15, n), rng.normal(0, 0.3, n)])
    fronts = rng.random(n) < 0.9
    return TraitSamples(
        errors, ranges, np.empty((0, 7)), fronts, odds, judged, changes, np.ones(n), velocities
    )


def test_growth_and_spread_are_recovered():
    drawn_samples = samples()
    growth, sigmas = spread(drawn_samples.errors, drawn_samples.ranges_m)
    assert growth == pytest.approx(0.03, abs=0.004)
    assert sigmas == pytest.approx([0.1, 0.05, 0.04, 0.02], rel=0.1)


def test_calibration_is_recovered():
    drawn_samples = samples()
    slope, offset, per_m = calibrated(drawn_samples.judged)
    assert (slope, offset) == pytest.approx((0.7, -2.0), abs=0.2)
    assert per_m == 0, "range says nothing there"


def test_the_effect_of_range_on_scores_is_recovered():
    rng = np.random.default_rng(2)
    odds, ranges = rng.uniform(-4, 6, 20000), rng.uniform(5, 60, 20000)
    right = rng.random(20000) < 1 / (1 + np.exp(4 - odds - 0.1 * ranges))
    coefficients = calibrated(np.column_stack([odds, ranges, right]))
    assert coefficients == pytest.approx((1.0, -4.0, 0.1), rel=0.1)


def test_a_file_says_what_was_learned(tmp_path):
    few = samples(10)
    path = tmp_path / "mine.toml"
    text = source(
        CollectedSamples({"car": samples(), "cyclist": few, "pedestrian": few}, "numbers of a test")
    )
    path.write_text(text)
    traits = read_detector(str(path)).traits
    assert traits.along_m[0] == pytest.approx(0.1, rel=0.1)
    assert traits.accelerate_m_s2[0] == pytest.approx(2.0, rel=0.05)
    assert traits.cruise_m_s[0] == pytest.approx(7.5, rel=0.05)
    assert traits.aside_m_s[0] == pytest.approx(0.3, rel=0.1)
    assert traits.front[0] == pytest.approx(0.9, abs=0.03)
    unknown = read_detector("unknown").traits
    assert traits.cruise_m_s[6] == unknown.cruise_m_s[6], "too few samples: guessed"
    assert 'origin = "numbers of a test"' in text


def test_lasting_errors_are_recovered():
    """Of 200 objects, each with an offset that wanders slowly and with white noise."""
    rng, keep = np.random.default_rng(3), np.exp(-0.1 / 2.0)
    ticks, n = 60, 200
    offset, rows = rng.standard_normal((n, 4)), []
    for _ in range(ticks):
        white = rng.standard_normal((n, 4))
        rows.append(np.sqrt(0.7) * offset + np.sqrt(0.3) * white)
        offset = keep * offset + np.sqrt(1 - keep**2) * rng.standard_normal((n, 4))
    owners, stamps = np.tile(np.arange(n), ticks), np.repeat(0.1 * np.arange(ticks), n)
    pairs = error_pairs(owners, stamps, np.concatenate(rows))
    for errors in ([1, 2, 4, 5], [3, 6]):
        share, time_s = lasting(pairs[:, [0, *errors]])
        assert share == pytest.approx(0.7, abs=0.05)
        assert time_s == pytest.approx(2.0, rel=0.2)
