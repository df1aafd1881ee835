"""Draws figures over the distance driven, such as drift, of the board that has some."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.cache import write_atomically
from roadscope.benchmarks.metrics.odometry import DISTANCE, MARKS_M
from roadscope.benchmarks.report.tables import MOST_NAME_WIDTH, wrapped_name
from roadscope.benchmarks.results import Results, Row
from roadscope.core.palette import FIGURE_STYLE, PAPER_COLOURS
from roadscope.core.text import one_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

LineStyle = str | tuple[float, tuple[float, ...]]
STYLES: tuple[LineStyle, ...] = ("-", "--", ":", "-.", (0, (6, 2, 1, 2, 1, 2)))
"""Line styles; each is for as many entries as there are colours."""
SIZE_INCHES = 10.0, 4.5
LEGEND_LINE_INCHES = 0.21
"""Height of one line of the legend."""


def has_curves(results: Results) -> bool:
    """Return whether any entry has a figure over any distance."""
    return bool(_rows_by_distance(results))


def _rows_by_distance(results: Results) -> list[Row]:
    """Return the figures over distance of the first board that has some."""
    for board in map(board_named, results.boards()):
        rows = results.breakdown(DISTANCE, board.name) if board.by_distance else []
        if rows_with_value := [row for row in rows if row.value is not None]:
            return rows_with_value
    return []


def draw_curves(results: Results, path: Path) -> None:
    """Write a picture of a board's `by_distance`, such as t_rel, with 95 % intervals.

    Entries are in rank order, marks last. The path's ending decides the format: svg, png or pdf.
    """
    rows = _rows_by_distance(results)
    board = board_named(rows[0].board)
    with styled_figures() as new_figure:
        figure = new_figure(*SIZE_INCHES)
        (axes,) = figure.subplots(1, len(board.by_distance), squeeze=False)
        lines: dict[str, Line2D] = {}
        for place, (metric, label) in zip(axes, board.by_distance.items(), strict=True):
            for k, entry in enumerate(results.entries(board.name)):
                own = [row for row in rows if (row.entry, row.metric) == (entry, metric)]
                if own:
                    lines.setdefault(entry, _curve(place, own, *_line_style(k)))
            _style(place, label, max(float(row.band) for row in rows))
        names = [wrapped_name(one_line(entry), MOST_NAME_WIDTH) for entry in lines]
        legend_lines = 2 + sum(1 + name.count("\n") for name in names)
        figure.set_figheight(max(SIZE_INCHES[1], LEGEND_LINE_INCHES * legend_lines))
        legend = figure.legend(list(lines.values()), names, loc="outside right upper")
        for text in legend.get_texts():
            text.set_parse_math(False)
        save_figure(figure, path)


@contextmanager
def styled_figures() -> Iterator[Callable[[float, float], Figure]]:
    """Give a function that makes a figure of our style from its width and height, inches."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    # The same results give the same bytes; text stays text.
    exact = {"svg.hashsalt": "roadscope", "svg.fonttype": "none"}
    with mpl.rc_context({**FIGURE_STYLE, **exact}):
        yield lambda width, height: Figure((width, height), layout="constrained")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure whole, in the format of the path's ending."""
    ending = path.suffix[1:]
    dated = {"Date": None} if ending == "svg" else {}
    write_atomically(path, partial(figure.savefig, format=ending, metadata=dated))


def _line_style(number: int) -> tuple[str, LineStyle]:
    """Return colour and line style of an entry."""
    count = len(PAPER_COLOURS)
    return PAPER_COLOURS[number % count], STYLES[number // count % len(STYLES)]


def _curve(place: Axes, rows: Sequence[Row], colour: str, style: LineStyle) -> Line2D:
    """Draw an entry's curve with its interval and return the line."""
    # A missing interval becomes NaN and leaves a gap.
    figures = [(row.band, row.value, row.low, row.high) for row in rows]
    at, values, low, high = np.array(figures, np.float64).T
    (line,) = place.plot(at, values, linestyle=style, color=colour, marker="o", markersize=3)
    place.fill_between(at, low, high, color=colour, alpha=0.12, linewidth=0)
    return line


def _style(place: Axes, label: str, farthest_m: float) -> None:
    from matplotlib.ticker import LogLocator, NullLocator

    place.set(xscale="log", xlabel="distance driven (m)", ylabel=label)
    place.set_yscale("log", nonpositive="clip")
    marks_m = [mark for mark in MARKS_M if mark <= farthest_m]
    place.set_xticks(marks_m, [str(mark) for mark in marks_m])
    # Figures of all entries may lie between two powers of ten.
    place.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    place.yaxis.set_major_formatter("{x:g}")
    for axis in (place.xaxis, place.yaxis):
        axis.set_minor_locator(NullLocator())
