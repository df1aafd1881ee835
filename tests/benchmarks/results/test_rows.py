import numpy as np
import pytest

from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.metrics import (
    BANDS,
    EXCESS,
    Score,
    calibration_error,
    excess,
    part_name,
    ratio,
)
from roadscope.benchmarks.results import EntryResult, JobScores, part_rows, whole_rows


def job(seed: int, scores, *, scenario="motorway", board="detection", **fields) -> JobScores:
    fields = {"condition": "clear", "inputs": ""} | fields
    conditions = {"weather": "clear", "scenario": scenario, "condition": fields["condition"]}
    if board.startswith("kitti"):
        conditions = {"sequence": f"{seed:04}"}
    return JobScores(board, "mine", scenario, seed, scores=scores, conditions=conditions, **fields)


def result(*jobs: JobScores, episodes: int | None = None) -> EntryResult:
    board = board_named(jobs[0].board)
    return EntryResult(board, "mine", None, tuple(jobs), episodes or len(jobs))


def test_figures_are_pooled_over_episodes() -> None:
    rates = [ratio(1, 2), ratio(9, 10), ratio(0, 0)]
    jobs = [job(seed, {"detection_rate": rate}) for seed, rate in enumerate(rates)]
    rate, failed = whole_rows(result(*jobs, episodes=4))
    assert rate.value == pytest.approx(10 / 12)
    assert (rate.n, rate.samples) == (2, 12)
    assert (rate.by, rate.band) == ("", "")
    assert (failed.metric, failed.value, failed.n) == ("failed_episodes", 1, 4)


def test_the_same_traffic_again_is_no_further_sample() -> None:
    once = [job(seed, {"f1": ratio(hits, 10)}) for seed, hits in enumerate((2, 5, 9))]
    again = [
        job(seed, {"f1": ratio(hits, 10)}, condition="fog:3") for seed, hits in enumerate((2, 5, 9))
    ]
    single = whole_rows(result(*once))[0]
    double = whole_rows(result(*once, *again))[0]
    assert (double.value, double.low, double.high) == pytest.approx(
        (single.value, single.low, single.high)
    )
    assert double.n == 6


def test_by_condition_and_by_band() -> None:
    near = part_name("detection_rate", "range", "0-20")
    rows = part_rows(
        result(
            job(1, {"detection_rate": ratio(1, 2), near: ratio(1, 1)}, scenario="merge"),
            job(1, {"detection_rate": ratio(3, 4), near: ratio(0, 0)}, scenario="two-way"),
        )
    )
    figures = {(row.by, row.band): (row.value, row.samples) for row in rows}
    assert figures == {
        ("range", "0-20"): (1.0, 1),
        ("scenario", "merge"): (0.5, 2),
        ("scenario", "two-way"): (0.75, 4),
        ("weather", "clear"): (pytest.approx(4 / 6), 6),
        ("condition", "clear"): (pytest.approx(4 / 6), 6),
    }
    assert {row.metric for row in rows} == {"detection_rate"}


def test_a_board_with_inputs_is_broken_down_by_them() -> None:
    jobs = [
        job(1, {"hota": ratio(part, 10)}, board="tracking", inputs=inputs)
        for part, inputs in ((4, "pag"), (8, "oracle"))
    ]
    rows = {row.band: row.value for row in part_rows(result(*jobs)) if row.by == "detector"}
    assert rows == {"pag": 0.4, "oracle": 0.8}


def test_bands_in_which_nothing_was_to_be_found_are_left_out() -> None:
    far = part_name("detection_rate", "range", "80+")
    assert part_rows(result(job(1, {far: ratio(0, 0)}))) == []


def test_the_calibration_error_is_that_of_all_episodes_together() -> None:
    rng = np.random.default_rng(0)
    scores, right = rng.random((6, 30)), rng.random((6, 30)) < 0.4
    jobs = []
    for seed in range(6):
        bins = excess(scores[seed], right[seed])
        named = zip(BANDS["score"].labels, bins, strict=True)
        parts = {part_name(EXCESS, "score", band): score for band, score in named}
        jobs.append(job(seed, {"calibration_error": calibration_error(bins), **parts}))
    row = whole_rows(result(*jobs))[0]
    assert row.metric == "calibration_error"
    whole = calibration_error(excess(scores.ravel(), right.ravel()))
    assert row.value == pytest.approx(whole.value)
    assert 0 <= row.low < row.value < row.high


COUNTS = (3.0, 5.0, 10.0)


@pytest.mark.parametrize(("board", "shown"), [("kitti car", 18.0), ("tracking", 6.0)])
def test_counts_on_recorded_data_are_sums_as_papers_have_them(board, shown) -> None:
    jobs = [
        job(seed, {"id_switches": Score(count, "1", "lower", 100)}, board=board)
        for seed, count in enumerate(COUNTS)
    ]
    row = whole_rows(result(*jobs))[0]
    assert row.value == pytest.approx(shown)
    assert row.low <= row.value <= row.high


def test_one_hard_episode_does_not_carry_the_median_away() -> None:
    drifts = [Score(v, "%", "lower", 10) for v in (1.0, 1.2, 40.0)]
    jobs = [job(seed, {"t_rel": drift}, board="odometry") for seed, drift in enumerate(drifts)]
    rows = {row.metric: row.value for row in whole_rows(result(*jobs))}
    assert rows["t_rel_median"] == 1.2
    assert rows["t_rel"] > 10


def test_a_recall_of_an_odometry_without_dynamic_returns_is_not_shown() -> None:
    silent = {"dynamic_recall": ratio(0, 10), "dynamic_precision": ratio(0, 0)}
    heard = {"dynamic_recall": ratio(5, 10), "dynamic_precision": ratio(5, 5)}
    names = [
        {row.metric for row in whole_rows(result(job(1, scores, board="odometry")))}
        for scores in (silent, heard)
    ]
    assert ["dynamic_recall" in each for each in names] == [False, True]
