import io
from dataclasses import replace

import pytest
from rich.console import Console

from roadscope.benchmarks import load_suite
from roadscope.benchmarks.boards import BOARDS, KITTI_BOARDS, MOT_BOARDS, Board, board_named
from roadscope.benchmarks.report import (
    board_table,
    comparison,
    explanation,
    failure_lines,
    footnote,
)
from roadscope.benchmarks.results import Failure, Results, Row, Standing

EVERY_BOARD = [board.name for board in (*BOARDS.values(), *KITTI_BOARDS, *MOT_BOARDS)]
WIDTHS = (40, 80, 200)
LONG = "examples/perception/mine.py:MyTracker?gate_m=2.5&coast_frames=20&mode='slow'"


def printed(*things, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width)
    for thing in things:
        console.print(thing)
    return console.file.getvalue()


def board(
    value: float | None,
    low: float | None,
    high: float | None,
    name: str = "tracking",
    entry: str = "nearest-q on oracle",
) -> Results:
    rows = [
        Row(name, entry, column.metric, value, low, high, 18, "1", "higher")
        for column in board_named(name).columns
    ]
    return Results({}, tuple(rows), ())


def headings_of(text: str) -> list[str]:
    """Return the words of a table's headings."""
    return text.partition("──")[0].replace("─", "").split()


def words_of(shown: Board) -> set[str]:
    """Return all words that headings of a board have."""
    texts = [shown.kind.name, *(column.heading for column in shown.columns)]
    return {word for text in texts for word in text.split()}


@pytest.mark.parametrize("name", EVERY_BOARD)
@pytest.mark.parametrize("entry", ["nearest-q on oracle", LONG])
@pytest.mark.parametrize("width", WIDTHS)
def test_no_line_is_too_long_and_no_word_or_figure_is_cut(name, entry, width) -> None:
    results = board(0.512, 0.4, 0.613, name, entry)
    text = printed(board_table(results, name, width), width=width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    assert set(headings_of(text)) <= words_of(board_named(name))
    first, *_ = text.partition("──")[2].splitlines()[1:]
    decimals = board_named(name).columns[0].decimals
    assert f"{0.512:.{decimals}f} [" in first
    assert f"{0.613:.{decimals}f}]".removeprefix("0") in first
    assert first.count("[") == first.count("]")


@pytest.mark.parametrize("name", EVERY_BOARD)
def test_80_columns_show_what_a_call_costs(name) -> None:
    results = board(0.512, 0.4, 0.613, name, LONG)
    assert {"ms", "p50"} <= set(headings_of(printed(board_table(results, name, 80))))
    assert "median processor time" in footnote(results, name, 80)


@pytest.mark.parametrize("name", EVERY_BOARD)
def test_headings_have_no_hyphens_made_by_hand(name) -> None:
    for column in board_named(name).columns:
        assert "-\n" not in column.heading
        assert not any(word.endswith("-") for word in column.heading.split())
        assert "\n" not in column.heading


@pytest.mark.parametrize("width", WIDTHS)
def test_the_name_of_an_entry_is_shown_whole(width) -> None:
    text = printed(board_table(board(0.5, 0.4, 0.6, entry=LONG), "tracking", width), width=width)
    body = text.partition("──")[2].splitlines()[1:]
    first = body[0].split()[0]
    assert "".join([first, *(line.strip() for line in body[1:])]) == LONG


def test_a_long_name_is_broken_between_its_parts() -> None:
    entry = "existence?ego=noisy-odometry?scale=0.03&turn_deg=1"
    text = printed(board_table(board(0.5, 0.4, 0.6, entry=entry), "tracking", 80))
    lines = [line.split()[0] for line in text.partition("──")[2].splitlines()[1:]]
    assert "".join(lines) == entry
    assert len(lines) > 1
    assert all(line[0] in "?&" for line in lines[1:])


def test_boards_of_80_columns_have_an_interval_of_the_first_figure() -> None:
    text = printed(board_table(board(0.512, 0.4, 0.613), "tracking", 80))
    assert text.count("[.40, .61]") == 1
    assert "nearest-q on oracle" in text


def test_the_tracking_board_answers_lu_2018_in_80_columns() -> None:
    text = printed(board_table(board(0.512, 0.4, 0.613), "tracking", 80))
    assert {"HOTA", "MOTA", "IDF1", "sw.", "wrong", "hidden"} <= set(headings_of(text))


def test_wide_boards_have_all_intervals() -> None:
    text = printed(board_table(board(0.512, 0.4, 0.613), "tracking", 440), width=440)
    assert text.count("[.4") == len(board_named("tracking").columns)


@pytest.mark.parametrize("name", EVERY_BOARD)
def test_wider_boards_have_what_narrower_ones_have(name) -> None:
    results = board(0.512, 0.4, 0.613, name)
    before: list[str] = []
    for width in range(40, 321, 20):
        text = printed(board_table(results, name, width), width=width)
        assert max(map(len, text.splitlines())) <= width
        words = headings_of(text)
        assert set(before) <= set(words)
        before = words
    assert len(before) >= sum(len(c.heading.split()) for c in board_named(name).columns)


def test_figures_that_no_entry_has_get_no_column() -> None:
    whole = board(0.512, 0.4, 0.613)
    rows = [row if row.metric != "mota" else replace(row, value=None) for row in whole.rows]
    text = printed(board_table(replace(whole, rows=tuple(rows)), "tracking", 80))
    assert "MOTA" not in headings_of(text)
    assert "IDF1" in headings_of(text)


@pytest.mark.parametrize("name", ["camera", "fusion"])
def test_an_average_of_episodes_says_how_they_are_weighed(name: str) -> None:
    assert "weighed by their objects" in footnote(board(0.5, 0.4, 0.6, name), name, 80)


def test_footnotes_explain_what_is_shown() -> None:
    results = board(0.512, 0.4, 0.613, "detection")
    narrow = footnote(replace(results, manifest={"jobs": 4}), "detection", 80)
    wide = footnote(replace(results, manifest={"jobs": 1}), "detection", 320)
    assert "head." not in narrow
    assert "wider terminal" in narrow
    assert "head." in wide
    assert "wider terminal" not in wide
    assert "workers" not in wide
    assert "4 workers" in footnote(replace(results, manifest={"jobs": 4}), "detection", 320)


def test_times_of_processor_and_clock_stand_side_by_side_and_are_explained() -> None:
    results = board(0.512, 0.4, 0.613, "detection")
    text = printed(board_table(results, "detection", 320), width=320)
    assert {"ms", "p50", "wall"} <= set(headings_of(text))
    assert "processor time" in footnote(results, "detection", 320)


@pytest.mark.parametrize(
    ("seeds", "shown", "intervals"), [(3, True, True), (3, False, False), (1, True, False)]
)
def test_intervals_are_explained_where_there_are_any(seeds, shown, intervals) -> None:
    suite = load_suite("quick")
    some = replace(suite, seeds=suite.seeds[:seeds])
    text = explanation(some, ["detection", "tracking"], intervals=shown)
    assert ("95 %" in text) == intervals
    assert text.count("To be found") == 1


@pytest.mark.parametrize(("entry", "explained"), [("still", False), ("icp on oracle", True)])
def test_a_mark_is_explained_only_on_the_board_that_shows_it(entry, explained) -> None:
    places = [Standing("odometry", entry, "mark"), Standing("tracking", "gnn on oracle", "mark")]
    text = explanation(load_suite("odometry"), ["odometry", "tracking"], standings=places)
    assert ("'on oracle': without the returns" in text) is explained


def standing(entry: str, rank: int | None, behind=None, mark=None) -> Standing:
    gap = (None, None, None) if behind is None else behind
    return Standing("tracking", entry, mark, rank, rank, rank, *gap)


def ranked(*places: Standing) -> Results:
    rows = [Row(s.board, s.entry, "hota", 0.5, 0.4, 0.6, 9, "1", "higher") for s in places]
    return Results({}, tuple(rows), (), (), places)


def test_marks_have_rows_of_their_own_without_a_rank() -> None:
    results = ranked(standing("mine", 1), standing("all-in-one", None, mark="lower mark"))
    lines = printed(board_table(results, "tracking", 80)).splitlines()
    assert lines[-3].startswith("1 mine")
    assert not lines[-2].strip()
    assert lines[-1].startswith("  all-in-one (lower mark)")


def test_entries_that_may_be_as_good_as_the_best_are_named() -> None:
    best, near = standing("a", 1, (0.0, 0.0, 0.0)), standing("b", 2, (0.1, -0.01, 0.2))
    far = standing("c", 3, (0.3, 0.2, 0.4))
    text = comparison(ranked(best, near, far), "tracking")
    assert "a: b." in text
    assert "c" not in text.partition("By")[0].split("a: ")[1]
    assert "a is" in comparison(ranked(best, far), "tracking")
    assert comparison(ranked(best), "tracking") == ""
    assert comparison(ranked(best, standing("b", 2, (0.1, None, None))), "tracking") == ""


def test_recorded_data_are_compared_on_the_same_sequences() -> None:
    best, far = standing("a", 1, (0.0, 0.0, 0.0)), standing("b", 2, (0.3, 0.2, 0.4))
    places = tuple(replace(place, board="kitti car") for place in (best, far))
    assert "sequences" in comparison(ranked(*places), "kitti car")
    assert "seeds" in comparison(ranked(best, far), "tracking")


def test_what_was_not_measured_is_a_dash() -> None:
    results = board(None, None, None)
    known = replace(results.rows[0], entry="other", value=0.5)
    text = printed(board_table(replace(results, rows=(*results.rows, known)), "tracking", 80))
    assert "nan" not in text
    assert "None" not in text
    assert " - " in " ".join(text.split()) + " "
    assert results.nothing_eligible("tracking")
    assert not board(0.5, 0.4, 0.6).nothing_eligible("tracking")


def failed(*failures: Failure, entry: str = "mine", episodes: int = 3) -> Results:
    row = Row(
        "tracking", entry, "failed_episodes", len(failures), None, None, episodes, "1", "lower"
    )
    return Results({}, (row,), failures, (), (Standing("tracking", entry, None),))


def failure(seed: int, reason: str, entry: str = "mine") -> Failure:
    return Failure("tracking", entry, "merge", seed, "clear", f"{entry}: {reason}")


def test_why_an_entry_failed_is_said_once_for_each_reason_with_how_often() -> None:
    some = [failure(0, "KeyError: 'x'"), failure(1, "KeyError: 'x'"), failure(2, "late")]
    lines = failure_lines(failed(*some), "tracking")
    assert len(lines) == 2
    assert "2 of 3" in lines[0]
    assert "KeyError: 'x'" in lines[0]
    assert "late" in lines[1]
    every = failure_lines(failed(*[failure(s, "late") for s in range(3)]), "tracking")
    assert len(every) == 1
    assert "every episode" in every[0]
    assert every[0].count("mine") == 1
    assert failure_lines(board(0.5, 0.4, 0.6), "tracking") == []


def test_an_entry_that_is_not_installed_is_marked_and_named() -> None:
    reason = "norfair is not installed: pip install norfair"
    results = failed(*[replace(failure(s, reason), not_installed=True) for s in range(3)])
    (line,) = failure_lines(results, "tracking")
    assert line.endswith(reason)
    assert "failed" not in line
    text = printed(board_table(results, "tracking", 80))
    assert "(not installed)" in " ".join(text.split())


@pytest.mark.parametrize("width", WIDTHS)
def test_names_and_reasons_of_strangers_cannot_steer_a_terminal(width) -> None:
    entry = "\x1b[2J\x1b]0;mine\x07\r\nevil\u202e.py:X"
    results = failed(failure(0, "\x1b[31mred\x1b[0m\nnext", entry), entry=entry)
    shown = board(0.5, 0.4, 0.6, entry=entry)
    table = board_table(replace(shown, failures=results.failures), "tracking", width)
    text = printed(table, *failure_lines(results, "tracking"), width=200)
    assert not [letter for letter in text if letter in "\x1b\x07\r\u202e"]
    assert len(failure_lines(results, "tracking")[0].splitlines()) == 1
