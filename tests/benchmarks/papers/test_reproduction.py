import json
import time

import numpy as np
import pytest

from roadscope.benchmarks.papers.reproduction import (
    ReproductionRow,
    over_seeds,
    summarise,
    write_rows,
)

KEYS = ["experiment", "method", "quantity", "unit", "paper", "ours", "low", "high", "n"]


def test_rows_go_to_json_under_their_names(tmp_path):
    rows = [
        summarise(("one", "pag"), "error", "m", [1.0, 2.0, 3.0, np.nan], 1.5),
        summarise(("one", "pag"), "other", "m", [np.nan], None),
    ]
    write_rows(rows, tmp_path / "paper.json")
    first, second = json.loads((tmp_path / "paper.json").read_text())
    assert list(first) == KEYS
    assert (first["paper"], first["ours"], first["n"]) == (1.5, 2.0, 3)
    assert first["low"] < 2.0 < first["high"]
    assert (second["paper"], second["ours"], second["low"], second["n"]) == (None, None, None, 0)


def test_a_figure_of_the_paper_never_stands_alone():
    with pytest.raises(
        ValueError, match=r"the paper gives 0\.5 m for 'error', and ours is missing"
    ):
        ReproductionRow("one", "pag", "error", "m", 0.5, None, None, None, 0)


def test_interval_is_students_and_within_what_can_be():
    from scipy.stats import t

    values = [1.0, 2.0, 4.0, 4.5]
    row = summarise(("one", "pag"), "error", "m", values, None)
    low, high = t.interval(0.95, 3, loc=np.mean(values), scale=np.std(values, ddof=1) / 2)
    assert (row.low, row.high) == pytest.approx((max(low, 0), high))
    row = summarise(("one", "pag"), "rate", "share", [0.9] * 29 + [1.0], None)
    assert 0.89 < row.low < row.ours < row.high < 0.92
    row = summarise(("one", "pag"), "rate", "share", [1.0, 0.5, 0.0], None)
    assert (row.low, row.high) == (0.0, 1.0)
    row = summarise(("one", "pag"), "count", "count", [4.0] * 5, None)
    assert row.low == row.ours == row.high == 4.0


def test_one_seed_has_no_interval():
    row = summarise(("one", "pag"), "error", "m", [2.0, np.nan], 1.0)
    assert (row.ours, row.low, row.high, row.n) == (2.0, None, None, 1)


def test_seeds_are_gathered_in_order_and_need_not_have_all():
    def measure(seed):
        found = {("one", "pag", "error"): float(seed)}
        return found if seed % 2 else {**found, ("one", "pag", "floor"): 0.5 * seed}

    done = []
    measured = over_seeds(measure, range(4), lambda *progress: done.append(progress))
    assert measured == {
        ("one", "pag", "error"): [0.0, 1.0, 2.0, 3.0],
        ("one", "pag", "floor"): [0.0, 1.0],
    }
    assert done == [(1, 4), (2, 4), (3, 4), (4, 4)]
    with pytest.raises(ValueError, match="at least one seed is needed, got 0"):
        over_seeds(measure, range(0))


def one_after_the_other(seed):
    time.sleep(0.3 * (2 - seed))
    return {("one", "pag", "error"): float(seed)}


def test_processes_share_the_seeds_and_keep_their_order():
    assert over_seeds(one_after_the_other, range(3), jobs=2) == {
        ("one", "pag", "error"): [0.0, 1.0, 2.0]
    }
