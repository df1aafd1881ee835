"""Boards as tables for a terminal, as wide as it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table
from rich.text import Text

from roadscope.benchmarks.boards import Board, board_named
from roadscope.benchmarks.boards.board import Column
from roadscope.benchmarks.boards.tracking import OFFLINE
from roadscope.benchmarks.results import Results, Row, Standing
from roadscope.benchmarks.results.agreement import LEAST
from roadscope.benchmarks.suite import Suite
from roadscope.benchmarks.tables import plain_table
from roadscope.core.spec import ORACLE
from roadscope.core.text import one_line

NAME_WIDTH, LONGEST_NAME = 12, 48
"""Least and greatest width of the entry's column, characters."""
NO_COMPARISON = (
    "How these ranks agree with those on simulated traffic is shown once that was run too: "
    "roadscope leaderboard tracking --suite tracking, with the same --out if any."
)


@dataclass(frozen=True, slots=True)
class Layout:
    """The columns of a board that fit in a width.

    columns: in the order of importance. intervals: metrics that are shown with their interval.
    """

    columns: tuple[Column, ...]
    intervals: frozenset[str]
    name_width: int


def explanation(suite: Suite, boards: Sequence[str]) -> str:
    """Return what is to be found, by whom, and what intervals are over."""
    chosen = [board_named(name) for name in boards]
    texts = dict.fromkeys(board.explanation(suite) for board in chosen)
    # The rule of eligibility is the same for the boards of LiDAR: said once.
    whole = [t for t in texts if not any(o != t and o.startswith(t) for o in texts)]
    if not suite.recorded and len(suite.seeds) == 1:
        return " ".join([*whole, "One seed gives no intervals."])
    over = "sequences" if suite.recorded else "seeds"
    return " ".join([*whole, f"In brackets: 95 % intervals over {over}."])


def board_table(results: Results, name: str, width: int) -> Table:
    """Return a board in rank order, then entries that failed everywhere, then marks."""
    board = board_named(name)
    layout = layout_of(results, board, width)
    table = plain_table()
    table.add_column("", justify="right", style="dim")
    table.add_column(board.kind.name, style="bold", width=layout.name_width, overflow="fold")
    for column in layout.columns:
        cells = [_cell(results, board, entry, column, layout) for entry in results.entries(name)]
        needed = _needed_width(column, cells)
        table.add_column(column.heading, justify="right", width=needed)
    marked = False
    for entry in results.entries(name):
        place = results.standing(name, entry)
        if place.mark is not None and not marked:
            table.add_section()
        marked = place.mark is not None
        cells = [_cell(results, board, entry, column, layout) for column in layout.columns]
        style = "dim" if marked else None
        table.add_row(str(place.rank or ""), _name(results, place), *cells, style=style)
    return table


def layout_of(results: Results, board: Board, width: int) -> Layout:
    """Return as many columns as fit, the most important first, then as many intervals."""
    entries = results.entries(board.name)
    longest = max(
        (len(_name(results, results.standing(board.name, e))) for e in entries), default=0
    )
    name_width = max(min(longest, LONGEST_NAME, max(NAME_WIDTH, width // 3)), NAME_WIDTH)
    left = width - name_width - 5
    columns: list[Column] = []
    intervals = {board.headline}
    for column in board.columns:
        if not any(_known(results, board, entry, column) for entry in entries):
            continue
        layout = Layout((), frozenset(intervals), 0)
        needed = 1 + _width_of(results, board, column, layout)
        if needed > left and columns:
            return Layout(tuple(columns), frozenset(intervals), name_width)
        columns.append(column)
        left -= needed
    for column in columns[1:]:
        narrow = _width_of(results, board, column, Layout((), frozenset(), 0))
        wide = _width_of(results, board, column, Layout((), frozenset({column.metric}), 0))
        if wide - narrow > left:
            break
        intervals.add(column.metric)
        left -= wide - narrow
    return Layout(
        tuple(columns), frozenset(intervals), name_width + max(0, min(left, longest - name_width))
    )


def footnote(results: Results, name: str, width: int) -> str:
    """Return what the shown columns mean, and where the others are."""
    board = board_named(name)
    shown = layout_of(results, board, width).columns
    texts = list(dict.fromkeys(column.note for column in shown if column.note))
    jobs = results.manifest.get("jobs", 1)
    if jobs > 1 and any("ms" in column.heading.split() for column in shown):
        texts.append(f"Times taken with {jobs} workers at once; use --jobs 1 for timing.")
    known = [
        c
        for c in board.columns
        if any(_known(results, board, entry, c) for entry in results.entries(name))
    ]
    if len(shown) < len(known):
        texts.append("More columns on a wider terminal (--width); all in leaderboard.json (--out).")
    return " ".join(texts)


def failure_lines(results: Results, board: str) -> list[str]:
    """Return why entries failed: a line for each entry and reason."""
    lines = []
    entries = dict.fromkeys(f.entry for f in results.failures if f.board == board)
    for entry in entries:
        own = [f for f in results.failures if (f.board, f.entry) == (board, entry)]
        counts: dict[str, int] = {}
        for failure in own:
            reason = reason_alone(entry, failure.reason)
            counts[reason] = counts.get(reason, 0) + 1
        row = results.row(board, entry, "failed_episodes")
        episodes = row.n if row is not None else len(own)
        for reason, count in counts.items():
            if results.not_installed(entry):
                lines.append(f"{one_line(entry)} is left out: {reason}")
            elif count == episodes:
                lines.append(f"{one_line(entry)} failed in every episode: {reason}")
            else:
                lines.append(
                    f"{one_line(entry)} failed in {count} of {episodes} episodes: {reason}"
                )
    return lines


def reason_alone(entry: str, reason: str) -> str:
    """Return a reason without the entry's own name at its beginning."""
    spec, _, rest = reason.partition(": ")
    own = entry == spec or entry.startswith((f"{spec} on ", f"{spec}?ego=", f"{spec}&ego="))
    return one_line(rest if own else reason)


def agreement_lines(results: Results, name: str) -> list[str]:
    """Return how the ranks of a board of recorded data agree with those on simulated traffic.

    Where nothing was run that they could be compared with, return what to run.
    """
    lines = [
        f"Ranks agree with those of suite {a.suite} by {a.rho:.2f} (Spearman, "
        f"{len(a.entries)} trackers; 1 is the same order)."
        for a in results.agreements
        if a.board == name
    ]
    ranked = [s for s in results.standings if s.board == name and s.rank is not None]
    comparable = name.startswith("kitti") and len(ranked) >= LEAST
    return lines or [NO_COMPARISON] * comparable


def comparison(results: Results, name: str) -> str:
    """Return which entries are not shown to be worse than the best; empty with one entry."""
    places = [s for s in results.standings if s.board == name and s.rank is not None]
    rivals = [s for s in places[1:] if s.behind is not None]
    if not rivals or rivals[0].behind_low is None:
        return ""
    level = [s.entry for s in rivals if s.behind_low is not None and s.behind_low <= 0]
    best = one_line(places[0].entry)
    text = f"Not shown to be worse than {best}: {', '.join(map(one_line, level))}."
    if not level:
        text = f"{best} is shown to be better than all others."
    return f"{text} By 95 % intervals of differences on the same {board_named(name).sample}."


def figure(row: Row | None, decimals: int, *, interval: bool) -> str:
    """Return a value, with its interval if that is wanted, known and not a point."""
    if row is None or row.value is None:
        return "-"
    if row.metric == OFFLINE:
        return "offline" if row.value else "online"
    if board_named(row.board).three_digits:
        decimals = max(decimals - int(math.log10(max(abs(row.value), 1.0))), 0)
    text = f"{row.value:.{decimals}f}"
    if not interval or row.low is None or row.high is None or row.low == row.high:
        return text
    return f"{text} [{_short(row.low, decimals)}, {_short(row.high, decimals)}]"


def _name(results: Results, standing: Standing) -> Text:
    name = Text(one_line(standing.entry), style="not bold" if standing.mark else "")
    named_so = standing.entry.endswith(f" on {ORACLE}")
    if standing.mark and not named_so and standing.mark.split()[0] not in standing.entry:
        name.append(f" ({standing.mark})")
    offline = results.row(standing.board, standing.entry, OFFLINE)
    called_so = standing.entry.split()[0].partition("?")[0].endswith(OFFLINE)
    if offline is not None and offline.value and not called_so:
        name.append(f" ({OFFLINE})")
    failed = results.row(standing.board, standing.entry, "failed_episodes")
    if results.not_installed(standing.entry):
        name.append(" (not installed)", style="red")
    elif failed is not None and failed.value:
        name.append(f" ({failed.value:.0f} of {failed.n} failed)", style="red")
    return name


def _known(results: Results, board: Board, entry: str, column: Column) -> bool:
    row = results.row(board.name, entry, column.metric)
    return row is not None and row.value is not None


def _cell(results: Results, board: Board, entry: str, column: Column, layout: Layout) -> str:
    row = results.row(board.name, entry, column.metric)
    return figure(row, column.decimals, interval=column.metric in layout.intervals)


def _width_of(results: Results, board: Board, column: Column, layout: Layout) -> int:
    entries = results.entries(board.name)
    return _needed_width(column, [_cell(results, board, e, column, layout) for e in entries])


def _needed_width(column: Column, cells: Sequence[str]) -> int:
    """Return the width at which no word of a heading and no cell is broken."""
    return max(map(len, [*column.heading.split(), *cells]), default=1)


def _short(value: float, decimals: int) -> str:
    """Drop the zero before the point, so that intervals are narrow."""
    text = f"{value:.{decimals}f}"
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text
