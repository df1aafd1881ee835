"""`roadscope compare`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from roadscope.commands.options import Json, JsonFile, Quiet
from roadscope.commands.terminal import complain, console, printable

if TYPE_CHECKING:
    from roadscope.benchmarks.compare import Comparison, Difference


A = Annotated[
    Path, typer.Argument(help="A leaderboard.json or its folder: the one before.", metavar="A")
]
B = Annotated[
    Path | None,
    typer.Argument(
        help="The one after; A again if left out, with --entries.", metavar="B", show_default=False
    ),
]
Entries = Annotated[
    tuple[str, str] | None,
    typer.Option(help="Compare an entry of A with another one of B, or of A without B."),
]
Metrics = Annotated[
    list[str] | None,
    typer.Option(
        help="Compare this metric, such as hota or 'f1 by range: 0-20'; all of whole episodes "
        "if left out. Can be given several times."
    ),
]
Level = Annotated[
    float,
    typer.Option(
        min=0.5,
        max=0.999,
        help="Confidence level of the intervals; the false discovery rate is 1 - level.",
    ),
]
Times = Annotated[
    bool, typer.Option("--times", help="Times count as regressions like other metrics.")
]
Every = Annotated[bool, typer.Option("--all", help="Show unchanged metrics too.")]
FailOnRegression = Annotated[
    bool,
    typer.Option(
        "--fail-on-regression",
        help="End with status 1 if a metric of B is worse or if a job failed in B alone.",
    ),
]


def compare(
    a: A,
    b: B = None,
    *,
    entries: Entries = None,
    metric: Metrics = None,
    level: Level = 0.95,
    times: Times = False,
    every: Every = False,
    fail_on_regression: FailOnRegression = False,
    out: JsonFile = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compare two runs, or two entries of one run, on the same seeds.

    Differences are those of the same episodes, with intervals over seeds. A metric is called
    better or worse after control of the false discovery rate over all metrics compared.

    Exit status: 1 if the two cannot be compared, or with --fail-on-regression if B is worse.
    """
    from roadscope.benchmarks.cache import write_text
    from roadscope.benchmarks.compare import compare as compare_runs

    found = compare_runs(a, b, entries=entries, metrics=metric, level=level, times=times)
    if out is not None:
        write_text(out, found.to_json())
    if json:
        typer.echo(found.to_json(), nl=False)
    elif not quiet:
        _show(found, every)
        if out is not None:
            typer.echo(f"written: {out}")
    if fail_on_regression and found.regressed:
        _complain_of_regressions(found)
        raise typer.Exit(1)


def _show(found: Comparison, every: bool) -> None:
    from rich.text import Text

    screen = console()
    for letter, label in (("A", found.a), ("B", found.b)):
        screen.print(Text(f"{letter}: {printable(str(label))}"))
    if shown := found.differences if every else found.changed:
        screen.print(_table(shown, found.level))
    screen.print(_summary(found))
    for line in _remarks(found):
        screen.print(Text(printable(line)))


def _table(differences: Sequence[Difference], level: float) -> Any:
    from rich.text import Text

    from roadscope.benchmarks.tables import plain_table

    table = plain_table()
    table.add_column("entry", overflow="fold")
    table.add_column("metric", overflow="fold")
    for heading in ("A", "B", f"B - A [{100 * level:g} %]"):
        table.add_column(Text(heading), justify="right")
    table.add_column("B is")
    several = len({d.board for d in differences}) > 1
    styles = {"better": "green", "worse": "red", "same": "dim", "unknown": "dim"}
    for d in differences:
        name = f"{d.entry} ({d.board})" if several else d.entry
        unit = "" if d.unit == "1" else f", {d.unit}"
        cells = (name, d.metric + unit, _figure(d.a), _figure(d.b), _interval(d))
        table.add_row(
            *(Text(printable(cell)) for cell in cells), Text(d.verdict, style=styles[d.verdict])
        )
    return table


def _figure(value: float, sign: str = "") -> str:
    """Return a value with three digits after the point, fewer where it is large."""
    if not math.isfinite(value):
        return "-"
    if value and abs(value) < 0.001:
        return f"{value:{sign}.2g}"
    return f"{value:{sign}.{3 if abs(value) < 100 else 1}f}"


def _interval(d: Difference) -> str:
    return f"{_figure(d.difference, '+')} [{_figure(d.low)}, {_figure(d.high)}]"


def _summary(found: Comparison) -> str:
    counts = Counter(d.verdict for d in found.differences)
    text = (
        f"Of {len(found.differences)} metrics {counts['better']} are better in B, "
        f"{counts['worse']} worse, {counts['same']} not shown to differ (false discovery rate "
        f"{100 * (1 - found.level):.2g} %)."
    )
    if counts["unknown"]:
        text += f" {counts['unknown']} have too few seeds to tell."
    if not found.times and any(d.timed and d.verdict == "worse" for d in found.differences):
        text += " Times that are worse are no regression without --times."
    return text


def _remarks(found: Comparison) -> Iterator[str]:
    """Yield a line for each reason of failed jobs, and for what only A or only B has."""
    failed = {
        "failed in B alone": found.new_failures,
        "failed in A alone": [f for f in found.failures if not f.failed_in_b],
        "failed in both": [f for f in found.failures if f.failed_in_a and f.failed_in_b],
    }
    for label, group in failed.items():
        counts = Counter((f.entry, f.name.board, f.reason) for f in group)
        for (entry, board, reason), count in counts.items():
            yield f"{label}: {entry} ({board}) in {_jobs(count)}: {reason}"
    for each in found.unpaired:
        what = f"the metric {each.metric} in" if each.metric else "the results of"
        has = f"{each.side.upper()} alone has {what} {_jobs(each.jobs)}"
        yield f"not compared: {each.entry} ({each.board}): {has}"


def _complain_of_regressions(found: Comparison) -> None:
    for d in found.regressions:
        values = f"{_figure(d.a)} -> {_figure(d.b)}, {_interval(d)}"
        complain(f"regression: {d.entry} ({d.board}): {d.metric} {values}")
    failed = Counter((f.entry, f.name.board) for f in found.new_failures)
    for (entry, board), count in failed.items():
        complain(f"regression: {entry} ({board}) failed in {_jobs(count)}, not so in A")


def _jobs(count: int) -> str:
    return f"{count} job" if count == 1 else f"{count} jobs"
