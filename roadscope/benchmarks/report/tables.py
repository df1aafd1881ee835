"""Tables of boards for a terminal, with the columns that fit in its width."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table
from rich.text import Text

from roadscope.benchmarks.boards import Board, board_named
from roadscope.benchmarks.boards.board import Column
from roadscope.benchmarks.boards.tracking import OFFLINE
from roadscope.benchmarks.results import Results, Row, Standing
from roadscope.benchmarks.results.agreement import LEAST_ENTRIES, predictions
from roadscope.benchmarks.suite import Suite
from roadscope.benchmarks.tables import plain_table, right
from roadscope.core import Bounds
from roadscope.core.spec import ORACLE
from roadscope.core.text import one_line

LEAST_NAME_WIDTH, MOST_NAME_WIDTH = 12, 48
"""Limits of the width of names before columns get their intervals, characters."""
RANK_WIDTH = 5
"""Space that the column of ranks takes, with the blanks beside it, characters."""


@dataclass(frozen=True, slots=True)
class ShownColumn:
    """A column as it is printed.

    cells: one for each entry of the board, in rank order.
    """

    column: Column
    cells: tuple[str, ...]

    @property
    def width(self) -> int:
        """The least width at which no cell and no word of the heading is broken."""
        return max(map(len, [*self.column.heading.split(), *self.cells]), default=1)


@dataclass(frozen=True, slots=True)
class TableLayout:
    """The columns of a board that fit in a width."""

    columns: tuple[ShownColumn, ...]
    name_width: int


def explanation(
    suite: Suite,
    boards: Sequence[str],
    *,
    standings: Sequence[Standing] = (),
    intervals: bool = True,
) -> str:
    """Return as text which objects are eligible, what entries get, and what intervals are over.

    standings: those shown, whose marks are explained. intervals: whether any is shown.
    """
    chosen = [board_named(name) for name in boards]
    texts = dict.fromkeys(board.explanation(suite) for board in chosen)
    # Boards of LiDAR share the rule of eligibility, which is printed once.
    whole = [t for t in texts if not any(o != t and o.startswith(t) for o in texts)]
    for board in chosen:
        marks = [each.entry for each in standings if each.board == board.name and each.mark]
        notes = board.marks_notes.items()
        shown = [f"'{e}': {t}" for e, t in notes if any(name.endswith(f" {e}") for name in marks)]
        whole += [f"{'; '.join(shown)}."] if shown else []
    if not suite.recorded and len(suite.seeds) == 1:
        return " ".join([*whole, "One seed gives no intervals."])
    over = " and ".join(dict.fromkeys(board.sample for board in chosen if board.sample))
    if over and not intervals:
        return " ".join([*whole, f"There are too few {over} for intervals."])
    return " ".join([*whole, f"In brackets: 95 % intervals over {over}." if over else ""]).rstrip()


def board_table(results: Results, name: str, width: int) -> Table:
    """Return a board as a table: entries in rank order, those that always failed, then marks."""
    layout = layout_of(results, name, width)
    table = plain_table()
    table.add_column("", justify="right", style="dim")
    kind = board_named(name).kind.name
    table.add_column(kind, style="bold", width=layout.name_width, overflow="fold")
    for shown in layout.columns:
        table.add_column(shown.column.heading, justify="right", width=shown.width)
    places = [results.standing(name, entry) for entry in results.entries(name)]
    for number, place in enumerate(places):
        if place.mark and number and not places[number - 1].mark:
            table.add_section()
        table.add_row(
            str(place.rank or ""),
            _name(results, place, layout.name_width),
            *(shown.cells[number] for shown in layout.columns),
            style="dim" if place.mark else None,
        )
    return table


def layout_of(results: Results, name: str, width: int) -> TableLayout:
    """Divide a width among the names of the entries and the columns of a board.

    Names get the width of the longest, at most a third. Columns follow, the most important first,
    as long as they fit: the headline with its interval, the others without. Then further columns
    get their intervals in the same order, and names the space that is left.
    """
    board, entries = board_named(name), results.entries(name)
    longest = max(len(_name(results, results.standing(name, entry))) for entry in entries)
    name_width = min(longest, MOST_NAME_WIDTH, width // 3)
    name_width = max(name_width, LEAST_NAME_WIDTH)
    space = width - RANK_WIDTH - name_width
    columns: list[ShownColumn] = []
    for column in measured_columns(results, board):
        shown = _shown(results, board, column, interval=column.metric == board.headline)
        if columns and 1 + shown.width > space:
            break
        columns.append(shown)
        space -= 1 + shown.width
    for number, shown in enumerate(columns[1:], start=1):
        wider = _shown(results, board, shown.column, interval=True)
        if wider.width - shown.width > space:
            break
        columns[number] = wider
        space -= wider.width - shown.width
    return TableLayout(tuple(columns), name_width + max(0, min(space, longest - name_width)))


def footnote(results: Results, name: str, width: int) -> str:
    """Return the explanations of the shown columns, and where the others can be seen."""
    shown = [each.column for each in layout_of(results, name, width).columns]
    texts = list(dict.fromkeys(column.note for column in shown if column.note))
    jobs = results.manifest.get("jobs", 1)
    if jobs > 1 and any("ms" in column.heading.split() for column in shown):
        texts.append(f"Times taken with {jobs} workers at once; use --jobs 1 for timing.")
    if len(shown) < len(measured_columns(results, board_named(name))):
        texts.append("More columns on a wider terminal (--width); all in leaderboard.json (--out).")
    return " ".join(texts)


def failure_lines(results: Results, board: str) -> list[str]:
    """Return why entries failed: a line for each entry and reason."""
    counts = Counter(
        (failure.entry, reason_alone(failure.entry, failure.reason))
        for failure in results.failures
        if failure.board == board
    )
    lines = []
    for (entry, reason), count in sorted(counts.items(), key=lambda item: item[0][0]):
        row = results.row(board, entry, "failed_episodes")
        episodes = count if row is None else row.n
        share = "every episode" if count == episodes else f"{count} of {episodes} episodes"
        what = "is left out" if results.not_installed(entry) else f"failed in {share}"
        lines.append(f"{one_line(entry)} {what}: {reason}")
    return lines


def reason_alone(entry: str, reason: str) -> str:
    """Return a reason without the name of the entry at its beginning."""
    spec, _, remainder = reason.partition(": ")
    own = entry == spec or entry.startswith((f"{spec} on ", f"{spec}?ego=", f"{spec}&ego="))
    return one_line(remainder if own else reason)


def agreement_lines(results: Results, name: str) -> list[str]:
    """Return how the ranks of a board of recorded data agree with those on simulated traffic.

    If there is nothing to compare with, return what to run.
    """
    board = board_named(name)
    lines = [
        f"Ranks agree with those of suite {a.suite} by "
        f"{f'{a.rho:.2f} {_in_brackets(a.interval)}'.strip()} "
        f"(Spearman, {len(a.entries)} {board.kind.plural}; 1 is the same order)."
        for a in results.agreements
        if a.board == name
    ]
    ranked = [s for s in results.standings if s.board == name and s.rank is not None]
    comparable = board.comparison_note and len(ranked) >= LEAST_ENTRIES
    return lines or ([board.comparison_note] if comparable else [])


def prediction_rows(results: Results, name: str) -> list[list[str]]:
    """Return rank correlations of metrics of the inputs with how well entries do.

    Each row has what is predicted, the metric, the correlation, and its intervals for other inputs
    and for other seeds.
    """
    headings = {column.metric: column.heading for column in board_named(name).columns}
    return [
        [
            headings[each.predicted],
            headings[each.metric],
            f"{each.rho:.2f}",
            _in_brackets(each.over_inputs) or "-",
            _in_brackets(each.over_seeds) or "-",
        ]
        for each in predictions(results.jobs, name)
    ]


def prediction_headings(name: str) -> list[str]:
    """Return the headings of `prediction_rows`."""
    return ["predicted", "by", "rank corr.", f"over {board_named(name).inputs_name}s", "over seeds"]


def prediction_note(results: Results, name: str) -> str:
    """Return what the rows of `prediction_rows` mean; empty if there are none."""
    predicted = predictions(results.jobs, name)
    if not predicted:
        return ""
    inputs = f"{board_named(name).inputs_name}s"
    return (
        f"Does a metric of {inputs} predict how well entries do? Spearman's rank correlation over "
        f"{max(each.inputs for each in predicted)} {inputs}: 1 if what is better in one is also "
        f"better in the other, also where less is better. 95 % intervals: over {inputs}, for other "
        f"{inputs} of the kind (Bonett and Wright); over seeds, for these {inputs} on other seeds."
    )


def prediction_table(results: Results, name: str) -> Table:
    """Return `prediction_rows` as a table, at most 80 characters wide."""
    what, metric, *figures = prediction_headings(name)
    table = plain_table(what, metric, *(right(f"  {each}") for each in figures))
    before = ""
    for predicted, *others in prediction_rows(results, name):
        table.add_row(predicted if predicted != before else "", *others)
        before = predicted
    return table


def _in_brackets(interval: Bounds | None) -> str:
    return "" if interval is None else f"[{', '.join(_interval_end(end, 2) for end in interval)}]"


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
    sample = board_named(name).sample
    return f"{text} By 95 % intervals of differences on the same {sample}, each by itself."


def figure(row: Row | None, decimals: int, *, interval: bool) -> str:
    """Return a value as text. interval: with its interval, if it has one that is not a point."""
    if row is None or row.value is None:
        return "-"
    if row.metric == OFFLINE:
        return "offline" if row.value else "online"
    if board_named(row.board).three_digits:
        decimals = max(decimals - int(math.log10(max(abs(row.value), 1.0))), 0)
    text = f"{row.value:.{decimals}f}"
    if not interval or row.low is None or row.high is None or row.low == row.high:
        return text
    return f"{text} [{_interval_end(row.low, decimals)}, {_interval_end(row.high, decimals)}]"


def wrapped_name(name: str, width: int) -> str:
    """Return the name of an entry, broken into lines between its parts if it is too long."""
    lines = [""]
    for part in re.findall(r"[?&]?[^?&/: ]*[/: ]?", name):
        if lines[-1] and len(lines[-1]) + len(part.rstrip()) > width:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)


def _name(results: Results, standing: Standing, width: int | None = None) -> Text:
    """Return an entry with its mark and failures in brackets. width: of lines; None: one line."""
    shown = one_line(standing.entry)
    name = Text(
        shown if width is None else wrapped_name(shown, width),
        style="not bold" if standing.mark else "",
    )
    for remark in remarks_of(results, standing):
        name.append(f" ({remark})")
    if failure := failure_of(results, standing):
        name.append(f" ({failure})", style="red")
    return name


def remarks_of(results: Results, standing: Standing) -> list[str]:
    """Return what stands beside the name of an entry: its mark, and whether it is offline."""
    board, entry, mark = standing.board, standing.entry, standing.mark or ""
    # Some names already contain their mark, or that they are offline.
    own = not mark or entry.endswith(f" on {ORACLE}") or mark.split()[0] in entry
    offline = results.row(board, entry, OFFLINE)
    called_so = entry.split()[0].partition("?")[0].endswith(OFFLINE)
    is_offline = offline is not None and offline.value and not called_so
    return [mark] * (not own) + [OFFLINE] * bool(is_offline)


def failure_of(results: Results, standing: Standing) -> str:
    """Return in how many episodes an entry failed, or that it is not installed; often empty."""
    if results.not_installed(standing.entry):
        return "not installed"
    failed = results.row(standing.board, standing.entry, "failed_episodes")
    return f"{failed.value:.0f} of {failed.n} failed" if failed is not None and failed.value else ""


def measured_columns(results: Results, board: Board) -> list[Column]:
    """Return the columns in which any entry has a value."""
    measured = {r.metric for r in results.rows if r.board == board.name and r.value is not None}
    return [column for column in board.columns if column.metric in measured]


def is_time(column: Column) -> bool:
    """Return whether a column is of a time."""
    return "ms" in column.heading.split()


def _shown(results: Results, board: Board, column: Column, *, interval: bool) -> ShownColumn:
    rows = (results.row(board.name, entry, column.metric) for entry in results.entries(board.name))
    cells = tuple(figure(row, column.decimals, interval=interval) for row in rows)
    return ShownColumn(column, cells)


def _interval_end(value: float, decimals: int) -> str:
    """Return an end of an interval without the zero before its point, to save width."""
    text = f"{value:.{decimals}f}"
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text
