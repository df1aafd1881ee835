"""Tables of scores in the documentation: made from results, and every comment names what exists."""

import re

import pytest

from research.method_scores import MARK, PAGES, rewritten
from roadscope import load_suite
from roadscope.benchmarks.boards import BOARDS
from roadscope.benchmarks.results import Results, Row, Standing

METRICS = {
    "best": {"f1": (0.913, 0.9, 0.92), "position_rmse_m": (0.25, None, None)},
    "oracle": {"f1": (1.0, 1.0, 1.0), "position_rmse_m": (None, None, None)},
}
RESULTS = Results(
    {},
    rows=tuple(
        Row("detection", entry, metric, *values, n=2, unit="", better="high")
        for entry, metrics in METRICS.items()
        for metric, values in metrics.items()
    ),
    failures=(),
    standings=(
        Standing("detection", "best", None, rank=1),
        Standing("detection", "oracle", "upper mark"),
    ),
)


def test_tables_below_comments_are_made_anew_and_the_rest_stays() -> None:
    marks = "<!-- scores: toy; f1, position_rmse_m -->", "<!-- scores: other; f1 -->"
    old = "\n\n| old |\n| --- |\n\n"
    page = rewritten(f"Before.\n\n{marks[0]}{old}Between.\n\n{marks[1]}{old}", {"toy": RESULTS})
    assert page == (
        f"Before.\n\n{marks[0]}\n\n| | F1 | pos. m |\n| --- | --- | --- |\n"
        "| best | 0.91 [0.90, 0.92] | 0.25 |\n| *oracle* (upper mark) | 1.00 | - |\n\n"
        f"Between.\n\n{marks[1]}{old}"
    )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_comments_name_suites_and_columns_of_the_table_below(page) -> None:
    text = page.read_text("utf-8")
    marks = re.findall(MARK, text)
    assert marks
    assert len(re.findall(rf"{MARK.pattern}\n\n\| \| ", text)) == len(marks)
    for suite, metrics in marks:
        columns = [c.metric for name in load_suite(suite).boards for c in BOARDS[name].columns]
        assert set(metrics.split(", ")) <= set(columns)
