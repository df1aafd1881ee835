"""Tables of results broken down, for a terminal and for files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rich.table import Table
from rich.text import Text

from roadscope.benchmarks.boards import Board, board_named
from roadscope.benchmarks.boards.board import Breakdown
from roadscope.benchmarks.metrics.breakdown import BANDS
from roadscope.benchmarks.recorded.combined import NEES_BAND
from roadscope.benchmarks.report.tables import figure, wrapped_name
from roadscope.benchmarks.results import Results, Row
from roadscope.benchmarks.tables import plain_table
from roadscope.core.text import one_line

NEES, ALL, FALSE_ALARMS, DETECTION_RATE = ("nees_position", "all", "false_alarms", "detection_rate")
NAME_WIDTH, LONGEST_WORD = 24, 22
"""Greatest width of the entry's column and of a word in a heading, characters."""

Cells = Mapping[tuple[str, str], Row]
Remarks = Mapping[tuple[str, str], str]
"""Text in brackets behind a figure, by entry and band."""


@dataclass(frozen=True, slots=True)
class Part:
    """One metric of a board, broken down.

    cells: rows by entry and band. remarks: texts in brackets behind figures.
    """

    title: str
    metric: str
    cells: Cells
    remarks: Remarks
    bands: tuple[str, ...]

    def text(self, entry: str, band: str) -> str:
        """Return a figure as it is shown."""
        row = self.cells.get((entry, band))
        text = figure(row, 0 if self.metric == FALSE_ALARMS else 2, interval=False)
        remark = self.remarks.get((entry, band))
        return text if remark is None else f"{text} ({remark})"

    def width(self, band: str) -> int:
        """Return the width of a band's column at which no figure and no usual word is broken."""
        words = [word[:LONGEST_WORD] for word in band.split()]
        cells = {*self.cells, *self.remarks}
        texts = [self.text(entry, own) for entry, own in cells if own == band]
        return max(map(len, [*words, *texts, "100"]))


def breakdown_tables(
    results: Results, name: str, by: str, width: int, *, metrics: Sequence[str] = ()
) -> list[Table]:
    """Return a table of each metric: entries by bands, in rank order.

    metrics: only these, if there are any. Bands that do not fit in the width are in a further
    table.
    """
    tables = []
    for part in parts_of(results, name, by):
        if metrics and part.metric not in metrics:
            continue
        widths = {band: part.width(band) for band in part.bands}
        name_width = min(NAME_WIDTH, width - max(widths.values()) - 2)
        for number, bands in enumerate(_pages(widths, width - name_width)):
            table = _table(results, name, part, bands, name_width=name_width)
            table.title = part.title + (", continued" if number else "")
            rows, board = results.breakdown(by, name), board_named(name)
            if part.metric == DETECTION_RATE:
                eligible = [(r.band, r.samples) for r in rows if r.metric == DETECTION_RATE]
                unseen = [
                    (r.band, round((r.value or 0.0) * r.samples))
                    for r in rows
                    if r.metric == "unseen_per_frame"
                ]
                _add_counts(table, "to be found", eligible, bands)
                _add_counts(table, "too few returns", unseen, bands)
            if by == "sequence" and part.metric == board.headline and board.object_metric:
                frames = [(r.band, r.samples) for r in rows if r.metric == board.object_metric]
                _add_counts(table, "object frames", frames, bands, even_zero=True)
            tables.append(table)
    return tables


def note(name: str, by: str) -> str:
    """Return the explanation below a board's tables of a breakdown; often empty."""
    return _breakdown(board_named(name), by).note


def parts_of(results: Results, name: str, by: str) -> Iterator[Part]:
    """Yield each metric of a board that is shown broken down."""
    board = board_named(name)
    rows = _rows_with_whole(results, board, by)
    # A band without objects is left out: matched detections may lie a little beyond the farthest.
    headline = board.shown_parts[0].metric
    shown_bands = {row.band for row in rows if row.metric == headline}
    shown_bands |= {ALL} if shown_bands else set()
    for column in board.shown_parts:
        metric = column.metric
        own = [row for row in rows if row.metric == metric]
        if metric == FALSE_ALARMS:
            cells = {(row.entry, row.band): row for row in own}
        else:
            cells = {(r.entry, r.band): r for r in own if not shown_bands or r.band in shown_bands}
        if by == "sequence" and cells and metric not in (NEES, FALSE_ALARMS):
            alarms = [r for r in rows if r.metric == FALSE_ALARMS]
            empty = [replace(row, metric=metric, value=None, samples=0) for row in alarms]
            cells = {(row.entry, row.band): row for row in empty} | cells
        if not cells:
            continue
        ranked = {cell: r for cell, r in cells.items() if not results.standing(name, r.entry).mark}
        remarks, remarks_name = _remarks(board, metric, by, rows, ranked)
        bands = tuple(bands_of(list(cells.values())))
        heading = f"{column.heading}{remarks_name} by {_breakdown(board, by).title or by}"
        yield Part(heading, metric, cells, remarks, bands)


def bands_of(rows: Sequence[Row]) -> list[str]:
    """Return the bands of rows: quantities and sequences ascending, conditions as in the suite."""
    bands = dict.fromkeys(row.band for row in rows)
    if rows and rows[0].by == "sequence":
        return sorted(bands, key=lambda band: (band == ALL, band))
    ordered = BANDS[rows[0].by].labels if rows and rows[0].by in BANDS else tuple(bands)
    first = [band for band in ordered if band in bands]
    return first + [band for band in bands if band not in first]


def _breakdown(board: Board, by: str) -> Breakdown:
    return next(each for each in board.breakdowns if each.by == by)


def _rows_with_whole(results: Results, board: Board, by: str) -> list[Row]:
    """Return the rows of a breakdown; of sequences with the NEES of all sequences."""
    parts = results.breakdown(by, board.name)
    if by != "sequence":
        return parts
    whole = [row for row in results.rows if row.board == board.name]
    return parts + [
        replace(row, by=by, band=ALL) for row in whole if row.metric in (NEES, *NEES_BAND)
    ]


def _remarks(
    board: Board, metric: str, by: str, rows: Sequence[Row], cells: Cells
) -> tuple[Remarks, str]:
    """Return texts in brackets (ranks, false alarms or 95 % bands), and their name in the title."""
    if board.alarms and metric == DETECTION_RATE:
        alarms = {
            (row.entry, row.band): f"{row.value:.2f}"
            for row in rows
            if row.metric == FALSE_ALARMS and row.value is not None
        }
        return alarms, f" ({board.alarms})" if alarms else ""
    if metric == NEES:
        low, high = (
            {(r.entry, r.band): f"{r.value:.2f}" for r in rows if r.metric == name and r.value}
            for name in NEES_BAND
        )
        return {cell: f"{low[cell]}-{high[cell]}" for cell in low if cell in high}, ""
    if metric == board.headline and by == board.inputs_name:
        return _ranks(cells), ""
    return {}, ""


def _ranks(cells: Cells) -> Remarks:
    """Return the rank of each entry on the same inputs, 1 for the best."""
    values = {cell: row.value for cell, row in cells.items() if row.value is not None}
    return {
        (entry, band): str(1 + sum(v > value for (_, own), v in values.items() if own == band))
        for (entry, band), value in values.items()
    }


def _table(
    results: Results, name: str, part: Part, bands: Sequence[str], *, name_width: int
) -> Table:
    table = plain_table(title_justify="left", title_style="bold")
    table.add_column(board_named(name).kind.name, style="bold", width=name_width, overflow="fold")
    for band in bands:
        width = part.width(band)
        table.add_column(one_line(band), justify="right", width=width, overflow="fold")
    marked = False
    for entry in results.entries(name):
        is_mark = results.standing(name, entry).mark is not None
        if is_mark and not marked:
            table.add_section()
        marked = is_mark
        shown = wrapped_name(one_line(entry), name_width)
        text = Text(shown, style="not bold" if is_mark else "")
        cells = [part.text(entry, band) for band in bands]
        table.add_row(text, *cells, style="dim" if is_mark else None)
    return table


def _pages(widths: Mapping[str, int], width: int) -> list[list[str]]:
    """Divide the bands into groups that fit side by side in a width, at least one in each."""
    pages: list[list[str]] = []
    free_width = 0
    for band, needed in widths.items():
        if not pages or free_width < 1 + needed:
            pages.append([])
            free_width = width - 1
        pages[-1].append(band)
        free_width -= 1 + needed
    return pages


def _add_counts(
    table: Table,
    label: str,
    counts: Sequence[tuple[str, int]],
    bands: Sequence[str],
    *,
    even_zero: bool = False,
) -> None:
    """Add a row with the greatest count in each band, unless all are zero.

    counts: bands with counts of entries; those that failed in some episodes have less.
    """
    most = dict.fromkeys(bands, 0)
    for band, count in counts:
        if band in most:
            most[band] = max(most[band], count)
    if even_zero or any(most.values()):
        table.add_row(Text(label, style="not bold"), *map(str, most.values()), style="dim")
