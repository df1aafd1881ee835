"""Tables of docs/papers.md: made from results, and every comment above one names what exists."""

from pathlib import Path

import pytest

from research.papers_page import MARK, rewritten
from roadscope.benchmarks.papers import PAPERS

PAGE = Path(__file__).parents[2] / "docs" / "papers.md"
ROW = {"experiment": "loop, long", "unit": "m", "paper": None, "low": None, "high": None, "n": 2}
ROWS = [
    {**ROW, "method": "a", "quantity": "end", "ours": 0.12345, "low": 0.1, "high": 0.2},
    {**ROW, "method": "a", "quantity": "points", "unit": "count", "ours": 28456.4},
    {**ROW, "method": "b", "quantity": "end", "ours": None, "paper": 0.1736},
    {**ROW, "method": "b", "quantity": "points", "unit": "count", "ours": 3.0},
]
VERDICT = {"claim": "it ends", "method": "a", "unit": "m", "verdict": "open", "value": 1.5} | {
    "low": -1.0,
    "high": 4.0,
}
RESULTS = {"toy": {"rows": ROWS, "verdicts": [VERDICT]}}


def page(*marks: str) -> str:
    tables = "\n\n".join(f"{mark}\n\n| old |\n|---|\n| 1 |" for mark in marks)
    return f"Before.\n\n{tables}\n\nAfter.\n"


def test_tables_below_comments_are_made_anew_and_the_rest_stays() -> None:
    marks = (
        "<!-- verdicts: toy -->",
        "<!-- figures: toy; loop, long -->",
        "<!-- figures: toy; loop, long; b -->",
        "<!-- figures: other; loop, long -->",
    )
    head = "| | end, m | points |\n| --- | --- | --- |\n"
    b = "| b | - | 3 |\n| *paper* | 0.1736 | - |"
    assert rewritten(page(*marks), RESULTS) == (
        f"Before.\n\n{marks[0]}\n\n| claim | of | ours [95 %] | verdict |\n"
        "| --- | --- | --- | --- |\n| it ends | a | 1.5 m [-1, 4] | open |\n\n"
        f"{marks[1]}\n\n{head}| a | 0.123 [0.1, 0.2] | 28456 |\n{b}\n\n"
        f"{marks[2]}\n\n{head}{b}\n\n"
        f"{marks[3]}\n\n| old |\n|---|\n| 1 |\n\nAfter.\n"
    )


def test_made_twice_it_is_the_same() -> None:
    once = rewritten(page("<!-- figures: toy; loop, long -->"), RESULTS)
    assert rewritten(once, RESULTS) == once


def test_an_experiment_that_is_not_there_is_an_error() -> None:
    with pytest.raises(SystemExit, match="no experiment 'race'"):
        rewritten(page("<!-- figures: toy; race -->"), RESULTS)


def test_comments_of_the_page_are_read_and_name_papers() -> None:
    comments = [line for line in PAGE.read_text("utf-8").splitlines() if line.startswith("<!--")]
    marks = [MARK.fullmatch(line) for line in comments]
    assert {mark[2] for mark in marks if mark} == set(PAPERS)
    assert all(marks)
