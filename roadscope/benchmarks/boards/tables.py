"""Results as tables for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from roadscope.benchmarks.boards.results import Results
from roadscope.benchmarks.boards.rows import FIRST_METRIC, Row
from roadscope.benchmarks.boards.standing import Standing
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.oracle import ORACLE
from roadscope.benchmarks.recorded.recording import KITTI_BOARDS, OFFLINE
from roadscope.benchmarks.recorded.suite import RecordedSuite
from roadscope.benchmarks.suite import Suite

FULL = 76
"""Width from which on all main figures are shown."""
NAME, NARROW_NAME = 19, 12
"""Least widths of the entry's column, at full width and below."""
PLACES, FIRST, OTHER, INTERVAL = 3, 17, 7, 12
"""About how wide columns are: places, the first figure with its interval, any other, and what an
interval adds to it."""

Columns = Mapping[str, tuple[str, int]]
"""Metric -> heading and decimals."""

KITTI_COLUMNS: Columns = {
    "hota": ("HOTA", 3),
    OFFLINE: ("pass", 0),
    "det_a": ("DetA", 3),
    "ass_a": ("AssA", 3),
    "mota": ("MOTA", 3),
    "idf1": ("IDF1", 3),
    "id_switches": ("ID\nsw.", 1),
    "fragmentations": ("frag-\nments", 1),
    "hota_3d": ("HOTA\n3-D", 3),
    "samota_3d": ("sAMOTA\n3-D", 3),
    "hota_centre": ("HOTA\ncentre", 3),
    "mota_3d": ("MOTA\n3-D", 3),
    "call_p50_ms": ("ms\np50", 2),
    "call_p99_ms": ("ms\np99", 2),
}

COLUMNS: Mapping[str, Columns] = {
    "detection": {
        "f1": ("F1", 2),
        "detection_rate": ("detec-\nted", 2),
        "precision": ("preci-\nsion", 2),
        "false_alarms_per_frame": ("false/\nframe", 2),
        "ap": ("AP", 2),
        "ap_iou_50": ("AP\nIoU.5", 2),
        "ap_iou_70": ("AP\nIoU.7", 2),
        "calibration_error": ("cal.\nerror", 2),
        "position_rmse_m": ("pos.\nm", 2),
        "longitudinal_rmse_m": ("long.\nm", 2),
        "lateral_rmse_m": ("lat.\nm", 2),
        "heading_rmse_deg": ("head.\ndeg", 1),
        "heading_flips": ("flip-\nped", 3),
        "size_rmse_m": ("size\nm", 2),
        "category_accuracy": ("cate-\ngory", 2),
        "delay_s": ("delay\ns", 2),
        "call_p50_ms": ("ms\np50", 2),
        "call_p99_ms": ("ms\np99", 2),
    },
    "tracking": {
        "hota": ("HOTA", 2),
        "mota": ("MOTA", 2),
        "idf1": ("IDF1", 2),
        "id_switches": ("ID\nsw.", 1),
        "wrong_associations": ("wrong\nassoc", 1),
        "kept_through_occlusion": ("kept\nhidden", 2),
        "fragmentations": ("frag-\nments", 1),
        "motp_m": ("MOTP\nm", 2),
        "velocity_rmse_m_s": ("vel.\nm/s", 2),
        "det_a": ("DetA", 2),
        "ass_a": ("AssA", 2),
        "samota": ("sAMO-\nTA", 2),
        "gospa_m": ("GOSPA\nm", 2),
        "heading_rmse_deg": ("head.\ndeg", 1),
        "inside_state": ("in\n95 %", 2),
        "call_p50_ms": ("ms\np50", 2),
        "call_p99_ms": ("ms\np99", 2),
    },
    **dict.fromkeys(KITTI_BOARDS, KITTI_COLUMNS),
}

WIDER: Mapping[str, Sequence[str]] = {
    "detection": (
        "heading_rmse_deg", "ap_iou_50", "call_p99_ms", "category_accuracy", "size_rmse_m",
        "calibration_error", "ap_iou_70", "heading_flips", "longitudinal_rmse_m",
        "lateral_rmse_m", "delay_s",
    ),
    "tracking": (
        "velocity_rmse_m_s", "motp_m", "fragmentations", "call_p99_ms", "ass_a", "det_a", "samota",
         "gospa_m", "inside_state", "heading_rmse_deg",
    ),
    **dict.fromkeys(
        KITTI_BOARDS,
        ("ass_a", "det_a", "samota_3d", "hota_centre", "fragmentations", "mota_3d", "call_p99_ms"),
    ),
}  # fmt: skip
"""What only wide terminals show, in the order in which it comes with the width; all of it and
more is in `leaderboard.json`."""

ENTRY = {
    "detection": "detector",
    "tracking": "tracker",
    **dict.fromkeys(KITTI_BOARDS, "tracker"),
}

Explained = Sequence[tuple[Sequence[str], str]]

KITTI_EXPLAINED: Explained = (
    (("hota",), "HOTA, MOTA, IDF1: image boxes, all sequences as one (KITTI's rules)."),
    ((OFFLINE,), "pass: online, or offline with all frames at hand."),
    (("hota_3d", "samota_3d", "mota_3d"), "3-D: IoU in space, from 0.25."),
    (("samota_3d",), "sAMOTA: mean of sequences."),
    (("hota_centre",), "centre: seen from above, gate 2 m."),
    (("id_switches", "fragmentations"), "Counts: per sequence."),
)

EXPLAINED: Mapping[str, Explained] = {
    "detection": (
        (("f1",), "F1, detected, precision: one to one, centres within 2 m seen from above."),
        (("ap",), "AP: mean over 0.5, 1, 2, 4 m."),
        (("ap_iou_50", "ap_iou_70"), "IoU: of boxes seen from above."),
        (("calibration_error",), "cal. error: of the scores (ECE)."),
        (("position_rmse_m",), "pos.: RMSE of matches."),
        (("longitudinal_rmse_m",), "long., lat.: its parts along and across the object."),
        (("heading_rmse_deg",), "head.: RMSE of matches."),
        (("heading_flips",), "flipped: off by more than 45 degrees."),
        (("size_rmse_m",), "size: RMSE of length and width."),
        (("category_accuracy",), "category: share right."),
        (("delay_s",), "delay: from a frame to its answer."),
    ),
    "tracking": (
        (("hota",), "HOTA, MOTA, IDF1: centres seen from above, gate 2 m."),
        (("id_switches", "wrong_associations", "fragmentations"), "Counts: per episode."),
        (("velocity_rmse_m_s",), "vel.: RMSE of matches."),
        (("kept_through_occlusion",), "kept hidden: same track after a time unseen, share."),
        (("samota",), "sAMOTA: as AB3DMOT has it."),
        (("gospa_m",), "GOSPA: order 1, cut-off 2 m, per frame."),
        (("inside_state",), "in 95 %: objects within their tracks' 95 % ellipses."),
        (("heading_rmse_deg",), "head.: RMSE of matches, front and rear told apart."),
    ),
    **dict.fromkeys(KITTI_BOARDS, KITTI_EXPLAINED),
}
"""Metrics and what is said of them when one is shown."""


def conditions(suite: Suite) -> str:
    """Say what is to be found, by whom, and how sure the figures are."""
    if isinstance(suite, RecordedSuite):
        return recorded_conditions(suite)
    rule = suite.eligibility
    near, far = rule.range_m
    families = " and ".join(f"{family}s" for family in rule.families)
    place = f"within {far:g} m" if near == 0 else f"{near:g} to {far:g} m away"
    text = f"To be found: {families} {place} with at least {rule.min_returns} returns."
    if suite.public_detectors:
        first, *others = [d for d in suite.public_detectors if d != ORACLE] or [ORACLE]
        text += f" Trackers get the detections of {', of '.join([first, *others])}"
        text += "; figures are of all of these together" if others else ""
        text += ", 'on oracle' the true boxes." if ORACLE in suite.public_detectors[1:] else "."
    return text + " In brackets: 95 % intervals over seeds."


def recorded_conditions(suite: RecordedSuite) -> str:
    """Say whose detections are tracked, in which sequences, and how sure the figures are."""
    sequences = len(dict.fromkeys(r.sequence for r in suite.recordings))
    first, *others = suite.public_detectors
    text = f"{sequences} of {suite.labelled} labelled sequences have detections. "
    text += f"Trackers get those of {first}"
    text += f", and where it says so of {', '.join(others)}." if others else "."
    return f"{text} In brackets: 95 % intervals over sequences. {suite.remark}".rstrip()


def board_table(results: Results, board: str, width: int) -> Table:
    """Return a board in rank order, then its marks, with what the width allows."""
    columns, intervals = shown_columns(board, width), with_intervals(board, width)
    table = plain_table()
    table.add_column("", justify="right", style="dim")
    narrow = NAME if width >= FULL else NARROW_NAME
    table.add_column(ENTRY[board], style="bold", min_width=narrow, overflow="fold")
    for heading, _ in columns.values():
        table.add_column(heading, justify="right", no_wrap=True)
    marked = False
    for entry in results.entries(board):
        place = results.standing(board, entry)
        if place.mark is not None and not marked:
            table.add_section()
        marked = place.mark is not None
        cells = [
            figure(results.row(board, entry, metric), decimals, interval=metric in intervals)
            for metric, (_, decimals) in columns.items()
        ]
        style = "dim" if marked else None
        table.add_row(_place(results, place), _name(results, place), *cells, style=style)
    return table


def _place(results: Results, standing: Standing) -> str:
    ranked = standing.rank is not None and not results.not_installed(standing.entry)
    return str(standing.rank) if ranked else ""


def _name(results: Results, standing: Standing) -> Text:
    name = Text(standing.entry, style="not bold" if standing.mark else "")
    if standing.mark and standing.mark.split()[0] not in standing.entry:
        name.append(f" ({standing.mark})")
    late = results.row(standing.board, standing.entry, OFFLINE)
    called_so = standing.entry.split()[0].partition("?")[0].endswith(OFFLINE)
    if late is not None and late.value and not called_so:
        name.append(f" ({OFFLINE})")
    failed = results.row(standing.board, standing.entry, "failed_episodes")
    if results.not_installed(standing.entry):
        name.append(" (not installed)", style="red")
    elif failed is not None and failed.value:
        name.append(f" ({failed.value:.0f} of {failed.n} failed)", style="red")
    return name


def shown_columns(board: str, width: int) -> Columns:
    """Return the columns that a terminal has room for; the name and the first figure stay."""
    columns, wider = COLUMNS[board], WIDER[board]
    main = [metric for metric in columns if metric not in wider]
    if width >= FULL:
        room = max(0, (width - FULL) // OTHER)
        chosen = [*main, *wider[:room]]
    else:
        chosen = main[: 1 + max(0, (width - NARROW_NAME - FIRST - PLACES - 2) // OTHER)]
    return {metric: column for metric, column in columns.items() if metric in chosen}


def with_intervals(board: str, width: int) -> list[str]:
    """Return the metrics whose intervals there is room for: the first, then as they come."""
    shown = list(shown_columns(board, width))
    room = width - PLACES - NAME - FIRST - OTHER * (len(shown) - 1)
    return [FIRST_METRIC[board], *shown[1 : 1 + max(0, room // INTERVAL)]]


def agreement_lines(results: Results, board: str) -> list[str]:
    """Say how the ranks of a board of recorded data agree with those on simulated traffic."""
    return [
        f"Ranks agree with those of suite {a.suite} by {a.rho:.2f} (Spearman, "
        f"{len(a.entries)} trackers; 1 is the same order)."
        for a in results.agreements
        if a.board == board
    ]


def comparison(results: Results, board: str) -> str:
    """Say which entries are not shown to be worse than the best one; empty with one entry."""
    places = [s for s in results.standings if s.board == board and s.rank is not None]
    rivals = [s for s in places[1:] if s.behind is not None]
    if not rivals or rivals[0].behind_low is None:
        return ""
    level = [s.entry for s in rivals if s.behind_low is not None and s.behind_low <= 0]
    told = f"Not shown to be worse than {places[0].entry}: {', '.join(level)}."
    if not level:
        told = f"{places[0].entry} is shown to be better than all others."
    same = "sequences" if board in KITTI_BOARDS else "seeds"
    return f"{told} By 95 % intervals of differences on the same {same}."


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
    """Return a value, with its interval if asked for, known and of any width."""
    if row is None or row.value is None:
        return "-"
    if row.metric == OFFLINE:
        return "offline" if row.value else "online"
    text = f"{row.value:.{decimals}f}"
    if not interval or row.low is None or row.high is None or row.low == row.high:
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
