"""Tables of a paper's verdicts and figures for a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.table import Table
from rich.text import Text

from roadscope.benchmarks.papers.reproduction import POINTS, YES_OR_NO, ReproductionRow, Verdict
from roadscope.benchmarks.tables import plain_table

MOST_COLUMNS = 5
"""Quantities that fit beside each other, each with an interval."""
MOST_BESIDE = 2
"""Methods with many quantities that fit beside each other."""
MOST_WIDE, WHOLE = 13, 80
"""Characters of a column at most, and of a whole table."""
UNITS_NOT_PRINTED = (YES_OR_NO, "1", "", "share", "count", "frame", None)
DECIMALS = {"m": 4, "deg": 3, "%": 1, POINTS: 1}
"""By unit; other figures have four digits, and their intervals two decimals."""


VERDICT_NOTE = (
    "A claim holds if the 95 % interval of the mean over seeds lies within what it says, and does "
    "not hold if it lies outside; else it is open. One seed has no interval and is judged by its "
    "value. '% of seeds': the seeds in which the claim holds; the interval must lie above half."
)


def verdict_table(verdicts: Sequence[Verdict]) -> Table:
    """Return the claims of a paper, each with what judges it: method, figure and interval."""
    table = plain_table()
    table.add_column("claim of the paper, and of what", ratio=1)
    table.add_column("ours [95 %]", justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for claim in dict.fromkeys(each.claim for each in verdicts):
        table.add_row(claim)
        for each in verdicts:
            if each.claim == claim:
                ours = "-" if each.value is None else f"{each.value:.3g} {each.unit}"
                text = f"{ours} {_interval(each.low, each.high)}".rstrip()
                table.add_row(f"  {each.method}", text, Text(each.verdict, "bold"), style="dim")
    return table


def reproduction_tables(
    rows: Sequence[ReproductionRow], *, everything: bool = False
) -> Iterator[Table]:
    """Yield the tables of one experiment.

    Methods with the same few quantities stand in one table. Methods with many quantities have a
    line for each quantity: those of the paper, beside each other.

    everything: show a table for every method with many quantities.
    """
    families: dict[tuple[str, ...], list[str]] = {}
    for method in dict.fromkeys(row.method for row in rows):
        quantities = tuple(row.quantity for row in rows if row.method == method)
        families.setdefault(quantities, []).append(method)
    for quantities, methods in families.items():
        family_rows = [row for row in rows if row.method in methods]
        if len(quantities) <= MOST_COLUMNS:
            yield _table_of_methods(family_rows, quantities, methods)
            continue
        printed = [m for m in methods if any(r.method == m and r.paper is not None for r in rows)]
        first = (printed or methods)[:MOST_BESIDE]
        yield _table_of_quantities([row for row in family_rows if row.method in first], first)
        for method in methods if everything else ():
            if method not in first:
                own = [row for row in family_rows if row.method == method]
                yield _table_of_quantities(own, [method])


def _table_of_quantities(rows: Sequence[ReproductionRow], methods: Sequence[str]) -> Table:
    """Return a line for each quantity: the paper's figure and ours of some methods."""
    cells = {(row.method, row.quantity): row for row in rows}
    table = plain_table()
    table.add_column("", ratio=1)
    table.add_column("paper", justify="right", min_width=7)
    for method in methods:
        table.add_column(method, justify="right", min_width=22)
    for row in rows:
        if row.method != methods[0]:
            continue
        line = [cells[method, row.quantity] for method in methods]
        ours = [f"{_figure(each, each.ours)} {_interval(each.low, each.high)}" for each in line]
        table.add_row(_with_unit(row.quantity, row.unit), _figure(row, row.paper), *ours)
    return table


def _table_of_methods(
    rows: Sequence[ReproductionRow], quantities: Sequence[str], methods: Sequence[str]
) -> Table:
    """Return methods by quantities; below each its 95 % intervals and what the paper prints."""
    cells = {(row.method, row.quantity): row for row in rows}
    units = [cells[methods[0], quantity].unit for quantity in quantities]
    shared_unit = units[0] if len(quantities) > 1 and len(set(units)) == 1 else None
    table = plain_table()
    corner = shared_unit if shared_unit not in UNITS_NOT_PRINTED else ""
    # Five columns leave the longest name of a method whole.
    free = WHOLE - max(map(len, methods)) - len(quantities)
    width = min(MOST_WIDE, free // len(quantities))
    table.add_column(corner, min_width=14)
    for quantity, unit in zip(quantities, units, strict=True):
        heading = quantity if shared_unit else _with_unit(quantity, unit)
        heading = heading if len(heading) <= width else heading.replace(" ", "\n", 1)
        table.add_column(
            heading, justify="right", min_width=min(9, width), max_width=width, overflow="fold"
        )
    for method in methods:
        line = [cells[method, quantity] for quantity in quantities]
        table.add_row(Text(method, "bold"), *(_rounded(row, row.ours) for row in line))
        if any(row.low is not None and row.low != row.high for row in line):
            table.add_row("  95 %", *(_interval_of(row, width) for row in line), style="dim")
        if any(row.paper is not None for row in line):
            table.add_row("  paper", *(_figure(row, row.paper) for row in line), style="dim")
    return table


def _number(value: float | None) -> str:
    """Return a number with four digits; a whole or a great number without a point."""
    if value is None:
        return "-"
    return f"{value:.0f}" if float(value).is_integer() or abs(value) >= 1e4 else f"{value:.4g}"


def _figure(row: ReproductionRow, value: float | None) -> str:
    # A claim that holds with some of the seeds is neither yes nor no: the share is printed.
    if row.unit == YES_OR_NO and value in (0.0, 1.0):
        return "yes" if value else "no"
    return _number(value)


def _interval(low: float | None, high: float | None) -> str:
    return "" if low is None else f"[{low:.3g}, {high:.3g}]"


def _interval_of(row: ReproductionRow, width: int) -> str:
    """Return an interval with the decimals of its unit; nothing where all seeds agree."""
    if row.low is None or row.high is None or row.low == row.high:
        return ""
    for decimals in range(DECIMALS.get(row.unit, 2), -1, -1):
        low, high = f"{row.low:.{decimals}f}", f"{row.high:.{decimals}f}"
        if len(low) + len(high) + 3 <= width:
            return f"{low} - {high}"
    return f"{low} -\n{high}"


def _rounded(row: ReproductionRow, value: float | None) -> str:
    """Return a figure with the decimals of its unit."""
    if value is None or row.unit not in DECIMALS:
        return _figure(row, value)
    return f"{value:.{DECIMALS[row.unit]}f}"


def _with_unit(quantity: str, unit: str) -> str:
    return quantity if unit in UNITS_NOT_PRINTED else f"{quantity}, {unit}"
