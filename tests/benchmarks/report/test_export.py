import csv
import html
import io
import json
import re
from dataclasses import replace

import pytest

from roadscope.benchmarks import FolderError
from roadscope.benchmarks.report import (
    check_targets,
    earlier_boards,
    label_of,
    latex_text,
    save_all,
    to_csv,
    to_latex,
    to_markdown,
)
from roadscope.benchmarks.results import Failure, Results, Row, Standing

ROWS = (
    Row("detection", "mine|yours", "f1", 0.5, 0.4, 0.6, 9, "1", "higher"),
    Row("detection", "mine|yours", "call_p50_ms", None, None, None, 0, "ms", "lower"),
)
PARTS = (
    Row(
        "detection",
        "mine|yours",
        "detection_rate",
        0.9,
        0.8,
        1.0,
        9,
        "1",
        "higher",
        "range",
        "0-20",
        70,
    ),
    Row(
        "detection",
        "mine|yours",
        "precision",
        0.7,
        0.6,
        0.8,
        9,
        "1",
        "higher",
        "weather",
        "fog",
        90,
    ),
)
PLACES = (
    Standing("detection", "mine|yours", None, 1, 1, 3),
    Standing("detection", "all", "lower mark"),
)
RESULTS = Results({"suite": "tiny"}, ROWS, (), PARTS, PLACES)


def test_csv_has_a_line_for_each_row() -> None:
    lines = list(csv.DictReader(io.StringIO(to_csv(RESULTS))))
    assert [line["metric"] for line in lines] == [row.metric for row in (*ROWS, *PARTS)]
    assert [line["by"] for line in lines] == ["", "", "range", "weather"]
    assert lines[2]["band"] == "0-20"
    assert lines[2]["samples"] == "70"
    assert float(lines[0]["value"]) == 0.5
    assert lines[1]["value"] == ""


def test_markdown_has_a_row_for_each_entry() -> None:
    text = to_markdown(RESULTS)
    assert "| 1 [1, 3] | mine\\|yours | 0.50 [.40, .60] |" in text
    tables = [block for block in text.split("\n\n") if block.startswith("|")]
    assert len(tables) == 3
    for table in tables:
        widths = {line.replace("\\|", "").count("|") for line in table.splitlines()}
        assert len(widths) == 1


def test_markdown_has_what_is_broken_down() -> None:
    text = to_markdown(RESULTS)
    assert "### detected by range, m\n\n| entry | 0-20 |" in text
    assert (
        "### precision by weather\n\n| entry | fog |\n| --- | --- |\n| mine\\|yours | 0.70 |"
        in text
    )


def test_latex_has_a_tabular_for_each_table() -> None:
    text = to_latex(RESULTS)
    assert text.count(r"\begin{tabular}") == text.count(r"\end{tabular}") == 3
    assert r"1 [1, 3] & mine\textbar{}yours & 0.50 [.40, .60] &" in text
    assert r"% detected by range, m" in text
    for table in text.split("\n\n"):
        rows = [line for line in table.splitlines() if line.endswith(r"\\")]
        alignment = table.partition("tabular}{")[2].partition("}")[0]
        assert {row.count(" & ") + 1 for row in rows} == {len(alignment)}


def test_latex_prints_what_it_would_read() -> None:
    assert latex_text("a_b 5% {c}") == r"a\_b 5\% \{c\}"
    assert latex_text("x?a=1&b=~") == r"x?a=1\&b=\textasciitilde{}"
    assert latex_text("<a|b>") == r"\textless{}a\textbar{}b\textgreater{}"


def test_all_files_are_written(tmp_path) -> None:
    paths = save_all(RESULTS, tmp_path)
    assert [path.suffix for path in paths] == [".json", ".csv", ".md", ".tex", ".svg"]
    assert json.loads(paths[0].read_text())["rows"][1]["value"] is None


def test_a_folder_at_the_place_of_a_file_is_named(tmp_path) -> None:
    check_targets(tmp_path)
    (tmp_path / "leaderboard.csv").mkdir()
    with pytest.raises(FolderError, match=r"leaderboard\.csv: it is a folder"):
        check_targets(tmp_path)


def test_an_entry_that_failed_everywhere_has_no_rank_and_a_reason() -> None:
    place = Standing("detection", "all", None, reason="all: KeyError: 'x' (a.py:3)")
    row = Row("detection", "all", "failed_episodes", 3, None, None, 3, "1", "lower")
    failures = tuple(
        Failure("detection", "all", "merge", seed, "clear", place.reason) for seed in range(3)
    )
    results = replace(RESULTS, rows=(*ROWS, row), failures=failures, standings=(PLACES[0], place))
    text = to_markdown(results)
    assert "| failed | all |" in text
    assert "KeyError: 'x' (a.py:3)" in text
    content = json.loads(results.to_json())
    assert content["standings"][1]["rank"] is None
    assert [failure["seed"] for failure in content["failures"]] == [0, 1, 2]


HOSTILE = [
    "=cmd|' /C calc'!A0",
    "+1+1",
    "-2+3",
    "@SUM(1)",
    "a\n| b | <script>alert(1)</script>",
    "\x1b[31mred\x1b[0m",
    r"\input{/etc/passwd} $x^2$ 50% #1 a_b ~ {c} &",
    '"quoted", comma',
    "[2cm] stars * and *",
    "[click](https://evil.example) ![seen](https://evil.example/x.png) [a][b]",
    "*bold* _sloped_ `code` ~~gone~~ a\\|b \\*c\\*",
]


ELEMENTS = {"h2", "h3", "p", "table", "thead", "tbody", "tr", "th", "td"}


def rendered(markdown: str) -> str:
    """Return HTML as a reader of Markdown makes it."""
    from markdown_it import MarkdownIt

    return MarkdownIt("commonmark").enable(["table", "strikethrough"]).render(markdown)


def of_entry(entry: str) -> Results:
    """Return results whose entry and band have a stranger's name, and its reason too."""
    rows = tuple(replace(row, entry=entry) for row in ROWS)
    parts = tuple(replace(row, entry=entry, band=entry, by="condition") for row in PARTS)
    failures = (Failure("detection", entry, "merge", 1, "clear", f"{entry}: {entry}"),)
    return Results({}, rows, failures, parts, (replace(PLACES[0], entry=entry),))


@pytest.mark.parametrize("entry", HOSTILE)
def test_no_cell_of_a_csv_file_is_a_formula(entry) -> None:
    text = to_csv(of_entry(entry))
    cells = [cell for line in csv.reader(io.StringIO(text)) for cell in line]
    assert not [cell for cell in cells if cell.startswith(("=", "+", "-", "@", "\t", "\r"))]
    assert len(text.splitlines()) == 1 + len(ROWS) + len(PARTS)
    assert "\x1b" not in text


def test_numbers_of_a_csv_file_stay_numbers() -> None:
    rows = (replace(ROWS[0], value=-1.5, low=-2.0, high=-1.0),)
    (line,) = csv.DictReader(io.StringIO(to_csv(replace(RESULTS, rows=rows, parts=()))))
    assert [float(line[name]) for name in ("value", "low", "high")] == [-1.5, -2.0, -1.0]


@pytest.mark.parametrize("entry", HOSTILE)
def test_a_name_cannot_leave_its_cell_of_a_markdown_table(entry) -> None:
    text = to_markdown(of_entry(entry))
    assert "<script" not in text
    assert "\x1b" not in text
    tables = [block for block in text.split("\n\n") if block.startswith("|")]
    assert len(tables) == 3
    for table in tables:
        assert len(table.splitlines()) == 3
        assert len({line.replace("\\|", "").count("|") for line in table.splitlines()}) == 1


@pytest.mark.parametrize("entry", HOSTILE)
def test_markdown_shows_a_name_as_it_is(entry) -> None:
    page = rendered(to_markdown(of_entry(entry)))
    assert set(re.findall(r"<(\w+)", page)) <= ELEMENTS
    cells = [html.unescape(cell) for cell in re.findall(r"<td[^>]*>(.*?)</td>", page)]
    shown = re.sub(r"\s+", " ", entry.replace("\x1b", "?"))
    assert cells.count(shown) == 3


@pytest.mark.parametrize("entry", HOSTILE)
def test_no_row_of_latex_begins_with_an_argument(entry) -> None:
    assert not [line for line in to_latex(of_entry(entry)).splitlines() if line[:1] in ("[", "*")]


@pytest.mark.parametrize("entry", HOSTILE)
def test_latex_runs_nothing_of_a_name(entry) -> None:
    text = to_latex(of_entry(entry))
    assert r"\input" not in text
    assert "\x1b" not in text
    for line in text.splitlines():
        if line.endswith(r"\\"):
            bare = re.sub(r"\\text[a-z]+\{\}", "", line[:-2])
            bare = re.sub(r"\\[&%$#_{}]|\{\}(?=[\[*])", "", bare).replace(" & ", "")
            assert not set(bare) & set("\\&%$#_{}~^<>|")
    assert text.count("\n") == to_latex(of_entry("plain")).count("\n")


def of_suite(suite, *boards) -> Results:
    return replace(RESULTS, manifest={"suite": suite, "boards": list(boards)})


def suite_in(path) -> str:
    return json.loads(path.read_text())["manifest"]["suite"]


def test_a_board_of_another_suite_is_kept_beside_the_latest(tmp_path) -> None:
    save_all(of_suite("quick", "tracking"), tmp_path)
    save_all(of_suite("kitti", "tracking"), tmp_path)
    save_all(of_suite("quick", "detection", "tracking"), tmp_path)
    board_names = [path.name for path in earlier_boards(tmp_path)]
    assert board_names == ["leaderboard-kitti-tracking.json", "leaderboard-quick-tracking.json"]
    assert [suite_in(tmp_path / name) for name in board_names] == ["kitti", "quick"]
    assert suite_in(tmp_path / "leaderboard.json") == "quick"
    assert (tmp_path / "leaderboard-kitti-tracking.csv").is_file()
    save_all(of_suite("kitti", "tracking"), tmp_path)
    board_names = [path.name for path in earlier_boards(tmp_path)]
    assert board_names == [
        "leaderboard-quick-detection-tracking.json",
        "leaderboard-quick-tracking.json",
    ]
    assert suite_in(tmp_path / "leaderboard.json") == "kitti"


def test_the_same_board_again_takes_its_place(tmp_path) -> None:
    for _ in range(2):
        save_all(of_suite("quick", "tracking"), tmp_path)
    assert earlier_boards(tmp_path) == []
    assert len(list(tmp_path.iterdir())) == 5


def test_what_is_no_board_is_overwritten(tmp_path) -> None:
    (tmp_path / "leaderboard.json").write_text("[1")
    save_all(of_suite("quick", "tracking"), tmp_path)
    assert suite_in(tmp_path / "leaderboard.json") == "quick"


def test_names_of_suites_are_names_of_files() -> None:
    manifest = {"suite": "../my suite", "boards": ["kitti car"]}
    assert label_of(manifest) == "..-my-suite-kitti-car"
    believed = {"suite": "fusion", "boards": ["fusion"], "calibration": "off by one.json"}
    assert label_of(believed) == "fusion-fusion-off-by-one"


def test_a_board_of_fusions_says_which_calibration_they_believed() -> None:
    row, place = replace(ROWS[0], board="fusion"), replace(PLACES[0], board="fusion")
    results = Results({"suite": "tiny"}, (*ROWS, row), (), (), (*PLACES, place))
    believed = to_markdown(replace(results, manifest={"calibration": "mine.json"}))
    assert believed.count("mine.json") == 1


def test_a_folder_where_a_board_would_be_kept_is_named(tmp_path) -> None:
    save_all(of_suite("quick", "tracking"), tmp_path)
    (tmp_path / "leaderboard-quick-tracking.md").mkdir()
    with pytest.raises(FolderError, match=r"leaderboard-quick-tracking\.md: it is a folder"):
        check_targets(tmp_path, "kitti-tracking")
