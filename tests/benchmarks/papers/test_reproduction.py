import json
import time
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from roadscope.benchmarks.papers.reproduction import (
    YES_OR_NO,
    FigureKey,
    ReproductionRow,
    over_seeds,
    paper_compares_methods,
    reproduction_tables,
    summarise,
    write_rows,
)

KEYS = ["experiment", "method", "quantity", "unit", "paper", "ours", "low", "high", "n"]


def test_rows_go_to_json_under_their_names(tmp_path):
    rows = [
        summarise(FigureKey("one", "pag", "error"), "m", [1.0, 2.0, 3.0, np.nan], 1.5),
        summarise(FigureKey("one", "pag", "other"), "m", [np.nan], None),
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
    row = summarise(FigureKey("one", "pag", "error"), "m", values, None)
    low, high = t.interval(0.95, 3, loc=np.mean(values), scale=np.std(values, ddof=1) / 2)
    assert (row.low, row.high) == pytest.approx((max(low, 0), high))
    row = summarise(FigureKey("one", "pag", "rate"), "share", [0.9] * 29 + [1.0], None)
    assert 0.89 < row.low < row.ours < row.high < 0.92
    row = summarise(FigureKey("one", "pag", "rate"), "share", [1.0, 0.5, 0.0], None)
    assert (row.low, row.high) == (0.0, 1.0)
    row = summarise(FigureKey("one", "pag", "count"), "count", [4.0] * 5, None)
    assert row.low == row.ours == row.high == 4.0


def test_one_seed_has_no_interval():
    row = summarise(FigureKey("one", "pag", "error"), "m", [2.0, np.nan], 1.0)
    assert (row.ours, row.low, row.high, row.n) == (2.0, None, None, 1)


def test_seeds_are_gathered_in_order_and_need_not_have_all():
    def measure(seed):
        figures = {FigureKey("one", "pag", "error"): float(seed)}
        return figures if seed % 2 else {**figures, FigureKey("one", "pag", "floor"): 0.5 * seed}

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
    return {FigureKey("one", "pag", "error"): float(seed)}


def test_processes_share_the_seeds_and_keep_their_order():
    assert over_seeds(one_after_the_other, range(3), jobs=2) == {
        ("one", "pag", "error"): [0.0, 1.0, 2.0]
    }


# Tables.


def row(method, quantity, paper, ours=0.5, unit="m"):
    return ReproductionRow("one", method, quantity, unit, paper, ours, ours - 0.1, ours + 0.1, 30)


def printed(rows) -> str:
    console = Console(width=80)
    with console.capture() as captured:
        for table in reproduction_tables(rows):
            console.print(table)
    return captured.get()


def lines_of(rows) -> list[str]:
    return [line.strip() for line in printed(rows).splitlines() if line.strip()]


def test_where_the_paper_compares_methods_its_figures_stand_below_ours():
    rows = [
        row(method, quantity, paper, unit=unit)
        for method, paper in (("single", 0.25), ("multi", 0.125), ("ours", None))
        for quantity, unit in (("position", "m"), ("heading", "deg"))
    ]
    assert paper_compares_methods(rows)
    lines = lines_of(rows)
    assert lines[0].split() == ["position,", "m", "heading,", "deg"]
    assert lines[2].split() == ["single", "0.5000", "±0.1000", "0.500", "±0.100"]
    assert [line.split() for line in lines[3::2]] == [
        ["paper", "0.25", "0.25"],
        ["paper", "0.125", "0.125"],
    ]
    assert lines[6].startswith("ours")
    assert len(lines) == 7


def test_one_figure_for_all_methods_is_no_comparison():
    rows = [row(method, "claim", 1.0, 1.0, "share") for method in ("pag", "other")]
    assert not paper_compares_methods(rows)
    assert "95 %" in printed(rows)


def test_a_unit_that_all_share_stands_in_the_corner():
    rows = [row("single", f"{metres} m", None) for metres in (10, 20, 30, 40, 50)]
    assert lines_of(rows)[0].split() == ["m", "10", "m", "20", "m", "30", "m", "40", "m", "50", "m"]
    assert lines_of(rows)[2].split()[3] == "0.5000±.1000"
    assert len(lines_of(rows)) == 3


def test_claims_are_answered_in_words():
    claims = [
        ReproductionRow("claims", "ours", name, YES_OR_NO, None, value, None, None, 1)
        for name, value in (("close", 1.0), ("closer", 0.0), ("not asked", None))
    ]
    assert lines_of(claims)[0].split() == ["close", "closer", "not", "asked"]
    assert lines_of(claims)[2].split() == ["ours", "yes", "no", "-"]
    some = [ReproductionRow("claims", "ours", "a", YES_OR_NO, 1.0, 0.07, 0.0, 0.2, 30)]
    assert lines_of(some)[2].split()[:3] == ["a", "yes", "0.07"]
    many = [replace(claim, quantity=f"{claim.quantity} {i}") for i in range(2) for claim in claims]
    assert lines_of(many)[2].split() == ["close", "0", "-", "yes"]


def test_without_an_interval_figures_have_as_many_decimals():
    rows = [
        ReproductionRow("one", "single", name, unit, None, 0.123456, None, None, 1)
        for name, unit in (("position", "m"), ("heading", "deg"), ("frames", "count"))
    ]
    assert lines_of(rows)[2].split() == ["single", "0.1235", "0.123", "0.1235"]


def test_five_columns_of_per_cent_leave_a_long_name_whole():
    name = "a-method-of-23-letters-"
    quantities = [
        (f"{what} found", "%") for what in ("vehicles", "cyclists", "walkers", "pedestrians")
    ] + [("false", "1/scan")]
    rows = [
        row(m, q, 94.8 if m == "b" else None, 100.0, u) for m in (name, "b") for q, u in quantities
    ]
    rows += [replace(r, method="c", paper=90.3) for r in rows[-5:]]
    lines = printed(rows)
    assert name in lines
    assert "100.0±.1" in lines
    assert "100.00±.10" in lines


@pytest.mark.parametrize("columns", range(1, 6))
@pytest.mark.parametrize("ours", [0.036, 36.02, 1136.02, 81234.5])
def test_a_slow_or_uncertain_figure_stays_in_its_line(columns, ours):
    """A time beside a busy neighbour is as wide as it likes; it loses decimals, not its line."""
    time = ReproductionRow("one", "ours, 7 frames", "", "ms", None, ours, 0.0, 3 * ours, 30)
    rows = [replace(time, quantity=f"scan {i}") for i in range(columns)]
    text = printed([*rows, *(replace(r, method="b") for r in rows)])
    assert len(text.splitlines()) == 4
    assert "…" not in text
    assert f"{ours:.0f}" in text or f"{ours:.2f}" in text
