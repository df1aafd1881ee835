"""Tables for a terminal: of scores, speeds and names."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from roadscope.benchmarks.metrics.score import Score


def plain_table(**options: Any) -> Table:
    """Return a table with a rule below its headings and nothing else."""
    return Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=0, **options)


def score_table(scores: Mapping[str, Score]) -> Table:
    """Return the scores of one episode."""
    table = plain_table()
    table.add_column("metric")
    table.add_column("value", justify="right")
    table.add_column("unit")
    table.add_column("samples", justify="right")
    for name, score in scores.items():
        value = "-" if math.isnan(score.value) else f"{score.value:.3f}"
        table.add_row(name, value, "" if score.unit == "1" else score.unit, str(score.n))
    return table


def speed_table(rows: Sequence[Any]) -> Table:
    """Return measured speeds; rows are `speed.rows.SpeedRow`s.

    Where any stands beside another it has a column that says how many times as long it takes.
    """
    table = plain_table()
    table.add_column("measured", style="bold", ratio=1)
    table.add_column("value", justify="right")
    table.add_column("unit")
    compared = any(row.ratio is not None for row in rows)
    if compared:
        table.add_column("ratio", justify="right")
    for row in rows:
        cells = [row.name, "-" if row.value is None else f"{row.value:.4g}", row.unit]
        if compared:
            cells.append("" if row.ratio is None else f" {_times(row.ratio)} x {row.beside}")
        table.add_row(*cells)
    return table


def _times(ratio: float) -> str:
    return f"{ratio:.0f}" if ratio >= 100 else f"{ratio:.3g}"


def pose_table(rows: Sequence[Any]) -> Table:
    """Return what numbers of poses of a board give; rows are `calibrating.PoseRow`s."""
    table = plain_table()
    for name in (
        "poses", "reprojection\npx", "8 to 30 m\npx", "worst\npx", "position\ncm",
        "rotation\ndeg", "by corners\npx",
    ):  # fmt: skip
        table.add_column(f"  {name}" if name != "poses" else name, justify="right")
    for row in rows:
        figures = (
            row.reprojection_px, row.held_out_px, row.held_out_most_px, 100 * row.position_m,
            row.rotation_deg, row.corners_px,
        )  # fmt: skip
        told = ("-" if not math.isfinite(value) else f"{value:.2f}" for value in figures)
        table.add_row(str(row.poses), *told)
    return table


def name_table(kind: str, names: Sequence[tuple[str, str]]) -> Table:
    """Return names with their descriptions."""
    table = plain_table(title=kind, title_justify="left", title_style="bold")
    table.show_header = False
    table.add_column("name", style="cyan", no_wrap=True)
    table.add_column("description")
    for name, text in names:
        table.add_row(name, Text(text))
    return table
