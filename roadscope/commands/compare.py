"""`roadscope compare`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from roadscope.commands.terminal import complain, console

if TYPE_CHECKING:
    from roadscope.benchmarks.compare import Comparison, Difference


def compare(
    a: Annotated[
        Path, typer.Argument(help="A leaderboard.json or its folder: the one before.", metavar="A")
    ],
    b: Annotated[
        Path | None,
        typer.Argument(
            help="The one after; A again if left out, with --entries.",
            metavar="B",
            show_default=False,
        ),
    ] = None,
    *,
    entries: Annotated[
        tuple[str, str] | None,
        typer.Option(help="Compare an entry of A with another one of B, or of A without B."),
    ] = None,
    metric: Annotated[
        list[str] | None,
        typer.Option(
            help="Compare this metric, such as hota or 'f1 by range: 0-20'; all of whole episodes "
            "if left out. Can be given several times."
        ),
    ] = None,
    level: Annotated[
        float,
        typer.Option(min=0.5, max=0.999, help="Of the intervals; 1 - level may be false alarms."),
    ] = 0.95,
    times: Annotated[
        bool, typer.Option("--times", help="Times count as regressions like other metrics.")
    ] = False,
    every: Annotated[bool, typer.Option("--all", help="Show unchanged metrics too.")] = False,
    json: Annotated[Path | None, typer.Option(help="Write the comparison to this file.")] = None,
    fail_on_regression: Annotated[
        bool,
        typer.Option(
            "--fail-on-regression",
            help="End with status 1 if a metric of B is worse or if a job failed in B alone.",
        ),
    ] = False,
) -> None:
    """Compare two runs, or two entries of one run, on the same seeds.

    Differences are those of the same episodes, with intervals over seeds. What is called better
    or worse is so after control of the false discovery rate over all metrics compared.
    """
    from roadscope.benchmarks.compare import compare as compare_runs

    found = compare_runs(a, b, entries=entries, metrics=metric, level=level, times=times)
    _show(found, every)
    if json is not None:
        from roadscope.benchmarks.cache import write_atomically

        def write(path: Path) -> None:
            path.write_text(found.to_json(), encoding="utf-8")

        write_atomically(json, write)
        typer.echo(f"written: {json}")
    if fail_on_regression and found.regressed:
        _complain_of_regressions(found)
        raise typer.Exit(1)


def _show(found: Comparison, every: bool) -> None:
    from rich.text import Text

    screen = console()
    screen.print(Text(f"A: {found.a}\nB: {found.b}"))
    shown = found.differences if every else found.changed
    if shown:
        screen.print(_table(shown, found.level))
    screen.print(_summary(found))
    _show_failures(screen, found)
    for each in found.unpaired:
        what = f"the metric {each.metric} in" if each.metric else "the results of"
        screen.print(
            Text(
                f"not compared: {each.entry} ({each.board}): {each.side.upper()} alone has {what} "
                f"{_jobs(each.jobs)}"
            )
        )


def _table(differences: Sequence[Difference], level: float) -> Any:
    from rich.text import Text

    from roadscope.benchmarks.tables import plain_table

    table = plain_table()
    table.add_column("entry", overflow="fold")
    table.add_column("metric", overflow="fold")
    for heading in ("A", "B", f"B - A [{100 * level:g} %]"):
        table.add_column(heading, justify="right")
    table.add_column("B is")
    several = len({d.board for d in differences}) > 1
    styles = {"better": "green", "worse": "red", "same": "dim", "unknown": "dim"}
    for d in differences:
        name = f"{d.entry} ({d.board})" if several else d.entry
        unit = "" if d.unit == "1" else f", {d.unit}"
        table.add_row(
            Text(name),
            Text(d.metric + unit),
            _figure(d.a),
            _figure(d.b),
            f"{_figure(d.difference, sign=True)} \\[{_figure(d.low)}, {_figure(d.high)}]",
            Text(d.verdict, style=styles[d.verdict]),
        )
    return table


def _figure(value: float, *, sign: bool = False) -> str:
    """Return a value with three digits after the point, fewer where it is large."""
    if not math.isfinite(value):
        return "-"
    digits = 3 if abs(value) < 100 else 1
    if value and abs(value) < 0.001:
        return f"{value:{'+' * sign}.2g}"
    return f"{value:{'+' * sign}.{digits}f}"


def _summary(found: Comparison) -> str:
    counts = {
        verdict: sum(d.verdict == verdict for d in found.differences)
        for verdict in ("better", "worse", "same", "unknown")
    }
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


def _show_failures(screen: Any, found: Comparison) -> None:
    from rich.text import Text

    for label, group in (
        ("failed in B alone", found.new_failures),
        ("failed in A alone", [f for f in found.failures if not f.failed_in_b]),
        ("failed in both", [f for f in found.failures if f.failed_in_a and f.failed_in_b]),
    ):
        reasons: dict[tuple[str, str, str], int] = {}
        for f in group:
            key = f.entry, f.name.board, f.reason
            reasons[key] = reasons.get(key, 0) + 1
        for (entry, board, reason), count in reasons.items():
            screen.print(Text(f"{label}: {entry} ({board}) in {_jobs(count)}: {reason}"))


def _complain_of_regressions(found: Comparison) -> None:
    for d in found.regressions:
        complain(
            f"regression: {d.entry} ({d.board}): {d.metric} {_figure(d.a)} -> {_figure(d.b)}, "
            f"{_figure(d.difference, sign=True)} [{_figure(d.low)}, {_figure(d.high)}]"
        )
    failed: dict[tuple[str, str], int] = {}
    for f in found.new_failures:
        failed[f.entry, f.name.board] = failed.get((f.entry, f.name.board), 0) + 1
    for (entry, board), count in failed.items():
        complain(f"regression: {entry} ({board}) failed in {_jobs(count)}, not so in A")


def _jobs(count: int) -> str:
    return f"{count} job" if count == 1 else f"{count} jobs"
