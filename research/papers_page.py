"""Writes the tables of docs/papers.md from what `roadscope reproduce PAPER --out DIR` wrote.

A comment above a table says what stands in it: `<!-- verdicts: PAPER -->`, or
`<!-- figures: PAPER; EXPERIMENT -->` with all methods, or with some of them after another
semicolon, separated by ` / `. Tables of papers without a file in DIR stay as they are.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from research.page_tables import markdown_table, with_tables

MARK = re.compile(r"<!-- (verdicts|figures): ([^;]+?)(?:; (.+?))?(?:; (.+?))? -->")
Row = dict[str, Any]


def rewritten(page: str, results: dict[str, dict[str, list[Row]]]) -> str:
    """Return the page with its tables made anew; results: content of the files, by paper."""

    def table(comment: re.Match[str]) -> list[str] | None:
        kind, paper, experiment, methods = comment.groups()
        if paper not in results:
            return None
        if kind == "verdicts":
            return _verdicts(results[paper]["verdicts"])
        rows = [row for row in results[paper]["rows"] if row["experiment"] == experiment]
        if not rows:
            raise SystemExit(f"{paper} has no experiment {experiment!r}")
        return _figures(rows, methods.split(" / ") if methods else None)

    return with_tables(page, MARK, table)


def _verdicts(verdicts: Iterable[Row]) -> list[str]:
    cells = (
        [each["claim"], each["method"], _figure(each["value"], each, each["unit"]), each["verdict"]]
        for each in verdicts
    )
    return markdown_table(["claim", "of", "ours [95 %]", "verdict"], cells)


def _figures(rows: Sequence[Row], methods: Sequence[str] | None) -> list[str]:
    cells = {(row["method"], row["quantity"]): row for row in rows}
    quantities = {row["quantity"]: row["unit"] for row in rows}
    shown = ("m", "deg", "%", "px", "points", "1/scan")
    heads = [f"{name}, {unit}" if unit in shown else name for name, unit in quantities.items()]
    lines = []
    for method in methods or dict.fromkeys(row["method"] for row in rows):
        own = [cells[method, quantity] for quantity in quantities]
        lines.append([method, *(_figure(row["ours"], row) for row in own)])
        if any(row["paper"] is not None for row in own):
            lines.append(["*paper*", *(_number(row["paper"], digits=6) for row in own)])
    return markdown_table(["", *heads], lines)


def _figure(value: float | None, row: Row, unit: str = "") -> str:
    text = f"{_number(value)} {unit}".rstrip()
    low, high = row["low"], row["high"]
    return text if low is None or low == high else f"{text} [{_number(low)}, {_number(high)}]"


def _number(value: float | None, digits: int = 3) -> str:
    if value is None:
        return "-"
    whole = abs(value) >= 10**digits or float(value).is_integer()
    return f"{value:.0f}" if whole else f"{value:.{digits}g}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(
        prog="python -m research.papers_page",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("results", type=Path, help="folder with PAPER.json")
    parser.add_argument(
        "page", type=Path, nargs="?", default=Path("docs/papers.md"), help="to write"
    )
    options = parser.parse_args(arguments)
    results = {
        path.stem: json.loads(path.read_text("utf-8")) for path in options.results.glob("*.json")
    }
    page = options.page.read_text("utf-8")
    options.page.write_text(rewritten(page, results), "utf-8")


if __name__ == "__main__":
    main()
