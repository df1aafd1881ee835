"""Leaderboards as files for other programs."""

from __future__ import annotations

import csv
from dataclasses import asdict, fields
from functools import partial
from io import StringIO
from pathlib import Path

from roadscope.benchmarks.cache import FolderError, write_atomically
from roadscope.benchmarks.results import FIRST_METRIC, Results, Row
from roadscope.benchmarks.tables import COLUMNS, figure

NAME = "leaderboard"


def save_all(results: Results, folder: Path) -> list[Path]:
    """Write `leaderboard.json`, `.csv` and `.md` to a folder and return their paths."""
    contents = {"json": results.to_json(), "csv": to_csv(results), "md": to_markdown(results)}
    paths = [folder / f"{NAME}.{ending}" for ending in contents]
    for path, content in zip(paths, contents.values(), strict=True):
        write_atomically(path, partial(_write, content))
    return paths


def check_targets(folder: Path) -> None:
    """Refuse a folder where something else has the name of a board, before anything is run."""
    for ending in ("json", "csv", "md"):
        path = folder / f"{NAME}.{ending}"
        if path.is_dir():
            raise FolderError(f"cannot write {path}: it is a folder")


def _write(content: str, path: Path) -> None:
    path.write_text(content, encoding="utf-8")


def to_csv(results: Results) -> str:
    """Return one line for each row, as in the JSON."""
    text = StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(Row)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in results.rows)
    return text.getvalue()


def to_markdown(results: Results) -> str:
    """Return a table for each board, intervals with its first figure."""
    return "\n\n".join(_board(results, board) for board in results.boards()) + "\n"


def _board(results: Results, board: str) -> str:
    columns = COLUMNS[board]
    texts = [heading.replace("-\n", "").replace("\n", " ") for heading, _ in columns.values()]
    headings = ["entry", *texts]
    lines = [f"## {board}", "", _line(headings), _line(["---"] * len(headings))]
    first = FIRST_METRIC[board]
    for entry in results.entries(board):
        cells = [
            figure(results.row(board, entry, metric), digits, interval=metric == first)
            for metric, (_, digits) in columns.items()
        ]
        lines.append(_line([entry.replace("|", "\\|"), *cells]))
    return "\n".join(lines)


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"
