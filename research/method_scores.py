"""Writes the scores of methods into the pages of the documentation.

A comment above a table says what stands in it: `<!-- scores: SUITE; METRIC, METRIC, ... -->`. The
results are DIR/SUITE.json, as `roadscope leaderboard BOARD --suite SUITE --json` prints them.
Tables of suites without a file in DIR stay as they are.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from research.page_tables import markdown_table, with_tables
from roadscope.benchmarks import Results
from roadscope.benchmarks.boards import BOARDS, Column

MARK = re.compile(r"<!-- scores: ([^;]+); (.+) -->")
PAGES = [Path("docs", f"{page}.md") for page in ("detectors", "trackers", "fusion")]


def rewritten(page: str, results: Mapping[str, Results]) -> str:
    """Return the page with its tables made anew; results: by suite."""

    def table(comment: re.Match[str]) -> list[str] | None:
        suite, metrics = comment.groups()
        return _scores(results[suite], metrics.split(", ")) if suite in results else None

    return with_tables(page, MARK, table)


def _scores(results: Results, metrics: Sequence[str]) -> list[str]:
    """Return the table of a board, best entry first, without those that are not installed."""
    (board,) = results.boards()
    of_metric = {column.metric: column for column in BOARDS[board].columns}
    columns = [of_metric[metric] for metric in metrics]
    lines = []
    for entry in results.entries(board):
        if results.not_installed(entry):
            continue
        mark = results.standing(board, entry).mark
        name = f"*{entry}*" if mark else entry
        if mark and mark not in entry:
            name += f" ({mark})"
        lines.append([name, *(_cell(results, board, entry, column) for column in columns)])
    return markdown_table(["", *(column.heading for column in columns)], lines)


def _cell(results: Results, board: str, entry: str, column: Column) -> str:
    """Return a figure with its interval."""
    row = results.row(board, entry, column.metric)
    if row is None or row.value is None:
        return "-"
    text = f"{row.value:.{column.decimals}f}"
    if row.low is None or row.high is None or row.low == row.high:
        return text
    return f"{text} [{row.low:.{column.decimals}f}, {row.high:.{column.decimals}f}]"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the pages."""
    parser = argparse.ArgumentParser(
        prog="python -m research.method_scores",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("results", type=Path, help="folder with SUITE.json")
    parser.add_argument("pages", type=Path, nargs="*", default=PAGES, help="to write")
    options = parser.parse_args(arguments)
    results = {
        path.stem: Results.from_json(path.read_bytes()) for path in options.results.glob("*.json")
    }
    for page in options.pages:
        page.write_text(rewritten(page.read_text("utf-8"), results), "utf-8")


if __name__ == "__main__":
    main()
