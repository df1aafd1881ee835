"""`roadscope speed`."""

from __future__ import annotations

from pathlib import Path

from roadscope.commands import options
from roadscope.commands.options import argument, option
from roadscope.commands.terminal import print_json, progress_bars, say, show


def speed(
    parts: list[str] | None = argument(
        "PART...",
        "casting, detectors, trackers, odometry, camera, environments; else all",
        default=None,
    ),
    out: Path | None = option("DIR", "Write speed.json there"),
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Measure how long methods, sensors and environments take."""
    from dataclasses import asdict

    from roadscope.benchmarks.cache import usable_folder
    from roadscope.benchmarks.speed.measure import PARTS, measure_speed, write_speed
    from roadscope.benchmarks.tables import speed_table

    folder = None if out is None else usable_folder(out)
    with progress_bars(quiet=quiet) as progress:
        rows = measure_speed(
            parts or tuple(PARTS), progress=lambda _, done, of: progress("speed", done, of)
        )
    if folder is not None:
        write_speed(rows, folder / "speed.json")
    if json:
        print_json([asdict(row) for row in rows])
    elif not quiet:
        show(speed_table(rows))
        if folder is not None:
            say(f"written: {folder / 'speed.json'}")
