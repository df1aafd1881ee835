"""`roadscope export`."""

from __future__ import annotations

from pathlib import Path

from roadscope.commands import completion, options
from roadscope.commands.options import argument, flag, option
from roadscope.commands.terminal import print_json, printable, progress_bars, say

NONE = "none"
"""Detector that stands for no detections."""


def export(
    suite: str = argument(
        "SUITE", "See roadscope list suites, or a .toml file", names=completion.suites
    ),
    folder: Path = argument("DIR", "A new folder, or one of a stopped run, which continues"),
    *,
    seeds: int | None = option("N", "Export only the first N seeds", min=1),
    scenarios: list[str] | None = option(
        "NAME",
        "Export only this scenario (can be repeated)",
        name="--scenario",
        names=completion.scenarios,
    ),
    with_truth: bool = flag("--with-truth", "Write the truth of test seeds too"),
    detections: list[str] | None = option(
        "SPEC",
        "Write this detector's detections, not those of the suite (can be repeated); none: "
        "none at all",
        names=completion.detectors,
    ),
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Write a suite's scans, images, calibration and truth in KITTI's layout.

    README.md in the folder says what each file is, and how results are scored: roadscope submit.

    Exit status: 1 if the folder holds other files or cannot be written.
    """
    import msgspec

    from roadscope.benchmarks.cached_files import size_text
    from roadscope.benchmarks.suite_exports import export_suite, plan_export, read_manifest

    detectors = [d for d in detections if d != NONE] if detections else None
    plan = plan_export(
        suite, folder, seeds=seeds, scenarios=scenarios, with_truth=with_truth, detections=detectors
    )
    if not (json or quiet):
        sequences = len(plan.manifest.sequences)
        done = f"; already there: {plan.done}" if plan.done else ""
        say(
            f"{printable(plan.suite.title)}: {sequences} sequence{'s' * (sequences != 1)} with at "
            f"most {plan.scans} scans and {size_text(plan.bytes_at_most)}, in {folder}{done}"
        )
    with progress_bars(quiet=quiet) as progress:
        export_suite(plan, progress=progress)
    if json:
        print_json({"folder": str(folder), **msgspec.to_builtins(read_manifest(folder))})
    elif not quiet:
        say(f"written: {folder / 'README.md'}")
