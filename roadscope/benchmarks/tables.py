"""Results as tables for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.oracle import ORACLE
from roadscope.benchmarks.results import FIRST_METRIC, Results, Row
from roadscope.benchmarks.suite import Suite

FULL, WIDE, WIDEST = 76, 92, 190
"""Widths from which on the main figures, all figures are shown, and all with their intervals."""

Columns = Mapping[str, tuple[str, int]]
"""Metric -> heading and decimals."""

COLUMNS: Mapping[str, Columns] = {
    "detection": {
        "f1": ("F1", 2),
        "detection_rate": ("detec-\nted", 2),
        "precision": ("preci-\nsion", 2),
        "false_alarms_per_frame": ("false/\nframe", 2),
        "ap": ("AP", 2),
        "position_rmse_m": ("pos.\nm", 2),
        "heading_rmse_deg": ("head.\ndeg", 1),
        "call_p50_ms": ("ms\np50", 2),
        "call_p99_ms": ("ms\np99", 2),
    },
    "tracking": {
        "hota": ("HOTA", 2),
        "mota": ("MOTA", 2),
        "idf1": ("IDF1", 2),
        "id_switches": ("ID\nsw.", 1),
        "wrong_associations": ("wrong\nassoc", 1),
        "fragmentations": ("frag-\nments", 1),
        "motp_m": ("MOTP\nm", 2),
        "velocity_rmse_m_s": ("vel.\nm/s", 2),
        "call_p50_ms": ("ms\np50", 2),
        "call_p99_ms": ("ms\np99", 2),
    },
}

LEFT_OUT = ("heading_rmse_deg", "motp_m", "fragmentations", "call_p99_ms")
"""Shown on wide terminals only, like all that `leaderboard.json` holds beside."""

ENTRY = {"detection": "detector", "tracking": "tracker"}

EXPLAINED: Mapping[str, Sequence[tuple[Sequence[str], str]]] = {
    "detection": (
        (("f1",), "F1, detected, precision: one to one, centres within 2 m seen from above."),
        (("ap",), "AP: mean over 0.5, 1, 2, 4 m."),
        (("position_rmse_m",), "pos.: RMSE of matches."),
        (("heading_rmse_deg",), "head.: RMSE of matches."),
    ),
    "tracking": (
        (("hota",), "HOTA, MOTA, IDF1: centres seen from above, gate 2 m."),
        (("id_switches", "wrong_associations", "fragmentations"), "Counts: per episode."),
        (("velocity_rmse_m_s",), "vel.: RMSE of matches."),
    ),
}
"""Metrics and what is said of them when one is shown."""


def conditions(suite: Suite) -> str:
    """Say what is to be found, by whom, and how sure the figures are."""
    rule = suite.eligibility
    near, far = rule.range_m
    families = " and ".join(f"{family}s" for family in rule.families)
    place = f"within {far:g} m" if near == 0 else f"{near:g} to {far:g} m away"
    text = f"To be found: {families} {place} with at least {rule.min_returns} returns."
    if suite.public_detectors:
        text += f" Trackers get the detections of {suite.public_detectors[0]}"
        text += ", 'on oracle' the true boxes." if ORACLE in suite.public_detectors[1:] else "."
    return text + " In brackets: 95 % intervals over seeds."


def board_table(results: Results, board: str, width: int) -> Table:
    """Return a board in rank order, with intervals where the width allows."""
    first = FIRST_METRIC[board]
    columns = shown_columns(board, width)
    table = plain_table()
    table.add_column("", justify="right", style="dim")
    narrow = 19 if width >= FULL else 12
    table.add_column(ENTRY[board], style="bold", min_width=narrow, overflow="fold")
    for heading, _ in columns.values():
        table.add_column(heading, justify="right", no_wrap=True)
    for rank, entry in enumerate(results.entries(board), start=1):
        cells = []
        for metric, (_, decimals) in columns.items():
            row = results.row(board, entry, metric)
            cells.append(figure(row, decimals, interval=metric == first or width >= WIDEST))
        failed = results.row(board, entry, "failed_episodes")
        name = Text(entry)
        if failed is not None and failed.value:
            name.append(f" ({failed.value:.0f} of {failed.n} failed)", style="red")
        table.add_row(str(rank), name, *cells)
    return table


def shown_columns(board: str, width: int) -> Columns:
    """Return the columns that a terminal has room for; the name and the first figure stay."""
    columns = COLUMNS[board]
    if width >= WIDE:
        return columns
    shown = {m: c for m, c in columns.items() if m not in LEFT_OUT}
    # The name, its rank and the first figure with its interval, then about 6 for each further.
    room = len(shown) if width >= FULL else 1 + max(0, (width - 34) // 7)
    return dict(list(shown.items())[:room])


def footnote(board: str, width: int, jobs: int) -> str:
    """Explain the columns that are shown, and say where the others are."""
    shown = shown_columns(board, width)
    texts = [text for metrics, text in EXPLAINED[board] if any(m in shown for m in metrics)]
    if "call_p50_ms" in shown:
        texts.append("ms: per frame, the plug-in's call.")
        if jobs > 1:
            texts.append(f"Taken with {jobs} workers at once; use --jobs 1 for timing.")
    if len(shown) < len(COLUMNS[board]):
        texts.append("More columns on a wider terminal; all in leaderboard.json (--out).")
    return " ".join(texts)


def plain_table(**options: Any) -> Table:
    """Return a table with a rule below its headings and nothing else."""
    return Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=0, **options)


def figure(row: Row | None, decimals: int, *, interval: bool) -> str:
    """Return a value, with its interval if asked for and known."""
    if row is None or row.value is None:
        return "-"
    text = f"{row.value:.{decimals}f}"
    if not interval or row.low is None or row.high is None:
        return text
    return f"{text} [{_short(row.low, decimals)}, {_short(row.high, decimals)}]"


def score_table(scores: Mapping[str, Score], title: str) -> Table:
    """Return the scores of one episode."""
    table = plain_table(title=title, title_justify="left", title_style="bold")
    table.add_column("metric")
    table.add_column("value", justify="right")
    table.add_column("unit")
    table.add_column("samples", justify="right")
    for name, score in scores.items():
        value = "-" if math.isnan(score.value) else f"{score.value:.3f}"
        table.add_row(name, value, "" if score.unit == "1" else score.unit, str(score.n))
    return table


def speed_table(rows: Sequence[Any]) -> Table:
    """Return measured speeds; rows have a name, a value and a unit."""
    table = plain_table()
    table.add_column("measured", style="bold", ratio=1)
    table.add_column("value", justify="right")
    table.add_column("unit")
    for row in rows:
        table.add_row(row.name, f"{row.value:.4g}", row.unit)
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


def _short(value: float, decimals: int) -> str:
    """Drop the zero before the point: intervals are narrow that way."""
    text = f"{value:.{decimals}f}"
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text
