"""`roadscope run-odometry`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from roadscope.commands.terminal import complain, headline, progress_bars, show


def run_odometry(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Scans in order of name: .bin, .pcd or .npy.")
    ],
    odometry: Annotated[
        str, typer.Option(metavar="SPEC", help="Name or file.py:Class; roadscope list odometries.")
    ] = "voxel-map",
    out: Annotated[Path, typer.Option(help="File for the poses.")] = Path("poses.txt"),
    format: Annotated[str, typer.Option(help="kitti: 3 x 4 matrices; tum: with stamps.")] = "kitti",
    rate_hz: Annotated[
        float, typer.Option(help="Scans a second, where DIR has no times.txt.")
    ] = 10.0,
) -> None:
    """Tell from a folder of scans how the LiDAR moved.

    Poses are the LiDAR's in its first frame, x ahead, y left, z up. After Ctrl-C those that are
    known are kept.
    """
    from roadscope.benchmarks.followed import write_followed
    from roadscope.benchmarks.formats.scan_folder import ScanFolder

    scans = ScanFolder.find(folder, rate_hz=rate_hz)
    reasons: Counter[str] = Counter()
    done = 0
    try:
        with progress_bars() as progress:
            for told in write_followed(scans, odometry, out, format):
                done += 1
                reasons.update([told.reason] if told.reason else [])
                progress("scans", done, len(scans))
    except KeyboardInterrupt:
        complain(f"{done} of {len(scans)} poses are kept in {out}")
        raise
    pose = told.start_from_lidar
    x, y, z = pose.translation
    headline(f"{odometry}: {done} scans, from the first to the last {x:.2f} {y:.2f} {z:.2f} m")
    if reasons:
        show(f"degraded in {reasons.total()} scans, mostly: {reasons.most_common(1)[0][0]}")
    typer.echo(f"written: {out}")
