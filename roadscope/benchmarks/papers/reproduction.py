"""A paper's figures beside ours: measured over seeds, summarised as rows, shown as tables."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.table import Table

from roadscope.benchmarks.tables import plain_table
from roadscope.benchmarks.workers import in_parallel

YES_OR_NO = "yes or no"
"""Unit of a claim: 1 where it holds and 0 where it does not. Tables print the words."""
POINTS = "points"
"""Unit of a difference of percentages. Only such a difference can be negative."""
LOWER_BOUND = {POINTS: -np.inf}
"""Least possible value by unit; 0 for the others."""
UPPER_BOUND = {YES_OR_NO: 1.0, "share": 1.0, "%": 100.0}
"""Greatest possible value by unit; none for the others."""


class FigureKey(NamedTuple):
    """Names one figure: an experiment, what made the figure, and the quantity measured."""

    experiment: str
    method: str
    quantity: str


@dataclass(frozen=True, slots=True)
class ReproductionRow:
    """One quantity of one experiment.

    method: what made our figure, such as a detector and a tracker by their names.
    paper: the printed figure, None where the paper prints none.
    ours: mean over seeds; low, high: its 95 % interval; None where nothing was measured.
    n: number of seeds behind the mean.
    """

    experiment: str
    method: str
    quantity: str
    unit: str
    paper: float | None
    ours: float | None
    low: float | None
    high: float | None
    n: int

    def __post_init__(self) -> None:
        if self.paper is not None and self.ours is None:
            raise ValueError(
                f"{self.experiment}, {self.method}: the paper gives {self.paper} {self.unit} for "
                f"'{self.quantity}', and ours is missing"
            )


def over_seeds(
    measure: Callable[[int], dict[FigureKey, float]],
    seeds: Sequence[int],
    progress: Callable[[int, int], None] | None = None,
    *,
    jobs: int = 1,
) -> dict[FigureKey, list[float]]:
    """Return the figures of all seeds, in the order of seeds; a seed may lack some figures.

    measure: returns the figures of one seed.
    progress: called with seeds done and seeds in all, after each.
    jobs: processes that share the seeds.
    """
    if not seeds:
        raise ValueError(f"at least one seed is needed, got {len(seeds)}")
    of_seeds: list[dict[FigureKey, float]] = [{} for _ in seeds]
    for done, (index, figures) in enumerate(in_parallel(measure, seeds, jobs), start=1):
        of_seeds[index] = figures
        if progress is not None:
            progress(done, len(seeds))
    measured: dict[FigureKey, list[float]] = {}
    for figures in of_seeds:
        for key, value in figures.items():
            measured.setdefault(key, []).append(value)
    return measured


def summarise(
    key: FigureKey, unit: str, values: Sequence[float], paper: float | None = None
) -> ReproductionRow:
    """Return a row with the mean of one value a seed and its 95 % interval (Student's t).

    values: NaN for a seed that has none. The interval is not resampled: most seeds often agree to
    the last digit.
    """
    finite = np.array([value for value in values if np.isfinite(value)])
    n = len(finite)
    if n == 0:
        return ReproductionRow(*key, unit, paper, None, None, None, 0)
    mean = float(finite.mean())
    if n == 1:
        return ReproductionRow(*key, unit, paper, mean, None, None, 1)
    half_width = _student_quantile(n - 1) * float(finite.std(ddof=1)) / np.sqrt(n)
    low = max(mean - half_width, LOWER_BOUND.get(unit, 0.0))
    high = min(mean + half_width, UPPER_BOUND.get(unit, np.inf))
    return ReproductionRow(*key, unit, paper, mean, float(low), float(high), n)


def _student_quantile(degrees_of_freedom: int) -> float:
    """Return the 97.5 % quantile of Student's t."""
    from scipy.special import stdtrit

    return float(stdtrit(degrees_of_freedom, 0.975))


def write_rows(rows: Sequence[ReproductionRow], path: Path | str) -> None:
    """Write rows as a JSON list."""
    text = json.dumps([asdict(row) for row in rows], indent=1, allow_nan=False)
    Path(path).write_text(text + "\n", encoding="utf-8")


# --------------------------------------------------------------------------------------------------
# Tables for a terminal of 80 columns.

MOST_COLUMNS = 5
"""Quantities that fit beside each other."""
UNITS_NOT_PRINTED = (YES_OR_NO, "1", "", "share", "count", "frame", None)
DECIMALS = {"m": 4, "deg": 3, "%": 1, POINTS: 1}
"""By unit, in tables without intervals; two for other units."""


def reproduction_tables(
    rows: Sequence[ReproductionRow], *, everything: bool = False
) -> Iterator[Table]:
    """Yield the tables of one experiment.

    Methods with the same few quantities stand in one table. Where the paper compares methods, its
    figures stand below ours. Where it has one figure a quantity, the first method, the paper's,
    has a table with intervals, and the others follow in one table. Of methods with many
    quantities, the first alone is shown.

    everything: show a table with intervals for every method.
    """
    families: dict[tuple[str, ...], list[str]] = {}
    for method in dict.fromkeys(row.method for row in rows):
        quantities = tuple(row.quantity for row in rows if row.method == method)
        families.setdefault(quantities, []).append(method)
    for quantities, methods in families.items():
        family_rows = [row for row in rows if row.method in methods]
        few = len(quantities) <= MOST_COLUMNS
        nothing_printed = all(row.paper is None for row in family_rows)
        if few and (paper_compares_methods(family_rows) or nothing_printed):
            yield _table_of_methods(family_rows, quantities, methods)
            continue
        for method in methods if everything else methods[:1]:
            yield _table_with_intervals([row for row in family_rows if row.method == method])
        if few and not everything and len(methods) > 1:
            yield _table_of_methods(family_rows, quantities, methods[1:])


def paper_compares_methods(rows: Sequence[ReproductionRow]) -> bool:
    """Return whether the paper prints different figures of one quantity for different methods."""
    printed = {(row.quantity, row.paper) for row in rows if row.paper is not None}
    return len(printed) > len({quantity for quantity, _ in printed})


def _table_with_intervals(rows: Sequence[ReproductionRow]) -> Table:
    """Return all quantities of one method, a line each, with intervals."""
    table = plain_table()
    table.add_column(rows[0].method, ratio=1)
    table.add_column("paper", justify="right", min_width=7)
    table.add_column("ours", justify="right", min_width=9, style="bold")
    table.add_column("95 %", justify="right", min_width=18, style="dim")
    for row in rows:
        interval = "" if row.low is None else f"{_number(row.low)} to {_number(row.high)}"
        quantity = _with_unit(row.quantity, row.unit)
        table.add_row(quantity, _figure(row, row.paper), _figure(row, row.ours), interval)
    return table


def _table_of_methods(
    rows: Sequence[ReproductionRow], quantities: Sequence[str], methods: Sequence[str]
) -> Table:
    """Return methods by quantities, each figure with half the width of its interval."""
    cells = {(row.method, row.quantity): row for row in rows}
    units = [cells[methods[0], quantity].unit for quantity in quantities]
    shared_unit = units[0] if len(quantities) > 1 and len(set(units)) == 1 else None
    table = plain_table()
    corner = shared_unit if shared_unit not in UNITS_NOT_PRINTED else ""
    table.add_column(corner, style="bold", min_width=14)
    # So that five columns leave the longest name of a method whole on 80 columns.
    least, most = (11, 14) if len(quantities) < MOST_COLUMNS else (9, 12)
    for quantity, unit in zip(quantities, units, strict=True):
        heading = quantity if shared_unit else _with_unit(quantity, unit)
        heading = heading if len(heading) <= most else heading.replace(" ", "\n", 1)
        table.add_column(heading, justify="right", min_width=least, max_width=most)
    for method in methods:
        line = [cells[method, quantity] for quantity in quantities]
        table.add_row(method, *(_mean_and_half_width(row, len(line), most) for row in line))
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


def _mean_and_half_width(row: ReproductionRow, columns: int, width: int) -> str:
    """Return a figure with the decimals of its unit, or with fewer where its column is too narrow.

    columns: of the table. width: of the column, letters.
    """
    most = DECIMALS.get(row.unit, 2)
    candidates = (_rounded(row, columns, decimals) for decimals in range(most, -1, -1))
    return next((text for text in candidates if len(text) <= width), _rounded(row, columns, 0))


def _rounded(row: ReproductionRow, columns: int, decimals: int) -> str:
    if row.ours is None or row.low is None or row.high is None:
        has_decimals = row.ours is not None and row.unit in DECIMALS
        return f"{row.ours:.{decimals}f}" if has_decimals else _figure(row, row.ours)
    if row.unit == "count" and row.low == row.high:
        return _number(row.ours)
    mean, half_width = f"{row.ours:.{decimals}f}", f"{(row.high - row.low) / 2:.{decimals}f}"
    if columns < MOST_COLUMNS:
        return f"{mean} ±{half_width}"
    # Five columns leave no place for a space and a leading zero.
    return f"{mean}±{half_width.removeprefix('0') or half_width}"


def _with_unit(quantity: str, unit: str) -> str:
    return quantity if unit in UNITS_NOT_PRINTED else f"{quantity}, {unit}"
