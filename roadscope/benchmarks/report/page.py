"""One HTML page of the boards in a folder, with plots and a replay of the worst moments.

The page is a single file that loads nothing. Its tables are written by a Jinja2 template with
autoescape; plots and replay are drawn in the browser from a JSON text within the page.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import resources
from itertools import combinations
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from roadscope.benchmarks.boards import Board, board_named
from roadscope.benchmarks.boards.board import Column
from roadscope.benchmarks.cache import FolderError, write_text
from roadscope.benchmarks.report.board_files import NAME, REPLAY, earlier_boards, file_names
from roadscope.benchmarks.report.breakdowns import parts_of
from roadscope.benchmarks.report.replay_records import ReplayMoment
from roadscope.benchmarks.report.tables import (
    comparison,
    failure_of,
    figure,
    is_time,
    measured_columns,
    prediction_headings,
    prediction_note,
    prediction_rows,
    reason_alone,
    remarks_of,
)
from roadscope.benchmarks.results import Results, Row
from roadscope.benchmarks.results.results import entry_results
from roadscope.benchmarks.results.rows import blocks, paired, samples_of
from roadscope.core.palette import PAGE_DARK, PAGE_LIGHT
from roadscope.core.text import last_lines, one_line

PAGE = "report.html"
MOST_BYTES = 1_500_000
"""Greatest size of a page. What does not fit is left out, and the page says so."""
NOTICE_BYTES = 2000
"""Reserved for what a page says about parts that are left out."""
HALVED = tuple(2**k for k in range(10, -1, -1))
"""Most entries of a board, then most boards, that are tried where tables alone are too large."""
FIRST_COLUMNS = 8
"""Columns of a board that are shown at first."""
COMPARED = 5
"""Metrics of a board whose paired differences are on the page, beside times."""
LOG_CHARACTERS, MOST_FAILURES = 4000, 40
"""Captured output of a failure, its end, and most reasons on the page."""
NO_MOMENTS = (
    "No moment is shown: nothing went wrong, the answers are not kept, or the run was made without "
    "a replay, which roadscope leaderboard with the same --out makes without computing twice."
)
BAR_WIDTH = 128
"""Width of a drawn interval in a table, pixels."""


class Run(NamedTuple):
    """The results of a run and the worst moments of its entries. note: why there are none."""

    results: Results
    moments: Sequence[ReplayMoment] = ()
    note: str = ""


def save_moments(moments: Sequence[ReplayMoment], folder: Path) -> Path:
    """Write the worst moments of the latest run to its folder."""
    path = folder / REPLAY
    write_text(path, msgspec.json.encode(moments).decode() + "\n")
    return path


def read_runs(folder: Path) -> list[Run]:
    """Read the boards in a folder of `roadscope leaderboard --out`, the latest run first.

    A folder without any raises `FolderError`; so does a file that cannot be read.
    """
    boards = [path for path in [folder / f"{NAME}.json", *earlier_boards(folder)] if path.is_file()]
    if not boards:
        raise FolderError(
            f"no {NAME}.json in {folder}: name a folder of roadscope leaderboard --out {folder}"
        )
    return [_read_run(path) for path in boards]


def _read_run(board: Path) -> Run:
    try:
        results = Results.from_json(board.read_bytes())
    except (OSError, ValueError) as error:
        raise FolderError(f"cannot read {board}: {error}") from error
    label = board.stem.removeprefix(NAME).removeprefix("-")
    replay = board.with_name(file_names(label)[REPLAY])
    if not replay.is_file():
        return Run(results)
    try:
        return Run(results, msgspec.json.decode(replay.read_bytes(), type=list[ReplayMoment]))
    except (OSError, ValueError) as error:
        return Run(results, note=f"There is no replay, as {replay} cannot be read: {error}")


Boards = list[dict[str, Any]]


def save_page(runs: Sequence[Run], path: Path, *, most_bytes: int = MOST_BYTES) -> list[str]:
    """Write the page of some runs; return what is not on it, and why.

    It is not larger than `most_bytes`. Images of moments are left out first, then moments, the
    least bad ones before others. Where a page without any is too large, parts of boards are left
    out, one kind after the other, until it fits.
    """
    boards = [board for run in runs for board in _boards(run)]
    moments = [board.pop("moments") for board in boards]
    left_out = [run.note for run in runs if run.note]
    bare = [_with_moments(*each, []) for each in zip(boards, moments, strict=True)]
    text = _rendered(bare, left_out)
    cuts = _cuts()
    while len(text.encode()) > most_bytes - NOTICE_BYTES:
        note, cut = next(cuts)
        before, bare = bare, cut(bare)
        if bare == before:
            continue
        # Of cuts of one kind, such as fewer and fewer entries, the last one is named.
        left_out = [each for each in left_out if each.split()[0] != note.split()[0]] + [note]
        text = _rendered(bare, left_out)
    space = most_bytes - NOTICE_BYTES - len(text.encode())
    shown, without_images = _fitting(moments[: len(bare)], space)
    every = sum(map(len, moments))
    if too_much := every - sum(map(len, shown)):
        left_out.append(
            f"{too_much} of {every} moments are left out, as the page would be too large."
        )
    if without_images:
        left_out.append(
            f"Images are left out in {without_images} of {every} moments, as the page would be too "
            "large."
        )
    full = [_with_moments(*each) for each in zip(bare, moments, shown, strict=False)]
    write_text(path, _rendered(full, left_out))
    return left_out


def _fitting(
    moments: Sequence[Sequence[ReplayMoment]], space: int
) -> tuple[list[list[ReplayMoment]], int]:
    """Return the moments of each board that fit into a number of bytes.

    The second value is how many of them are shown without their images.
    """
    shown: list[list[ReplayMoment]] = [[] for _ in moments]
    with_images = []
    # One of each board at a time, the worst ones first; then their images, in the same order.
    for place, number in sorted((p, n) for n, own in enumerate(moments) for p in range(len(own))):
        whole = moments[number][place]
        moment = msgspec.structs.replace(whole, images=[])
        size = len(_as_json(moment)) + 1
        if size <= space:
            space -= size
            shown[number].append(moment)
            if whole.images:
                with_images.append((number, len(shown[number]) - 1, whole))
    without_images = 0
    for number, row, whole in with_images:
        size = len(_as_json(whole.images))
        if size <= space:
            space -= size
            shown[number][row] = whole
        else:
            without_images += 1
    return shown, without_images


def _with_moments(
    board: Mapping[str, Any], moments: Sequence[ReplayMoment], shown: Sequence[ReplayMoment]
) -> dict[str, Any]:
    """Return a board with some of its moments, and with how many of each entry are left out."""
    left_out = Counter(each.entry for each in moments) - Counter(each.entry for each in shown)
    entries = [{**each, "left_out": left_out[each["name"]]} for each in board["entries"]]
    return {**board, "entries": entries, "moments": shown}


def _cuts() -> Iterator[tuple[str, Callable[[Boards], Boards]]]:
    """Yield parts that a page can do without, the least important first: a note and the cut."""

    def without(part: str, first: int = 0) -> Callable[[Boards], Boards]:
        return lambda boards: [{**board, part: board[part][:first]} for board in boards]

    too_large = "as the page would be too large"
    yield f"Breakdowns are left out, {too_large}.", without("breakdowns")
    yield f"Differences of the first metric only are shown, {too_large}.", without("differences", 1)
    yield f"Differences are left out, {too_large}.", without("differences")
    yield f"Captured output is left out, {too_large}.", _without_logs
    yield f"Columns beyond the first {FIRST_COLUMNS} are left out, {too_large}.", _with_few_columns
    yield f"Failures are left out, {too_large}.", without("failures")
    for most in (*HALVED, 0):
        yield (
            f"Entries beyond the first {most} are left out, {too_large}.",
            without("entries", most),
        )
    for most in (*HALVED, 0):
        yield f"Boards beyond the first {most} are left out, {too_large}.", itemgetter(slice(most))


def _without_logs(boards: Boards) -> Boards:
    return [
        {**board, "failures": [{**each, "log": ""} for each in board["failures"]]}
        for board in boards
    ]


def _with_few_columns(boards: Boards) -> Boards:
    few = slice(FIRST_COLUMNS)
    return [
        {
            **board,
            "columns": board["columns"][few],
            "entries": [{**each, "cells": each["cells"][few]} for each in board["entries"]],
        }
        for board in boards
    ]


# --------------------------------------------------------------------------------------------------
# What is on the page.


def _boards(run: Run) -> Iterator[dict[str, Any]]:
    """Yield everything about each board of a run, as JSON can hold it."""
    results = run.results
    for name in results.boards():
        board, entries = board_named(name), results.entries(name)
        columns = measured_columns(results, board)
        calibration = str(results.manifest.get("calibration", ""))
        scale = _Scale.of([results.row(name, entry, board.headline) for entry in entries])
        rows = [_entry(results, name, entry, columns) for entry in entries]
        differences = _differences(results, board, columns)
        yield {
            "name": name,
            "summary": board.summary,
            "suite": f"{results.manifest.get('suite', '')} "
            f"{results.manifest.get('suite_version', '')}".strip(),
            "headline": board.headline,
            "sample": board.sample,
            "remark": f"{comparison(results, name)} {board.remark(calibration)}".strip(),
            "predictions": {
                "note": prediction_note(results, name),
                "headings": prediction_headings(name),
                "rows": prediction_rows(results, name),
            },
            "columns": [_column(results, board, each) for each in columns],
            "entries": [
                {**each, "drawn": scale.drawn(results.row(name, entry, board.headline))}
                for each, entry in zip(rows, entries, strict=True)
            ],
            "breakdowns": list(_breakdowns(results, board)),
            "differences": differences,
            "differences_note": _differences_note(board, differences),
            "moments": [
                msgspec.structs.replace(each, entry=one_line(each.entry))
                for each in run.moments
                if each.board == name
            ],
            "replayable": any(each.board == name for each in run.moments),
            "without_replay": board.without_replay or NO_MOMENTS,
            "intervals": any(cell["interval"] for each in rows for cell in each["cells"]),
            "failures": _failures(results, name),
            "manifest": results.manifest,
        }


class _Scale(NamedTuple):
    """Where figures are drawn, from 0 to `BAR_WIDTH`."""

    low: float
    high: float

    @staticmethod
    def of(rows: Sequence[Row | None]) -> _Scale:
        ends = [end for row in rows if row is not None for end in _ends(row) if end is not None]
        return _Scale(min(ends, default=0.0), max(ends, default=1.0))

    def drawn(self, row: Row | None) -> list[float | None] | None:
        """Return the places of a value and of the ends of its interval; None without a value."""
        if row is None or row.value is None:
            return None
        width = (self.high - self.low) or 1.0
        return [
            None if end is None else round(6 + (end - self.low) / width * (BAR_WIDTH - 12), 1)
            for end in _ends(row)
        ]


def _column(results: Results, board: Board, column: Column) -> dict[str, Any]:
    rows = [results.row(board.name, entry, column.metric) for entry in results.entries(board.name)]
    row = next(row for row in rows if row is not None)
    return {
        "metric": column.metric,
        "heading": column.heading,
        "note": column.note,
        "better": row.better,
        "timed": is_time(column),
    }


def _entry(results: Results, board: str, entry: str, columns: Sequence[Column]) -> dict[str, Any]:
    standing = results.standing(board, entry)
    return {
        "name": one_line(entry),
        "place": standing.place,
        "rank": standing.rank,
        "mark": standing.mark,
        "remarks": remarks_of(results, standing),
        "failure": failure_of(results, standing),
        "cells": [_cell(results, board, entry, column) for column in columns],
    }


def _cell(results: Results, board: str, entry: str, column: Column) -> dict[str, Any]:
    """Return a figure of a board: as text, its interval as text, and numbers to draw and sort."""
    row = results.row(board, entry, column.metric)
    text, _, interval = figure(row, column.decimals, interval=True).partition(" [")
    ends = (None, None, None) if row is None else (row.value, row.low, row.high)
    return {"text": text, "interval": interval.rstrip("]"), "ends": [_short(end) for end in ends]}


def _breakdowns(results: Results, board: Board) -> Iterator[dict[str, Any]]:
    entries = results.entries(board.name)
    for breakdown in board.breakdowns:
        parts = []
        for part in parts_of(results, board.name, breakdown.by):
            if len(part.bands) < 2:
                continue
            rows = part.cells.values()
            cells = [
                [entries.index(r.entry), part.bands.index(r.band), *map(_short, _ends(r))]
                for r in rows
                if r.value is not None and r.band in part.bands
            ]
            better = next((row.better for row in rows), "higher")
            parts.append(
                {
                    "title": part.title,
                    "better": better,
                    "bands": [one_line(band) for band in part.bands],
                    "cells": cells,
                    "remarks": [
                        [entries.index(entry), part.bands.index(band), remark]
                        for (entry, band), remark in part.remarks.items()
                        if band in part.bands
                    ],
                }
            )
        if parts:
            title = breakdown.title or breakdown.by
            yield {"by": breakdown.by, "title": title, "note": breakdown.note, "parts": parts}


def _ends(row: Row) -> tuple[float | None, float | None, float | None]:
    return row.value, row.low, row.high


def _differences(results: Results, board: Board, columns: Sequence[Column]) -> list[dict[str, Any]]:
    """Return by how much each entry exceeds each other one on the same episodes, with intervals.

    A metric's `pairs` has [i, j, difference of entry i less entry j, low, high] for i < j.
    """
    own = {result.entry: result for result in entry_results(results.jobs, board.name)}
    entries = results.entries(board.name)
    timed = [column for column in columns if is_time(column)][:1]
    others = [column for column in columns if not is_time(column)][:COMPARED]
    compared = []
    for column in [*others, *timed]:
        scores = [
            blocks(samples_of(own[entry], column.metric)) if entry in own else {}
            for entry in entries
        ]
        pairs = []
        for i, j in combinations(range(len(entries)), 2):
            interval = paired(scores[i], scores[j])
            if interval.n:
                ends = interval.mean, interval.low, interval.high
                pairs.append([i, j, *map(_short, ends)])
        if pairs:
            compared.append({"metric": column.metric, "pairs": pairs})
    return compared


def _differences_note(board: Board, differences: Sequence[Mapping[str, Any]]) -> str:
    """Return what differences are over, and which of them have intervals."""
    if not differences:
        return "There are no two entries to compare."
    if not board.sample:
        return "Over all frames together, without intervals."
    text = f"Paired on the same {board.sample} of each scenario"
    with_interval = [low is not None for each in differences for _, _, _, low, _ in each["pairs"]]
    if not any(with_interval):
        return f"{text}, which are too few for intervals."
    text += ", with 95 % intervals, each by itself"
    return f"{text}." if all(with_interval) else f"{text}, where there are enough {board.sample}."


def _failures(results: Results, board: str) -> list[dict[str, Any]]:
    """Return why entries failed: one item for each entry and reason, with the episodes."""
    items: dict[tuple[str, str], dict[str, Any]] = {}
    for failure in results.failures:
        if failure.board != board:
            continue
        reason = reason_alone(failure.entry, failure.reason)
        item = items.setdefault(
            (failure.entry, reason),
            {"entry": one_line(failure.entry), "reason": reason, "episodes": [], "log": ""},
        )
        item["episodes"].append(f"{failure.scenario}, seed {failure.seed}, {failure.condition}")
        item["log"] = item["log"] or last_lines(failure.log, LOG_CHARACTERS)
    return list(items.values())[:MOST_FAILURES]


def _short(value: float | None) -> float | None:
    """Return a number with five significant digits; None for one that is not finite."""
    return None if value is None or value - value != 0 else float(f"{value:.5g}")


# --------------------------------------------------------------------------------------------------
# HTML.


def _variables(colours: Mapping[str, str], scheme: str) -> str:
    """Return the colours of the page as a block of its style sheet."""
    named = " ".join(f"--{name}: {value};" for name, value in colours.items())
    return f"{{ {named} color-scheme: {scheme}; }}"


def _rendered(boards: Sequence[Mapping[str, Any]], left_out: Sequence[str] = ()) -> str:
    from jinja2 import Environment, StrictUndefined

    folder = resources.files("roadscope.benchmarks.report") / "page_parts"
    names = ("page.html.jinja", "page.css", "page.js")
    template, style, script = ((folder / name).read_text("utf-8") for name in names)
    light, dark = _variables(PAGE_LIGHT, "light"), _variables(PAGE_DARK, "dark")
    colours = (
        f":root {light}\n"
        f':root[data-theme="dark"] {dark}\n'
        f'@media (prefers-color-scheme: dark) {{ :root:not([data-theme="light"]) {dark} }}\n'
    )
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    drawn = ("name", "headline", "columns", "entries", "breakdowns", "differences", "moments")
    content = [{key: board[key] for key in drawn} for board in boards]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return environment.from_string(template).render(
        boards=boards,
        first_columns=FIRST_COLUMNS,
        left_out=left_out,
        style=colours + style,
        script=script,
        script_digest=digest,
        # A less-than sign could end the script element that holds the text.
        content=_as_json(content),
    )


def _as_json(content: Any) -> str:
    text = json.dumps(msgspec.to_builtins(content), allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
