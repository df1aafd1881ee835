"""Leaderboards as files for other programs: JSON, CSV, Markdown, LaTeX, and a picture."""

from __future__ import annotations

import csv
import html
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roadscope.benchmarks.boards import Board, board_named
from roadscope.benchmarks.boards.board import Column
from roadscope.benchmarks.cache import write_text
from roadscope.benchmarks.report.board_files import CURVES, NAME, PICTURE, label_of, set_aside
from roadscope.benchmarks.report.breakdowns import parts_of
from roadscope.benchmarks.report.curves import draw_curves, has_curves, save_figure, styled_figures
from roadscope.benchmarks.report.tables import (
    MOST_NAME_WIDTH,
    failure_lines,
    figure,
    is_time,
    measured_columns,
    wrapped_name,
)
from roadscope.benchmarks.report.track_files import folder_names
from roadscope.benchmarks.results import Results, Row
from roadscope.core.palette import PAPER_COLOURS, PAPER_FAINT
from roadscope.core.text import one_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORMULA_SIGNS = ("=", "+", "-", "@", "\t", "\r")
"""Texts that begin with these are formulas for a spreadsheet (OWASP, CSV injection)."""
LOGS = "logs"
"""Folder for the output of failed entries."""
LATEX_ESCAPES = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
}


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table as texts: its title, headings and rows."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]


def save_all(results: Results, folder: Path) -> list[Path]:
    """Write `leaderboard.json`, `.csv`, `.md` and `.tex` to a folder and return their paths.

    Beside them `boards.svg`, the headline metrics and times, and with an odometry board
    `drift.svg`, its drift over the distance driven. Existing files of another suite or of other
    boards are renamed (`leaderboard-SUITE-BOARD[-CALIBRATION].json`).
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
        write_text(path, content)
    paths.append(folder / PICTURE)
    draw_boards(results, paths[-1])
    if has_curves(results):
        paths.append(folder / CURVES)
        draw_curves(results, paths[-1])
    return paths


def save_logs(results: Results, folder: Path) -> Results:
    """Write the output of failed entries to `logs/BOARD-ENTRY.txt`; return results with the paths.

    A file has the output of every failed episode of an entry, after the reason.
    """
    printed = [failure for failure in results.failures if failure.log]
    names = folder_names([failure.entry for failure in printed])
    files = {f: folder / LOGS / f"{f.board}-{names[f.entry]}.txt" for f in printed}
    texts: dict[Path, str] = {}
    for failure, path in files.items():
        place = f"{failure.scenario}, seed {failure.seed}, {failure.condition}"
        texts[path] = texts.get(path, "") + f"{place}: {failure.reason}\n{failure.log}\n\n"
    for path, text in texts.items():
        write_text(path, text)
    named = (replace(f, log_file=str(files.get(f, ""))) for f in results.failures)
    return replace(results, failures=tuple(named))


def to_csv(results: Results) -> str:
    """Return one line for each row of the JSON: first those of whole episodes, then breakdowns."""
    text = StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(Row)], lineterminator="\n")
    writer.writeheader()
    for row in (*results.rows, *results.parts):
        writer.writerow({name: _csv_cell(value) for name, value in asdict(row).items()})
    return text.getvalue()


def to_markdown(results: Results) -> str:
    """Return each board as a table, with intervals of its headline metric, then its breakdowns."""
    sections = []
    for name in results.boards():
        table = _board_table(results, name)
        lines = [f"## {name}", "", *_markdown_table(table), *_paragraphs(results, name)]
        for part in _part_tables(results, name):
            lines += ["", f"### {markdown_text(part.title)}", "", *_markdown_table(part)]
        sections.append("\n".join(lines))
    return "\n\n".join(sections) + "\n"


def to_latex(results: Results) -> str:
    """Return each board as a tabular (package booktabs), then its breakdowns."""
    tables = []
    for name in results.boards():
        board = _board_table(results, name)
        tables.append(_latex_table(board, "rl" + "r" * (len(board.headings) - 2)))
        tables += [
            _latex_table(part, "l" + "r" * (len(part.headings) - 1))
            for part in _part_tables(results, name)
        ]
    return "\n\n".join(tables) + "\n"


def latex_text(text: str) -> str:
    """Return text escaped for LaTeX."""
    line = one_line(text)
    # After the end of a row, LaTeX takes these for arguments of it.
    start = "{}" if line.startswith(("[", "*")) else ""
    return start + "".join(LATEX_ESCAPES.get(letter, letter) for letter in line)


def _board_table(results: Results, name: str) -> TextTable:
    board = board_named(name)
    rows = []
    for entry in results.entries(name):
        cells = [
            figure(
                results.row(name, entry, column.metric),
                column.decimals,
                interval=column.metric == board.headline,
            )
            for column in board.columns
        ]
        rows.append([results.standing(name, entry).place, entry, *cells])
    headings = ["", board.kind.name, *(column.heading for column in board.columns)]
    return TextTable(f"{name} board", headings, rows)


def _part_tables(results: Results, name: str) -> Iterator[TextTable]:
    for breakdown in board_named(name).breakdowns:
        for part in parts_of(results, name, breakdown.by):
            rows = [
                [entry, *(part.text(entry, band) for band in part.bands)]
                for entry in results.entries(name)
            ]
            yield TextTable(part.title, ["entry", *part.bands], rows)


def _paragraphs(results: Results, name: str) -> list[str]:
    """Return the remark and failures of a board as lines, each with an empty line before it."""
    remark = board_named(name).remark(results.manifest.get("calibration", ""))
    texts = [*([remark] if remark else []), *failure_lines(results, name)]
    return [line for text in texts for line in ("", markdown_text(text))]


def _csv_cell(value: Any) -> Any:
    """Return a cell that no spreadsheet reads as a formula."""
    if not isinstance(value, str):
        return value
    text = one_line(value)
    return f"'{text}" if text.startswith(FORMULA_SIGNS) else text


def markdown_text(text: str) -> str:
    """Return text escaped for a cell of a Markdown table: no link, no emphasis, no HTML."""
    plain = re.sub(r"[\\`*_|~]|!(?=\[)|(?<=\])[(\[:]", r"\\\g<0>", one_line(text))
    return html.escape(plain, quote=False)


def _markdown_table(table: TextTable) -> list[str]:
    rule = ["---"] * len(table.headings)
    rows = [list(map(markdown_text, row)) for row in (table.headings, *table.rows)]
    return ["| " + " | ".join(row) + " |" for row in (rows[0], rule, *rows[1:])]


def _latex_table(table: TextTable, alignment: str) -> str:
    headings, *lines = (
        " & ".join(map(latex_text, row)) + r" \\" for row in (table.headings, *table.rows)
    )
    begin = [f"% {one_line(table.title)}", rf"\begin{{tabular}}{{{alignment}}}", r"\toprule"]
    return "\n".join([*begin, headings, r"\midrule", *lines, r"\bottomrule", r"\end{tabular}"])


# --------------------------------------------------------------------------------------------------
# A picture: the headline metric and the time of each entry.

WIDTH_INCHES, LINE_INCHES, AROUND_INCHES = 9.0, 0.19, 0.9
"""Width of the picture, height of one line of a name, and what title and axis of a board need."""
SPREAD = 30.0
"""An axis is logarithmic if its greatest value is so many times the least; chosen by hand."""


def draw_boards(results: Results, path: Path) -> None:
    """Write a picture of each board: its headline metric and its first time, with 95 % intervals.

    Entries are in rank order; marks follow and are hollow. The path's ending decides the format:
    svg, png or pdf.
    """
    boards = [board_named(name) for name in results.boards()]
    names = {
        board.name: [
            wrapped_name(one_line(entry), MOST_NAME_WIDTH) for entry in results.entries(board.name)
        ]
        for board in boards
    }
    heights = [
        AROUND_INCHES + LINE_INCHES * sum(1 + name.count("\n") for name in own)
        for own in names.values()
    ]
    with styled_figures() as new_figure:
        figure = new_figure(WIDTH_INCHES, sum(heights))
        panels = figure.subplots(
            len(boards), 2, squeeze=False, sharey="row", height_ratios=heights, width_ratios=(3, 2)
        )
        for board, places in zip(boards, panels, strict=True):
            columns = measured_columns(results, board)
            shown = [column for column in columns if column.metric == board.headline]
            shown += [column for column in columns if is_time(column)][:1]
            for place, column in zip(places, shown, strict=False):
                _draw_column(place, results, board, column)
            for place in places[len(shown) :]:
                place.set_axis_off()
            places[0].set_title(f"{board.name} board", loc="left")
            places[0].set_yticks(range(len(names[board.name])), names[board.name])
            places[0].set_ylim(len(names[board.name]) - 0.5, -0.5)
            for label in places[0].get_yticklabels():
                label.set_parse_math(False)
        save_figure(figure, path)


def _draw_column(place: Axes, results: Results, board: Board, column: Column) -> None:
    """Draw one metric of all entries that have it, one below the other."""
    values: list[float] = []
    better = ""
    for line, entry in enumerate(results.entries(board.name)):
        row = results.row(board.name, entry, column.metric)
        if row is None or row.value is None:
            continue
        values.append(row.value)
        better = row.better
        ranked = results.standing(board.name, entry).mark is None
        colour = PAPER_COLOURS[0] if ranked else PAPER_FAINT
        if row.low is not None and row.high is not None:
            place.plot([row.low, row.high], [line, line], color=colour, linewidth=1.2)
        face = colour if ranked else "white"
        place.plot(row.value, line, "o", color=colour, markerfacecolor=face, markersize=4.5)
    place.set_xlabel(f"{column.heading} ({better} is better)")
    if _is_spread(values):
        place.set_xscale("log")


def _is_spread(values: Sequence[float]) -> bool:
    """Return whether positive values need a logarithmic axis."""
    return bool(values) and min(values) > 0 and max(values) > SPREAD * min(values)
