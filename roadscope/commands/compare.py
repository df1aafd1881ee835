"""`roadscope compare`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from roadscope.commands import completion, options
from roadscope.commands.options import OUTPUT, argument, flag, option
from roadscope.commands.terminal import complain, console, printable, say

if TYPE_CHECKING:
    from roadscope.benchmarks.compare import Comparison, Difference


def compare(
    a: Path = argument("A", "The earlier run: its folder or leaderboard.json"),
    b: Path | None = argument(
        "B", "The later run; with --entry, A if left out", show_default=False, default=None
    ),
    *,
    entry: list[str] | None = option(
        "NAME",
        "Compare two entries: give it twice, an entry of A, then one of B",
        names=completion.entries_of_runs,
    ),
    metric: list[str] | None = option(
        "NAME", "Only this metric, such as hota or 'f1 by range: 0-20' (can be repeated)"
    ),
    level: float = option(
        "SHARE",
        "Confidence of intervals; the false discovery rate is 1 - SHARE",
        min=0.5,
        max=0.999,
        default=0.95,
    ),
    times: bool = flag("--times", "Longer computing times are regressions too"),
    every: bool = flag("--all", "Show unchanged metrics too", OUTPUT),
    fail_on_regression: bool = flag(
        "--fail-on-regression", "Status 1 if a metric of B is worse, or a job failed in B alone"
    ),
    out: Path | None = options.JSON_FILE,
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Compare two runs, or two entries of one run, on the same seeds.

    Differences are those of the same episodes, with intervals over seeds. A metric is called
    better or worse after control of the false discovery rate over all metrics compared.

    Exit status: 1 if the two cannot be compared, or with --fail-on-regression if B is worse. An
    entry that B lacks is named, but is no regression.
    """
    from roadscope.benchmarks.cache import write_text
    from roadscope.benchmarks.compare import CompareError
    from roadscope.benchmarks.compare import compare as compare_runs

    if entry and len(entry) != 2:
        raise CompareError(
            f"give --entry twice: an entry of A, then one of B; got {', '.join(entry)}"
        )
    comparison = compare_runs(a, b, entries=entry or None, metrics=metric, level=level, times=times)
    if out is not None:
        write_text(out, comparison.to_json())
    if json:
        typer.echo(comparison.to_json(), nl=False)
    elif not quiet:
        _show(comparison, every)
        if out is not None:
            say(f"written: {out}")
    if fail_on_regression and comparison.regressed:
        _complain_of_regressions(comparison)
        raise typer.Exit(1)


def _show(comparison: Comparison, every: bool) -> None:
    from rich.text import Text

    screen = console()
    for letter, label in (("A", comparison.a), ("B", comparison.b)):
        screen.print(Text(f"{letter}: {printable(str(label))}"))
    if shown := comparison.differences if every else comparison.changed:
        screen.print(_table(shown, comparison.level))
    screen.print(_summary(comparison))
    for line in _remarks(comparison):
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


def _summary(comparison: Comparison) -> str:
    counts = Counter(d.verdict for d in comparison.differences)
    text = (
        f"Of {len(comparison.differences)} metrics {counts['better']} are better in B, "
        f"{counts['worse']} worse, {counts['same']} not shown to differ (false discovery rate "
        f"{100 * (1 - comparison.level):.2g} %)."
    )
    if counts["unknown"]:
        text += f" {counts['unknown']} have too few seeds to tell."
    if not comparison.times and any(
        d.timed and d.verdict == "worse" for d in comparison.differences
    ):
        text += " Times that are worse are no regression without --times."
    return text


def _remarks(comparison: Comparison) -> Iterator[str]:
    """Yield a line for each reason of failed jobs, and for what only A or only B has."""
    failed = {
        "failed in B alone": comparison.new_failures,
        "failed in A alone": [f for f in comparison.failures if not f.failed_in_b],
        "failed in both": [f for f in comparison.failures if f.failed_in_a and f.failed_in_b],
    }
    for label, group in failed.items():
        counts = Counter((f.entry, f.name.board, f.reason) for f in group)
        for (entry, board, reason), count in counts.items():
            yield f"{label}: {entry} ({board}) in {_jobs(count)}: {reason}"
    for each in comparison.unpaired:
        what = f"the metric {each.metric} in" if each.metric else "the results of"
        has = f"{each.side.upper()} alone has {what} {_jobs(each.jobs)}"
        yield f"not compared: {each.entry} ({each.board}): {has}"


def _complain_of_regressions(comparison: Comparison) -> None:
    for d in comparison.regressions:
        values = f"{_figure(d.a)} -> {_figure(d.b)}, {_interval(d)}"
        complain(f"regression: {d.entry} ({d.board}): {d.metric} {values}")
    failed = Counter((f.entry, f.name.board) for f in comparison.new_failures)
    for (entry, board), count in failed.items():
        complain(f"regression: {entry} ({board}) failed in {_jobs(count)}, not so in A")


def _jobs(count: int) -> str:
    return f"{count} job" if count == 1 else f"{count} jobs"
