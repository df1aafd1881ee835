"""`roadscope export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from roadscope.commands.terminal import progress_bars

NONE = "none"
MEGABYTE, GIGABYTE = 1e6, 1e9


def export(
    suite: Annotated[
        str, typer.Argument(help="A name (roadscope list suites) or a .toml file.", metavar="SUITE")
    ],
    folder: Annotated[
        Path, typer.Argument(help="New folder, or one to go on with.", metavar="DIR")
    ],
    *,
    seeds: Annotated[
        int | None, typer.Option(min=1, help="So many of the suite's seeds, the first.")
    ] = None,
    scenarios: Annotated[
        list[str] | None,
        typer.Option("--scenario", help="This scenario of it; can be given several times."),
    ] = None,
    with_truth: Annotated[
        bool, typer.Option("--with-truth", help="Write the truth of test seeds too.")
    ] = False,
    detections: Annotated[
        list[str] | None,
        typer.Option(
            help="Write these detections too, in place of those that the suite's trackers get; "
            "none: no detections. Can be given several times."
        ),
    ] = None,
) -> None:
    """Write a suite's scans, images, calibration and truth in KITTI's layout.

    What an earlier run has written is left as it is: a run that was stopped goes on.

    README.md in the folder says what each file is, and how results are scored: roadscope submit.
    """
    from roadscope.benchmarks.export_suite import export_suite, plan_export

    wanted = [d for d in detections if d != NONE] if detections else None
    plan = plan_export(
        suite,
        folder,
        seeds=seeds,
        scenarios=scenarios,
        with_truth=with_truth,
        detections=wanted,
    )
    count = len(plan.manifest.sequences)
    typer.echo(
        f"{plan.suite.title}: {count} sequences with {plan.scans} scans, at most "
        f"{_size(plan.bytes_at_most)} in {folder}"
        + (f"; {plan.done} sequences are there already" if plan.done else "")
    )
    with progress_bars() as progress:
        export_suite(plan, progress=progress)
    typer.echo(f"written: {folder / 'README.md'}")


def _size(count: int) -> str:
    if count < GIGABYTE:
        return f"{count / MEGABYTE:.0f} MB"
    return f"{count / GIGABYTE:.1f} GB"
