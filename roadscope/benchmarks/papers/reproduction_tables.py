"""A paper's figures beside ours, as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.table import Table

from roadscope.benchmarks.papers.reproduction import POINTS, YES_OR_NO, ReproductionRow
from roadscope.benchmarks.tables import plain_table

MOST_COLUMNS = 5
UNNAMED = (YES_OR_NO, "1", "", "share", "count", "frame", None)
DECIMALS = {"m": 4, "deg": 3, "%": 1, POINTS: 1}
"""In tables without intervals; two for other units."""


def reproduction_tables(
    rows: Sequence[ReproductionRow], *, everything: bool = False
) -> Iterator[Table]:
    """Yield tables of one experiment.

    Methods that were measured by the same few quantities are set side by side, after the first
    where the paper has figures; where the paper compares methods, its figures stand below ours.
    Of those with many, the first is shown, which is the paper's own, or with `everything` each.
    """
    families: dict[tuple[str, ...], list[str]] = {}
    for method in dict.fromkeys(row.method for row in rows):
        quantities = tuple(row.quantity for row in rows if row.method == method)
        families.setdefault(quantities, []).append(method)
    for quantities, methods in families.items():
        shown = [row for row in rows if row.method in methods]
        few = len(quantities) <= MOST_COLUMNS
        if few and (compared(shown) or all(row.paper is None for row in shown)):
            yield side_by_side(shown, quantities, methods)
            continue
        for method in methods if everything else methods[:1]:
            yield with_intervals([row for row in shown if row.method == method])
        if few and not everything and len(methods) > 1:
            yield side_by_side(shown, quantities, methods[1:])


def compared(rows: Sequence[ReproductionRow]) -> bool:
    """Whether the paper has different figures for one quantity of different methods."""
    printed = {(row.quantity, row.paper) for row in rows if row.paper is not None}
    return len(printed) > len({quantity for quantity, _ in printed})


def with_intervals(rows: Sequence[ReproductionRow]) -> Table:
    """Return all quantities of one method, with intervals."""
    table = plain_table()
    table.add_column(rows[0].method, ratio=1)
    table.add_column("paper", justify="right", min_width=7)
    table.add_column("ours", justify="right", min_width=9, style="bold")
    table.add_column("95 %", justify="right", min_width=18, style="dim")
    for row in rows:
        ends = "" if row.low is None else f"{short(row.low)} to {short(row.high)}"
        table.add_row(
            _titled(row.quantity, row.unit), _figure(row, row.paper), _figure(row, row.ours), ends
        )
    return table


def side_by_side(
    rows: Sequence[ReproductionRow], quantities: Sequence[str], methods: Sequence[str]
) -> Table:
    """Return methods by quantities, with half the width of the intervals."""
    named = {(row.method, row.quantity): row for row in rows}
    units = [named[methods[0], quantity].unit for quantity in quantities]
    shared = units[0] if len(quantities) > 1 and len(set(units)) == 1 else None
    table = plain_table()
    table.add_column(shared if shared not in UNNAMED else "", style="bold", min_width=14)
    # So that five columns leave the longest name of a method whole on 80 columns.
    least, most = (11, 14) if len(quantities) < MOST_COLUMNS else (9, 12)
    for quantity, unit in zip(quantities, units, strict=True):
        heading = quantity if shared else _titled(quantity, unit)
        heading = heading if len(heading) <= most else heading.replace(" ", "\n", 1)
        table.add_column(heading, justify="right", min_width=least, max_width=most)
    for method in methods:
        cells = [named[method, quantity] for quantity in quantities]
        table.add_row(method, *(_fitting(row, len(cells), most) for row in cells))
        if any(row.paper is not None for row in cells):
            table.add_row("  paper", *(_figure(row, row.paper) for row in cells), style="dim")
    return table


def short(value: float | None) -> str:
    """Return a number with four digits, a whole or a great one without a point."""
    if value is None:
        return "-"
    return f"{value:.0f}" if float(value).is_integer() or abs(value) >= 1e4 else f"{value:.4g}"


def _figure(row: ReproductionRow, value: float | None) -> str:
    # What holds with some seeds alone is neither: its share is told.
    if row.unit == YES_OR_NO and value in (0.0, 1.0):
        return "yes" if value else "no"
    return short(value)


def _fitting(row: ReproductionRow, columns: int, width: int) -> str:
    """Return a spread with fewer decimals where its unit's make it wider than its column."""
    most = DECIMALS.get(row.unit, 2)
    shown = (_spread(row, columns, decimals) for decimals in range(most, -1, -1))
    return next((text for text in shown if len(text) <= width), _spread(row, columns, 0))


def _spread(row: ReproductionRow, columns: int, decimals: int) -> str:
    if row.ours is None or row.low is None or row.high is None:
        known = row.ours is not None and row.unit in DECIMALS
        return f"{row.ours:.{decimals}f}" if known else _figure(row, row.ours)
    if row.unit == "count" and row.low == row.high:
        return short(row.ours)
    mean, half = f"{row.ours:.{decimals}f}", f"{(row.high - row.low) / 2:.{decimals}f}"
    if columns < MOST_COLUMNS:
        return f"{mean} ±{half}"
    # Five columns leave no room for a space and a nought.
    return f"{mean}±{half.removeprefix('0') or half}"


def _titled(quantity: str, unit: str) -> str:
    return quantity if unit in UNNAMED else f"{quantity}, {unit}"
