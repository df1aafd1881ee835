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

MARK = re.compile(r"<!-- (verdicts|figures): ([^;]+?)(?:; (.+?))?(?:; (.+?))? -->")
Row = dict[str, Any]


def rewritten(page: str, results: dict[str, dict[str, list[Row]]]) -> str:
    """Return the page with its tables made anew; results: content of the files, by paper."""
    lines, out = page.split("\n"), []
    while lines:
        out.append(lines.pop(0))
        mark = MARK.fullmatch(out[-1])
        if mark is None or mark[2] not in results:
            continue
        while lines and (not lines[0] or lines[0].startswith("|")):
            lines.pop(0)
        kind, paper, experiment, methods = mark.groups()
        if kind == "verdicts":
            table = _verdicts(results[paper]["verdicts"])
        else:
            rows = [row for row in results[paper]["rows"] if row["experiment"] == experiment]
            if not rows:
                raise SystemExit(f"{paper} has no experiment {experiment!r}")
            table = _figures(rows, methods.split(" / ") if methods else None)
        out += ["", *table, ""]
    return "\n".join(out)


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


def markdown_table(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table."""
    rows = [heads, ["---"] * len(heads), *lines]
    return ["| " + " | ".join(cells).lstrip() + " |" for cells in rows]


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
