"""Results broken down, as tables for a terminal and for Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from rich.table import Table
from rich.text import Text

from roadscope.benchmarks.boards.columns import ENTRY, FULL, NAME, NARROW_NAME
from roadscope.benchmarks.boards.results import BREAKDOWNS, Results
from roadscope.benchmarks.boards.rows import DETECTOR, INPUTS, RECORDED_CONDITIONS, Row
from roadscope.benchmarks.boards.tables import figure
from roadscope.benchmarks.metrics.breakdown import BANDS
from roadscope.benchmarks.metrics.tracking.alphas import BY_ALPHA, CURVES
from roadscope.benchmarks.recorded.combined import NEES_BAND
from roadscope.benchmarks.recorded.recording import KITTI_BOARDS, MOT_BOARDS, RECORDED_BOARDS
from roadscope.benchmarks.tables import plain_table

NEES, ALL, ALARMED = "nees_position", "all", "false_alarms"
SHOWN: Mapping[str, Sequence[str]] = {
    "detection": (
        "detection_rate", "precision", "f1", "false_alarms_per_frame", "ap", "position_rmse_m",
        "heading_rmse_deg", "size_rmse_m",
    ),
    "tracking": ("hota", *CURVES),
    "camera": ("ap50", "detection_rate", "precision"),
    "fusion": ("ap", "detection_rate", "precision"),
    "odometry": ("failed", "t_rel", "end", "position_error", "false_motion", "dynamic_recall"),
    **dict.fromkeys(KITTI_BOARDS, ("hota", "hota_3d", "mota", "idf1", ALARMED, NEES, *CURVES)),
    **dict.fromkeys(MOT_BOARDS, ("hota", "mota", "idf1", ALARMED, *CURVES)),
}  # fmt: skip
"""What is shown of each board where it is broken down; `leaderboard.json` holds more."""
HEADINGS = {
    "detection_rate": "detected", "precision": "precision", "hota": "HOTA", "mota": "MOTA",
    "idf1": "IDF1", "hota_3d": "HOTA of 3-D boxes", "det_a": "DetA", "ass_a": "AssA",
    "loc_a": "LocA", NEES: "NEES (its 95 % band)", "ap50": "AP50", "ap": "AP", "f1": "F1",
    ALARMED: "false alarms",
    "false_alarms_per_frame": "false alarms per frame", "position_rmse_m": "position RMSE (m)",
    "heading_rmse_deg": "heading RMSE (degrees)", "size_rmse_m": "size RMSE (m)",
    "failed": "failure rate", "t_rel": "t_rel (%)", "position_error": "error of the position (m)",
    "end": "error of the last position (m)", "false_motion": "false motion of a standing ego (m)",
    "dynamic_recall": "dynamic returns told",
}  # fmt: skip
QUANTITIES = {
    "range": "range, m",
    "occlusion": "occlusion, % of rays",
    "points": "points on target",
    "size": "size in the image",
    "distance": "distance, m",
}
EVERYWHERE = "A false detection has none: in AP it counts in each band, and there is no precision."
OWN = {
    by: f"Objects and their errors by the true {by}, false detections by their own."
    for by in ("range", "category")
}
NOTES = {
    "occlusion": f"Occlusion: share of the object's rays that something else caught. {EVERYWHERE}",
    "points": f"Points: returns from the object. {EVERYWHERE}",
    "score": "Scores are calibrated where precision lies within their band.",
    "weather": "What fog and rain leave too few returns from is not to be found.",
    "detector": "In brackets: the rank on these detections.",
    "inputs": "In brackets: the rank on these detections.",
    "distance": "t_rel: over all stretches of that length; position: where that way is driven.",
    BY_ALPHA: "A pair is a hit where its similarity reaches alpha; HOTA is the mean over alphas.",
    "size": "small: below 32 x 32 pixels, large: above 96 x 96.",
}
"""What is said below tables of every board; `OWN` of the detection board's."""
OF_NEES = (
    "NEES over its degrees of freedom: in brackets between what that of a consistent tracker lies "
    "in 95 %, each object's errors taken for one value; all: all sequences."
)
OF_SEQUENCES = (
    "Where no object of the class is labelled, as in an empty file of labels, there are no figures "
    "but false alarms, which count in HOTA, MOTA and IDF1 of all sequences."
)
LONGEST = 7
"""Headings are broken into lines of this many characters."""
LONGEST_PIECE = 22
"""And pieces of specs into lines of this many."""
UNRANKED, RANKED, PAIRED, BANDED = 5, 9, 11, 17
"""How wide figures are, figures with a rank, rates with false alarms, and NEES with its band."""
ALARMS = {"camera": "false alarms per image", "fusion": "false alarms per scan"}
"""What is said of rates beside, in brackets, where detectors tell no score to choose by."""
BROKEN = {
    "motorway": "motor-\nway", "roundabout": "round-\nabout", "intersection": "inter-\nsection",
    "racetrack": "race-\ntrack", "motorcycle": "motor-\ncycle", "pedestrian": "pedes-\ntrian",
    "occlusion": "occlu-\nsion", "vehicles": "vehi-\ncles", "standing": "stand-\ning",
    "barriers": "barri-\ners", "distance": "distance",
    "zhang2017": "zhang-\n2017", "distance-l-shape": "distance\nl-shape",
    "dbscan-l-shape": "dbscan\nl-shape",
}  # fmt: skip
"""Names, and words of names, that are broken elsewhere."""


def breakdown_tables(
    results: Results, board: str, by: str, width: int, metrics: Sequence[str] = ()
) -> list[Table]:
    """Return tables of each metric that is defined, entries by bands, in rank order.

    metrics: these alone, if any are named.

    Bands that the width has no room for continue in a table below.
    """
    rows = _parts(results, board, by)
    tables = []
    for metric, cells in _shown_cells(rows, board):
        if metrics and metric not in metrics:
            continue
        remarks = _remarks(results, board, metric, cells)
        title = whole = _title(metric, by, board if _alarms(results, board, cells) else "")
        for bands in _pages(list(cells.values()), width, board if remarks else ""):
            table = _table(results, board, cells, remarks, (bands, width))
            table.title, title = title, f"{whole}, continued"
            if metric == "detection_rate":
                _add_counts(table, rows, bands, width)
            if metric == SHOWN[board][0] and by in RECORDED_CONDITIONS:
                _add_objects(table, rows, bands)
            tables.append(table)
    return tables


def note(board: str, by: str) -> str:
    """Return what is said below a board's tables by a quantity; often nothing."""
    if by in RECORDED_CONDITIONS:
        return f"{OF_SEQUENCES} {OF_NEES}" if board in KITTI_BOARDS else OF_SEQUENCES
    return OWN[by] if board == "detection" and by in OWN else NOTES.get(by, "")


def markdown_lines(results: Results, board: str) -> list[str]:
    """Return Markdown tables of everything that a board is broken down by."""
    lines = []
    for title, (headings, *rows) in parts_as_text(results, board):
        table = [markdown_row(headings), markdown_row(["---"] * len(headings))]
        for entry, *figures in rows:
            table.append(markdown_row([entry.replace("|", "\\|"), *figures]))
        lines += ["", f"### {title}", "", *table]
    return lines


def parts_as_text(results: Results, board: str) -> Iterator[tuple[str, list[list[str]]]]:
    """Yield title and rows, the headings first, of everything that a board is broken down by."""
    for by in BREAKDOWNS[board]:
        for metric, cells in _shown_cells(_parts(results, board, by), board):
            if cells:
                paired = board if _alarms(results, board, cells) else ""
                remarks = _remarks(results, board, metric, cells)
                yield _title(metric, by, paired), _texts(results, board, cells, remarks)


def _parts(results: Results, board: str, by: str) -> list[Row]:
    """Return the rows of a board by something; beside NEES of each sequence that of all."""
    parts = results.breakdown(by, board)
    if board not in KITTI_BOARDS or by not in RECORDED_CONDITIONS:
        return parts
    whole = [row for row in results.rows if row.board == board]
    return parts + [
        replace(row, by=by, band=ALL) for row in whole if row.metric in (NEES, *NEES_BAND)
    ]


def _shown_cells(
    rows: Sequence[Row], board: str
) -> Iterator[tuple[str, dict[tuple[str, str], Row]]]:
    """Return each metric shown and its rows by entry and band.

    Where objects are broken down too, a band without any is left out: matched detections may
    lie a little beyond the farthest object. A sequence without any is shown without figures.
    """
    wanted = {row.band for row in rows if row.metric == SHOWN[board][0]}
    wanted |= {ALL} if wanted else set()
    by_sequence = [row for row in rows if row.metric == ALARMED and board in RECORDED_BOARDS]
    for metric in SHOWN[board]:
        if metric == ALARMED:
            yield metric, {(row.entry, row.band): row for row in by_sequence}
            continue
        found = [row for row in rows if row.metric == metric]
        cells = {(r.entry, r.band): r for r in found if not wanted or r.band in wanted}
        if cells and metric != NEES:
            bare = [replace(row, metric=metric, value=None, samples=0) for row in by_sequence]
            cells = {(row.entry, row.band): row for row in bare} | cells
        yield metric, cells


def bands_of(rows: Sequence[Row]) -> list[str]:
    """Return the bands of rows, quantities and sequences ascending, conditions as in the suite."""
    found = dict.fromkeys(row.band for row in rows)
    if rows and rows[0].by in RECORDED_CONDITIONS:
        return sorted(found, key=lambda band: (band == ALL, band))
    ordered = BANDS[rows[0].by].labels if rows and rows[0].by in BANDS else tuple(found)
    known = [band for band in ordered if band in found]
    return known + [band for band in found if band not in known]


def _title(metric: str, by: str, board: str = "") -> str:
    """Name a table; board: where rates have false alarms beside them."""
    beside = f" ({ALARMS[board]})" if board else ""
    return f"{HEADINGS[metric]}{beside} by {QUANTITIES.get(by, by)}"


def _table(
    results: Results,
    board: str,
    cells: Mapping[tuple[str, str], Row],
    remarks: Mapping[tuple[str, str], str],
    place: tuple[Sequence[str], int],
) -> Table:
    bands, width = place
    table = plain_table(title_justify="left", title_style="bold")
    narrow = NAME if width >= FULL else NARROW_NAME
    table.add_column(ENTRY[board], style="bold", min_width=narrow, overflow="fold")
    for band in bands:
        table.add_column(heading(band), justify="right", no_wrap=True)
    marked = False
    for entry in results.entries(board):
        is_mark = results.standing(board, entry).mark is not None
        if is_mark and not marked:
            table.add_section()
        marked = is_mark
        figures = [_cell(cells, remarks, entry, band) for band in bands]
        name = Text(entry, style="not bold" if is_mark else "")
        table.add_row(name, *figures, style="dim" if is_mark else None)
    return table


def _places(
    results: Results, board: str, cells: Mapping[tuple[str, str], Row]
) -> dict[tuple[str, str], int]:
    """Return the rank of each entry on the detections of each detector, 1 for the best.

    Where results are broken down by anything else there are none.
    """
    ranked = [e for e in results.entries(board) if results.standing(board, e).mark is None]
    bands: dict[str, list[tuple[float, str]]] = {}
    for (entry, band), row in cells.items():
        if row.by in (DETECTOR, INPUTS) and entry in ranked and row.value is not None:
            bands.setdefault(band, []).append((row.value, entry))
    return {
        (entry, band): 1 + sum(other > value for other, _ in entries)
        for band, entries in bands.items()
        for value, entry in entries
    }


def _alarms(
    results: Results, board: str, cells: Mapping[tuple[str, str], Row]
) -> dict[tuple[str, str], str]:
    """Return the false alarms that stand beside detection rates."""
    first = next(iter(cells.values()), None)
    if board not in ALARMS or first is None or first.metric != "detection_rate":
        return {}
    return {
        (row.entry, row.band): f"{row.value:.2f}"
        for row in results.breakdown(first.by, board)
        if row.metric == "false_alarms" and row.value is not None
    }


def _remarks(
    results: Results, board: str, metric: str, cells: Mapping[tuple[str, str], Row]
) -> dict[tuple[str, str], str]:
    """Return what stands in brackets: a rank, false alarms, or a band."""
    if alarms := _alarms(results, board, cells):
        return alarms
    if metric == NEES:
        return _bands_of_nees(results, board, cells)
    if metric != SHOWN[board][0]:
        return {}
    return {cell: str(rank) for cell, rank in _places(results, board, cells).items()}


def _bands_of_nees(
    results: Results, board: str, cells: Mapping[tuple[str, str], Row]
) -> dict[tuple[str, str], str]:
    """Return between what the NEES of a consistent tracker would lie."""
    by = next((row.by for row in cells.values()), "")
    rows = _parts(results, board, by) if by else []
    ends = [
        {(r.entry, r.band): f"{r.value:.2f}" for r in rows if r.metric == m and r.value is not None}
        for m in NEES_BAND
    ]
    return {cell: f"{ends[0][cell]}-{ends[1][cell]}" for cell in ends[0]}


def _cell(
    cells: Mapping[tuple[str, str], Row],
    remarks: Mapping[tuple[str, str], str],
    entry: str,
    band: str,
) -> str:
    row = cells.get((entry, band))
    text = figure(row, 0 if row is not None and row.metric == ALARMED else 2, interval=False)
    remark = remarks.get((entry, band))
    return text if remark is None else f"{text} ({remark})"


def _add_counts(table: Table, rows: Sequence[Row], bands: Sequence[str], width: int) -> None:
    """Say how many objects were to be found, and how many not, for want of returns."""
    counts = {band: [0, 0] for band in bands}
    for row in rows:
        if row.band in counts and row.metric == "detection_rate":
            # Entries that failed in some episodes had fewer to find.
            counts[row.band][0] = max(counts[row.band][0], row.samples)
        if row.band in counts and row.metric == "unseen_per_frame":
            unseen = round((row.value or 0.0) * row.samples)
            counts[row.band][1] = max(counts[row.band][1], unseen)
    labels = ("to be found", "too few returns") if width >= FULL else ("to find", "unseen")
    for index, label in enumerate(labels):
        figures = [count[index] for count in counts.values()]
        if any(figures):
            table.add_row(Text(label, style="not bold"), *map(str, figures), style="dim")


def _add_objects(table: Table, rows: Sequence[Row], bands: Sequence[str]) -> None:
    """Say in how many frames objects of each sequence are, summed over the objects."""
    counts = [max((r.samples for r in rows if (r.metric, r.band) == ("mota", band)), default=0)
              for band in bands]  # fmt: skip
    table.add_row(Text("object frames", style="not bold"), *map(str, counts), style="dim")


def _pages(rows: Sequence[Row], width: int, board: str = "") -> list[list[str]]:
    """Divide the bands of rows into those that there is room for side by side, at least one."""
    whole = width - (NAME if width >= FULL else NARROW_NAME) - 1
    ranked = bool(rows) and rows[0].by in (DETECTOR, INPUTS)
    least = RANKED if ranked else PAIRED if board in ALARMS else UNRANKED
    least = BANDED if rows and rows[0].metric == NEES else least
    pages: list[list[str]] = []
    room = 0
    for band in bands_of(rows):
        wide = max(least, *map(len, heading(band).split("\n"))) + 1
        if not pages or room < wide:
            pages.append([])
            room = whole
        pages[-1].append(band)
        room -= wide
    return pages


def heading(band: str) -> str:
    """Break a long label into lines, at its hyphens where it has some.

    Specs with arguments and those of files have a line for each argument and folder.
    """
    if band in BROKEN or len(band) <= LONGEST:
        return BROKEN.get(band, band)
    if "?" in band or "/" in band or ("." in band and ":" in band):
        return "\n".join(_spec_lines(band))
    if ":" in band or " + " in band:
        return band.replace(" + ", "\n").replace("-", "-\n")
    lines = []
    for word in band.split("-"):
        if word in BROKEN:
            lines.append(BROKEN[word])
            continue
        pieces = [word[i : i + LONGEST] for i in range(0, len(word), LONGEST)]
        lines += [f"{piece}-" for piece in pieces[:-1]] + pieces[-1:]
    return "\n".join(lines)


def _spec_lines(spec: str) -> list[str]:
    """Break a spec behind what divides it: folders, class, arguments."""
    name, sign, arguments = spec.partition("?")
    if not re.search("[/:.]", name) and len(name) > LONGEST:
        first = heading(name).split("\n")
    else:
        first = re.findall("[^/:]+[/:]?|[/:]", name)
    first[-1] += sign
    pieces = [*first, *re.findall("[^&]+&?", arguments)]
    return [
        piece[i : i + LONGEST_PIECE]
        for piece in pieces
        for i in range(0, len(piece), LONGEST_PIECE)
    ]


def _texts(
    results: Results,
    board: str,
    cells: Mapping[tuple[str, str], Row],
    remarks: Mapping[tuple[str, str], str],
) -> list[list[str]]:
    bands = bands_of(list(cells.values()))
    rows = [
        [entry, *(_cell(cells, remarks, entry, band) for band in bands)]
        for entry in results.entries(board)
    ]
    return [["entry", *bands], *rows]


def markdown_row(cells: Sequence[str]) -> str:
    """Return a line of a Markdown table."""
    return "| " + " | ".join(cells) + " |"
