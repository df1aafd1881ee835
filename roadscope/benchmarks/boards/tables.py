"""Leaderboards as tables for a terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from roadscope.benchmarks.boards.columns import (
    ENTRY,
    FULL,
    NAME,
    NARROW_NAME,
    shown_columns,
    with_intervals,
)
from roadscope.benchmarks.boards.rank_agreement import LEAST
from roadscope.benchmarks.boards.results import Results, reason_alone
from roadscope.benchmarks.boards.rows import Row
from roadscope.benchmarks.boards.standing import Standing
from roadscope.benchmarks.drive import MOVING_M_S
from roadscope.benchmarks.jobs.entries import BOARDS
from roadscope.benchmarks.oracle import ORACLE
from roadscope.benchmarks.recorded.recording import KITTI_BOARDS, OFFLINE, RECORDED_BOARDS
from roadscope.benchmarks.recorded.suite import RecordedSuite
from roadscope.benchmarks.suite import Suite
from roadscope.benchmarks.tables import plain_table

IN_IMAGES = (
    "To be found in images: road users of whom 40 pixels show, 8 high, at most three quarters "
    "hidden and not lost in fog or rain; parked cars count neither way."
)
IN_BOTH = (
    "To be found by fusions: road users in the image, 3 to 60 m away, with 5 returns or 60 pixels, "
    "12 high, less than nine tenths hidden."
)


def conditions(suite: Suite, boards: Sequence[str] = BOARDS) -> str:
    """Say what is to be found, by whom, and how sure the figures are."""
    if isinstance(suite, RecordedSuite):
        return recorded_conditions(suite)
    texts = [_of_lidar(suite)] if set(boards) & set(BOARDS) else []
    texts += [IN_IMAGES] if "camera" in boards else []
    if "fusion" in boards:
        lidar, camera = (" and ".join(d) for d in (suite.fused_lidar, suite.fused_camera))
        texts += [IN_BOTH, f"They get the detections of {lidar} with those of {camera}."]
        if any(d.startswith("noisy-camera") for d in suite.fused_camera):
            texts.append("noisy-camera is an imitation made from truth.")
    if "odometry" in boards:
        texts.append(_of_odometry(suite))
    return " ".join([*texts, "In brackets: 95 % intervals over seeds."])


def _of_lidar(suite: Suite) -> str:
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
    return text


def _of_odometry(suite: Suite) -> str:
    *lengths, last = (f"{length_m:g}" for length_m in suite.odometry_lengths_m)
    over = f"{', '.join(lengths)} and {last}" if lengths else last
    return (
        f"Drifts t_rel and r_rel are over stretches of {over} m, as KITTI has it. 'on oracle': "
        "without the returns of what truly moves, faster than "
        f"{MOVING_M_S:g} m/s; what stands at that time stays."
    )


def recorded_conditions(suite: RecordedSuite) -> str:
    """Say whose detections are tracked, in which sequences, and how sure the figures are."""
    sequences = len(dict.fromkeys(r.sequence for r in suite.recordings))
    first, *others = suite.public_detectors
    text = f"{sequences} of {suite.labelled} labelled sequences have detections. "
    text += f"Trackers get those of {first}"
    text += f", and where it says so of {', '.join(others)}." if others else "."
    return f"{text} In brackets: 95 % intervals over sequences. {suite.remark}".rstrip()


def board_table(results: Results, board: str, width: int) -> Table:
    """Return a board in rank order, who failed everywhere, then marks; what the width allows."""
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
        table.add_row(str(place.rank or ""), _name(results, place), *cells, style=style)
    return table


def failure_lines(results: Results, board: str) -> list[str]:
    """Say of those that failed in every episode why, in rows without a rank."""
    lines = []
    for place in results.standings:
        if place.board == board and place.reason is not None:
            absent = results.not_installed(place.entry)
            what = "is left out" if absent else "failed in every episode"
            lines.append(f"{place.entry} {what}: {reason_alone(place.entry, place.reason)}")
    return lines


def believed_lines(results: Results, board: str) -> list[str]:
    """Say what fusions believe of the sensors if it is not what the rig says."""
    name = results.manifest.get("calibration")
    return [f"Fusions believe the calibration {name}."] if name and board == "fusion" else []


def _name(results: Results, standing: Standing) -> Text:
    name = Text(standing.entry, style="not bold" if standing.mark else "")
    told = standing.entry.endswith(f" on {ORACLE}") and standing.board == "odometry"
    if standing.mark and not told and standing.mark.split()[0] not in standing.entry:
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


UNCOMPARED = (
    "How these ranks agree with those on simulated traffic is told once that was run too: "
    "roadscope leaderboard tracking --suite tracking, with the same --out if any."
)


def agreement_lines(results: Results, board: str) -> list[str]:
    """Say how the ranks of a board of recorded data agree with those on simulated traffic.

    Where nothing was run that they could be compared with, say what to run.
    """
    lines = [
        f"Ranks agree with those of suite {a.suite} by {a.rho:.2f} (Spearman, "
        f"{len(a.entries)} trackers; 1 is the same order)."
        for a in results.agreements
        if a.board == board
    ]
    ranked = [s for s in results.standings if s.board == board and s.rank is not None]
    comparable = board in KITTI_BOARDS and len(ranked) >= LEAST
    return lines or [UNCOMPARED] * comparable


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
    same = "sequences" if board in RECORDED_BOARDS else "seeds"
    return f"{told} By 95 % intervals of differences on the same {same}."


def figure(row: Row | None, decimals: int, *, interval: bool) -> str:
    """Return a value, with its interval if asked for, known and of any width."""
    if row is None or row.value is None:
        return "-"
    if row.metric == OFFLINE:
        return "offline" if row.value else "online"
    if row.board == "odometry":
        # From millimetres to kilometres: three digits tell.
        decimals = max(decimals - int(math.log10(max(abs(row.value), 1.0))), 0)
    text = f"{row.value:.{decimals}f}"
    if not interval or row.low is None or row.high is None or row.low == row.high:
        return text
    return f"{text} [{_short(row.low, decimals)}, {_short(row.high, decimals)}]"


def _short(value: float, decimals: int) -> str:
    """Drop the zero before the point: intervals are narrow that way."""
    text = f"{value:.{decimals}f}"
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text
