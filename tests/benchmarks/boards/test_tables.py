import io
from dataclasses import replace

import pytest
from rich.console import Console

from roadscope.benchmarks.boards.columns import COLUMNS, footnote, shown_columns
from roadscope.benchmarks.boards.results import Results
from roadscope.benchmarks.boards.rows import Row
from roadscope.benchmarks.boards.standing import Standing
from roadscope.benchmarks.boards.tables import board_table, comparison
from roadscope.benchmarks.papers.reproduction import ReproductionRow, summarise
from roadscope.benchmarks.papers.reproduction_tables import reproduction_tables


def printed(*things, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width)
    for thing in things:
        console.print(thing)
    return console.file.getvalue()


def board(
    value: float | None, low: float | None, high: float | None, name: str = "tracking"
) -> Results:
    rows = [
        Row(name, "nearest-q on oracle", metric, value, low, high, 18, "1", "higher")
        for metric in COLUMNS[name]
    ]
    return Results({}, tuple(rows), ())


def test_boards_fit_80_columns_with_an_interval_of_the_first_figure() -> None:
    text = printed(board_table(board(0.512, 0.4, 0.613), "tracking", 80))
    assert max(map(len, text.splitlines())) <= 80
    assert text.count("[.40, .61]") == 1
    assert "nearest-q on oracle" in text
    assert "…" not in text


def test_narrow_boards_keep_the_name() -> None:
    text = printed(board_table(board(0.512, 0.4, 0.613), "tracking", 40), width=40)
    assert "nearest-q" in text
    assert "0.51" in text
    assert max(map(len, text.splitlines())) <= 40


@pytest.mark.parametrize("board", ["camera", "fusion"])
def test_an_average_of_episodes_says_how_they_are_weighed(board: str) -> None:
    assert "episodes by their objects" in footnote(board, 80, 1)


def test_footnotes_explain_what_is_shown() -> None:
    narrow, wide = footnote("detection", 80, 4), footnote("detection", 320, 1)
    assert "head." not in narrow
    assert "4 workers" in narrow
    assert "wider terminal" in narrow
    assert "head." in wide
    assert "wider terminal" not in wide
    assert "workers" not in wide


def test_wide_boards_have_all_intervals() -> None:
    text = printed(board_table(board(0.512, 0.4, 0.613), "tracking", 440), width=440)
    assert text.count("[.4") == len(COLUMNS["tracking"])


@pytest.mark.parametrize("name", COLUMNS)
@pytest.mark.parametrize("width", range(40, 321, 9))
def test_boards_of_any_width_fit_and_grow_with_it(name, width) -> None:
    table = board_table(board(0.512, 0.4, 0.613, name), name, width)
    text = printed(table, width=width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    narrower = shown_columns(name, width - 9)
    assert list(narrower) == [m for m in shown_columns(name, width) if m in narrower]


def standing(entry: str, rank: int | None, behind=None, mark=None) -> Standing:
    gap = (None, None, None) if behind is None else behind
    return Standing("tracking", entry, mark, rank, rank, rank, *gap)


def ranked(*places: Standing) -> Results:
    rows = [Row("tracking", s.entry, "hota", 0.5, 0.4, 0.6, 9, "1", "higher") for s in places]
    return Results({}, tuple(rows), (), (), places)


def test_marks_stand_apart_without_a_rank() -> None:
    results = ranked(standing("mine", 1), standing("all-in-one", None, mark="lower mark"))
    lines = printed(board_table(results, "tracking", 80)).splitlines()
    assert lines[-3].startswith("1 mine")
    assert not lines[-2].strip()
    assert lines[-1].startswith("  all-in-one (lower mark)")


def test_who_may_be_as_good_as_the_best_is_named() -> None:
    best, near = standing("a", 1, (0.0, 0.0, 0.0)), standing("b", 2, (0.1, -0.01, 0.2))
    far = standing("c", 3, (0.3, 0.2, 0.4))
    assert comparison(ranked(best, near, far), "tracking").startswith(
        "Not shown to be worse than a: b. "
    )
    assert "a is shown to be better than all others" in comparison(ranked(best, far), "tracking")
    assert comparison(ranked(best), "tracking") == ""
    assert comparison(ranked(best, standing("b", 2, (0.1, None, None))), "tracking") == ""


def test_recorded_data_are_compared_on_the_same_sequences() -> None:
    best, far = standing("a", 1, (0.0, 0.0, 0.0)), standing("b", 2, (0.3, 0.2, 0.4))
    places = tuple(replace(place, board="kitti car") for place in (best, far))
    assert comparison(ranked(*places), "kitti car").endswith("on the same sequences.")
    assert comparison(ranked(best, far), "tracking").endswith("on the same seeds.")


def test_what_was_not_measured_is_a_dash() -> None:
    text = printed(board_table(board(None, None, None), "tracking", 80))
    assert "nan" not in text
    assert "None" not in text
    assert " - " in text
    assert board(None, None, None).nothing_eligible("tracking")
    assert not board(0.5, 0.4, 0.6).nothing_eligible("tracking")


def rows() -> list[ReproductionRow]:
    many = [
        summarise(("one", method), f"quantity {i}", "m", [1.0, 2.0], 1.25 if i else None)
        for method in ("papers + own", "papers + other")
        for i in range(6)
    ]
    few = [
        summarise(("one", method), "clusters kept", "1/scan", [1.0, 2.0], None)
        for method in ("pag", "distance")
    ]
    return [*many, *few]


def test_the_papers_method_in_full_and_the_others_side_by_side() -> None:
    text = printed(*reproduction_tables(rows()))
    assert "papers + own" in text
    assert "papers + other" not in text
    assert text.count("1.25") == 5
    assert "pag" in text
    assert "distance" in text
    assert max(map(len, text.splitlines())) <= 80


def test_everything_on_demand() -> None:
    assert "papers + other" in printed(*reproduction_tables(rows(), everything=True))
