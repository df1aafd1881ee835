import numpy as np
import pytest

from roadscope.benchmarks.metrics import mean, ratio, rms
from roadscope.benchmarks.results import mean_interval, merged, paired_interval, pooled_interval


def coverage(draw, true_mean, *, trials=400, strata=None) -> float:
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(trials):
        interval = mean_interval(draw(rng), strata, resamples=400)
        hits += interval.low <= true_mean <= interval.high
    return hits / trials


@pytest.mark.parametrize("n", [3, 5, 15, 30])
def test_intervals_of_normal_values_cover_their_mean(n) -> None:
    # 400 trials at 0.95: standard error 0.011.
    assert 0.915 < coverage(lambda rng: rng.normal(2.0, 1.0, n), 2.0) < 0.985


def test_intervals_of_skewed_values_cover_their_mean_better_than_percentiles() -> None:
    n = 15

    def percentile(rng) -> bool:
        x = rng.exponential(1.0, n)
        means = x[rng.integers(n, size=(400, n))].mean(axis=1)
        low, high = np.quantile(means, [0.025, 0.975])
        return low <= 1.0 <= high

    rng = np.random.default_rng(1)
    plain = np.mean([percentile(rng) for _ in range(400)])
    ours = coverage(lambda rng: rng.exponential(1.0, n), 1.0)
    assert ours > 0.915
    assert ours > plain


def test_strata_of_three_values_cover_the_mean_of_strata() -> None:
    places, spreads = np.repeat([0.0, 5.0, 9.0, -4.0], 3), np.repeat([0.5, 1.0, 2.0, 0.1], 3)
    labels = np.repeat(list("abcd"), 3).tolist()
    share = coverage(lambda rng: rng.normal(places, spreads), 2.5, strata=labels)
    assert 0.92 < share < 0.99


def test_scenarios_that_differ_do_not_widen_the_interval() -> None:
    values, labels = [1.0, 1.1, 9.0, 9.1], ["a", "a", "b", "b"]
    assert mean_interval(values, labels).high - mean_interval(values, labels).low < 1.0
    assert mean_interval(values).high - mean_interval(values).low > 10.0


def test_one_value_has_no_interval() -> None:
    interval = mean_interval([0.5])
    assert interval.mean == 0.5
    assert np.isnan(interval.low)
    assert np.isnan(interval.high)
    assert interval.n == 1


def test_equal_values_have_an_interval_of_no_width() -> None:
    interval = mean_interval([0.3] * 5)
    assert interval.low == interval.mean == interval.high == pytest.approx(0.3)


def test_missing_values_are_left_out() -> None:
    assert mean_interval([1.0, np.nan, 3.0]).mean == 2.0
    assert mean_interval([1.0, np.nan, 3.0]).n == 2
    assert mean_interval([np.nan]).n == 0


def test_the_same_values_give_the_same_interval() -> None:
    values = np.random.default_rng(0).random(20)
    assert mean_interval(values) == mean_interval(values)


def test_ratios_are_pooled_as_ratios_of_sums() -> None:
    interval = pooled_interval([ratio(1, 2), ratio(9, 10), ratio(0, 0)])
    assert interval.mean == pytest.approx(10 / 12)
    assert interval.n == 2
    assert interval.low < interval.mean < interval.high


def test_rms_errors_are_pooled_over_samples() -> None:
    interval = pooled_interval([rms(4.0, 1, "m"), rms(3 * 1.0, 3, "m")])
    assert interval.mean == pytest.approx(np.sqrt(7 / 4))
    assert interval.low >= 0.0


def test_equal_weights_make_pooling_a_plain_mean() -> None:
    values = [0.1, 0.4, 0.3, 0.8]
    pooled = pooled_interval([mean(10 * v, 10, "m") for v in values])
    plain = mean_interval(values)
    assert (pooled.mean, pooled.low, pooled.high) == pytest.approx(
        (plain.mean, plain.low, plain.high)
    )


def test_pooled_ratios_cover_the_true_ratio() -> None:
    rng, hits = np.random.default_rng(2), 0
    for _ in range(300):
        wholes = rng.integers(50, 400, 12)
        rates = rng.beta(14, 6, 12)
        scores = [ratio(rng.binomial(w, r), int(w)) for w, r in zip(wholes, rates, strict=True)]
        interval = pooled_interval(scores)
        hits += interval.low <= 0.7 <= interval.high
    assert 0.90 < hits / 300 < 0.99


@pytest.mark.parametrize("odd", [1, 2])
def test_a_few_odd_values_among_many_alike_give_a_bounded_interval(odd: int) -> None:
    values = np.ones(30) - 1e-9 * np.arange(30)
    values[:odd] = 0.5
    interval = mean_interval(values)
    assert interval.low < interval.mean < interval.high
    assert interval.high - interval.low < 0.1 * odd


def test_differences_are_those_of_pooled_ratios() -> None:
    ones, others = [ratio(1, 2), ratio(9, 10)], [ratio(1, 4), ratio(5, 10)]
    interval = paired_interval(ones, others)
    assert interval.mean == pytest.approx(10 / 12 - 6 / 14)
    assert interval.low < interval.mean < interval.high
    assert paired_interval(ones, ones) == paired_interval(others, others)
    assert paired_interval(ones, ones).high == 0.0
    assert paired_interval([ratio(1, 0)], [ratio(1, 2)]).n == 0


def test_rms_errors_are_subtracted_as_they_are_pooled() -> None:
    ones, others = [rms(16.0, 1, "m"), rms(27.0, 3, "m")], [rms(9.0, 1, "m"), rms(12.0, 3, "m")]
    interval = paired_interval(ones, others)
    assert interval.mean == pytest.approx(np.sqrt(43 / 4) - np.sqrt(21 / 4))
    assert interval.low < interval.mean < interval.high


def test_paired_intervals_cover_the_difference_and_are_narrower() -> None:
    rng, hits, widths = np.random.default_rng(3), 0, []
    for _ in range(200):
        hardness = rng.beta(5, 5, 12)
        ones = [ratio(100 * h + rng.normal(0, 2), 100) for h in hardness]
        others = [ratio(100 * h - 4 + rng.normal(0, 2), 100) for h in hardness]
        paired, alone = paired_interval(ones, others), pooled_interval(ones)
        hits += paired.low <= 0.04 <= paired.high
        widths.append((paired.high - paired.low) / (alone.high - alone.low))
    assert 0.90 < hits / 200 < 0.99
    assert np.median(widths) < 0.4


def test_scores_of_the_same_traffic_are_joined() -> None:
    whole = merged([ratio(1, 2), ratio(9, 10), ratio(0, 0)])
    assert whole.value == pytest.approx(10 / 12)
    assert (whole.n, whole.weight) == (12, 12)
    assert merged([rms(4.0, 1, "m"), rms(3.0, 3, "m")]).value == pytest.approx(np.sqrt(7 / 4))
    assert np.isnan(merged([ratio(0, 0), ratio(0, 0)]).value)
