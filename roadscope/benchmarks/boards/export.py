"""Leaderboards as files for other programs."""

from __future__ import annotations

import csv
from dataclasses import asdict, fields
from functools import partial
from io import StringIO
from pathlib import Path

from roadscope.benchmarks.boards.breakdown_tables import markdown_lines, markdown_row
from roadscope.benchmarks.boards.columns import COLUMNS, in_one_line
from roadscope.benchmarks.boards.curves import draw_curves, has_curves
from roadscope.benchmarks.boards.kept import CURVES, NAME, label_of, set_aside
from roadscope.benchmarks.boards.latex import to_latex
from roadscope.benchmarks.boards.results import Results
from roadscope.benchmarks.boards.rows import FIRST_METRIC, Row
from roadscope.benchmarks.boards.tables import believed_lines, failure_lines, figure
from roadscope.benchmarks.cache import write_atomically


def save_all(results: Results, folder: Path) -> list[Path]:
    """Write `leaderboard.json`, `.csv`, `.md` and `.tex` to a folder and return their paths.

    With an odometry board also `drift.svg`, its drift against the distance driven. Files of another
    suite or of other boards that are there are kept under names of their own
    (`leaderboard-SUITE-BOARD[-CALIBRATION].json`).
    """
    set_aside(folder, label_of(results.manifest))
    contents = {
        "json": results.to_json(),
        "csv": to_csv(results),
        "md": to_markdown(results),
        "tex": to_latex(results),
    }
    paths = [folder / f"{NAME}.{ending}" for ending in contents]
    for path, content in zip(paths, contents.values(), strict=True):
        write_atomically(path, partial(_write, content))
    if has_curves(results):
        paths.append(folder / CURVES)
        draw_curves(results, paths[-1])
    return paths


def _write(content: str, path: Path) -> None:
    path.write_text(content, encoding="utf-8")


def to_csv(results: Results) -> str:
    """Return one line for each row, as in the JSON: the whole first, then its parts."""
    text = StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(Row)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in (*results.rows, *results.parts))
    return text.getvalue()


def to_markdown(results: Results) -> str:
    """Return each board as a table, intervals with its first figure, then broken down."""
    return "\n\n".join(_board(results, board) for board in results.boards()) + "\n"


def _board(results: Results, board: str) -> str:
    columns, first = COLUMNS[board], FIRST_METRIC[board]
    texts = [in_one_line(heading) for heading, _ in columns.values()]
    headings = ["", "entry", *texts]
    lines = [f"## {board}", "", markdown_row(headings), markdown_row(["---"] * len(headings))]
    for entry in results.entries(board):
        place = results.standing(board, entry)
        cells = [
            figure(results.row(board, entry, metric), digits, interval=metric == first)
            for metric, (_, digits) in columns.items()
        ]
        lines.append(markdown_row([place.place, entry.replace("|", "\\|"), *cells]))
    for text in (*believed_lines(results, board), *failure_lines(results, board)):
        lines += ["", text]
    return "\n".join([*lines, *markdown_lines(results, board)])
