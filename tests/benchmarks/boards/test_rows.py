import numpy as np
import pytest

from roadscope.benchmarks.boards.rows import Record, blocks, part_rows, whole_rows
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.metrics.breakdown import BANDS, EXCESS, part_name
from roadscope.benchmarks.metrics.calibration import calibration_error, excess
from roadscope.benchmarks.metrics.score import ratio


def episode(seed: int, scenario: str = "motorway") -> Episode:
    return Episode(scenario, seed, "lux", 1.0)


def record(*sound, episodes: int | None = None) -> Record:
    return Record("detection", "mine", None, tuple(sound), episodes or len(sound))


def test_figures_are_pooled_over_episodes() -> None:
    rows = whole_rows(
        record(
            (episode(1), {"detection_rate": ratio(1, 2)}),
            (episode(2), {"detection_rate": ratio(9, 10)}),
            (episode(3), {"detection_rate": ratio(0, 0)}),
            episodes=4,
        )
    )
    rate, failed = rows
    assert rate.value == pytest.approx(10 / 12)
    assert (rate.n, rate.samples) == (2, 12)
    assert (rate.by, rate.band) == ("", "")
    assert (failed.metric, failed.value, failed.n) == ("failed_episodes", 1, 4)


def test_the_same_traffic_again_is_no_further_sample() -> None:
    once = [(episode(seed), ratio(hits, 10)) for seed, hits in enumerate((2, 5, 9))]
    joined = blocks(once + once)
    assert [s.value for s in joined.values()] == [0.2, 0.5, 0.9]
    single = whole_rows(record(*((e, {"f1": s}) for e, s in once)))[0]
    double = whole_rows(record(*((e, {"f1": s}) for e, s in once + once)))[0]
    assert (double.value, double.low, double.high) == pytest.approx(
        (single.value, single.low, single.high)
    )
    assert double.n == 6


def test_by_condition_and_by_band() -> None:
    near = part_name("detection_rate", "range", "0-20")
    rows = part_rows(
        record(
            (episode(1, "merge"), {"detection_rate": ratio(1, 2), near: ratio(1, 1)}),
            (episode(1, "two-way"), {"detection_rate": ratio(3, 4), near: ratio(0, 0)}),
        )
    )
    found = {(row.by, row.band): (row.value, row.samples) for row in rows}
    assert found == {
        ("range", "0-20"): (1.0, 1),
        ("scenario", "merge"): (0.5, 2),
        ("scenario", "two-way"): (0.75, 4),
        ("weather", "clear"): (pytest.approx(4 / 6), 6),
        ("condition", "clear"): (pytest.approx(4 / 6), 6),
    }
    assert {row.metric for row in rows} == {"detection_rate"}


def test_bands_in_which_nothing_was_to_be_found_are_left_out() -> None:
    far = part_name("detection_rate", "range", "80+")
    assert part_rows(record((episode(1), {far: ratio(0, 0)}))) == []


def test_the_calibration_error_is_that_of_all_episodes_together() -> None:
    rng = np.random.default_rng(0)
    scores, right = rng.random((6, 30)), rng.random((6, 30)) < 0.4
    sound = []
    for seed in range(6):
        bins = excess(scores[seed], right[seed])
        named = zip(BANDS["score"].labels, bins, strict=True)
        parts = {part_name(EXCESS, "score", band): score for band, score in named}
        sound.append((episode(seed), {"calibration_error": calibration_error(bins), **parts}))
    row = whole_rows(record(*sound))[0]
    assert row.metric == "calibration_error"
    assert row.value == pytest.approx(
        calibration_error(excess(scores.ravel(), right.ravel())).value
    )
    assert 0 <= row.low < row.value < row.high
