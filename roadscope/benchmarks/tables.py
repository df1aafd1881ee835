"""Tables for a terminal: scores, speeds, calibrations, files and names."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich import box
from rich.table import Column, Table
from rich.text import Text

from roadscope.benchmarks.cached_files import KindUsage, size_text
from roadscope.benchmarks.metrics.score import Score
from roadscope.core.text import one_line


def plain_table(*headings: Column | str, **options: Any) -> Table:
    """Return a table with a rule below its headings and nothing else."""
    return Table(
        *headings, box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=0, **options
    )


def right(heading: str, *, no_wrap: bool = False) -> Column:
    """Return a column of figures."""
    return Column(heading, justify="right", no_wrap=no_wrap)


MEANINGS: Mapping[str, Mapping[str, str]] = {
    "detector": {
        "detection_rate": "eligible objects detected within 2 m",
        "precision": "detections that are an object",
        "f1": "harmonic mean of both",
        "false_alarms_per_frame": "detections that are no object",
        "ap": "average precision, gates 0.5 to 4 m",
        "position_rmse_m": "error of centres from above, RMS",
        "heading_rmse_deg": "error of the length axis, RMS",
        "size_rmse_m": "error of length and width, RMS",
        "category_accuracy": "matches with the right category",
        "call_p50_ms": "processor time a frame, median",
    },
    "tracker": {
        "hota": "detection and association together",
        "mota": "1 - share of misses, false, switches",
        "idf1": "frames explained by one track",
        "id_switches": "object goes to another track",
        "fragmentations": "object is lost and tracked again",
        "recall": "object frames with a track",
        "precision": "track frames with an object",
        "motp_m": "distance of track and object, mean",
        "velocity_rmse_m_s": "error of velocities, RMS",
        "call_p50_ms": "processor time an update, median",
    },
    "odometry": {
        "t_rel": "position drift, share of distance driven",
        "r_rel": "drift of the heading in 100 m",
        "ate": "error of positions, RMS",
        "end": "error of the last position",
        "rpe": "error from scan to scan, RMS",
        "rpe_rotation": "error of turns from scan to scan, RMS",
        "false_motion": "farthest motion of a standing ego",
        "degraded": "scans with an uncertain pose",
        "dynamic_precision": "dynamic returns of moving objects",
        "call_p50_ms": "processor time a scan, median",
    },
}
"""Meanings of the ten main figures of each kind of plug-in, in the order of display."""


def explained_table(kind: str, scores: Mapping[str, Score]) -> Table:
    """Return the main figures of one episode with their meaning; those without unit are shares.

    kind: `detector`, `tracker` or `odometry`.
    """
    metric, unit, best = (Column(each, no_wrap=True) for each in ("metric", "unit", "best"))
    table = plain_table(metric, right("value", no_wrap=True), unit, best, "meaning")
    for name, meaning in MEANINGS[kind].items():
        if name in scores:
            direction = "high" if scores[name].better == "higher" else "low"
            table.add_row(name, *_value_and_unit(scores[name]), direction, meaning)
    return table


def _value_and_unit(score: Score) -> tuple[str, str]:
    value = "-" if math.isnan(score.value) else f"{score.value:.3f}"
    return value, "" if score.unit == "1" else score.unit


def score_table(scores: Mapping[str, Score]) -> Table:
    """Return all scores of one episode with their numbers of samples."""
    table = plain_table("metric", right("value"), "unit", right("samples"))
    for name, score in scores.items():
        table.add_row(name, *_value_and_unit(score), str(score.n))
    return table


def speed_table(rows: Sequence[Any]) -> Table:
    """Return measured speeds; rows are `speed.rows.SpeedRow`s."""
    table = plain_table(Column("measured", style="bold", ratio=1), right("value"), "unit")
    for row in rows:
        table.add_row(row.name, "-" if row.value is None else f"{row.value:.4g}", row.unit)
    return table


def pose_table(rows: Sequence[Any]) -> Table:
    """Return the errors by number of poses of the target; rows are `calibrating.PoseRow`s."""
    table = plain_table(
        right("poses"),
        right("  reprojection\npx"),
        right("  8 to 30 m\npx"),
        right("  worst\npx"),
        right("  position\ncm"),
        right("  rotation\ndeg"),
        right("  by corners\npx"),
    )
    for row in rows:
        figures = (
            row.reprojection_px,
            row.held_out_px,
            row.held_out_most_px,
            100 * row.position_m,
            row.rotation_deg,
            row.corners_px,
        )
        cells = ("-" if not math.isfinite(value) else f"{value:.2f}" for value in figures)
        table.add_row(str(row.poses), *cells)
    return table


def usage_table(usages: Sequence[KindUsage]) -> Table:
    """Return numbers of files and sizes by kind, with their sum."""
    kind = Column("kind", style="cyan", no_wrap=True)
    table = plain_table(kind, right("files", no_wrap=True), right("size", no_wrap=True), "what")
    for usage in usages:
        size = size_text(usage.size_bytes)
        table.add_row(usage.kind, f" {usage.files}", f" {size}", f" {usage.description}")
    files, size_bytes = sum(u.files for u in usages), sum(u.size_bytes for u in usages)
    table.add_row("all", str(files), f" {size_text(size_bytes)}", "")
    return table


def name_table(kind: str, names: Sequence[tuple[str, str]]) -> Table:
    """Return names with their descriptions."""
    table = plain_table(
        Column(style="cyan", no_wrap=True),
        "",
        title=kind,
        title_justify="left",
        title_style="bold",
        show_header=False,
    )
    for name, text in names:
        table.add_row(one_line(name), Text(one_line(text)))
    return table
