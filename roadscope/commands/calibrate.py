"""`roadscope calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from roadscope.commands.terminal import headline, progress_bars, show


def calibrate(
    rig: Annotated[
        str, typer.Option(help="Sensors with a camera: li2021, wide or a .toml file.")
    ] = "li2021",
    poses: Annotated[int, typer.Option(min=4, max=100, help="Poses of the board.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Of poses and noise.")] = 0,
    known_intrinsics: Annotated[
        bool, typer.Option("--known-intrinsics", help="Find the camera's pose alone.")
    ] = False,
    corners_only: Annotated[
        bool, typer.Option("--corners-only", help="The paper's way: from the corners alone.")
    ] = False,
    upright: Annotated[
        bool, typer.Option("--upright", help="The board stands; otherwise it is held at a tilt.")
    ] = False,
    scans: Annotated[int, typer.Option(min=1, max=1000, help="Scans of each pose.")] = 25,
    outliers: Annotated[
        float, typer.Option(min=0, max=0.5, help="Share of poses with a corner misread.")
    ] = 0.0,
    out: Annotated[
        Path | None, typer.Option(help="File for the calibration, .json or .toml.")
    ] = None,
) -> None:
    """Calibrate LiDAR and camera with a triangular board that both see (Li 2021).

    The file is what fusions believe with roadscope leaderboard fusion --calibration FILE.
    """
    from roadscope.benchmarks.calibrating import (
        calibrate_rig,
        calibration_path,
        enough,
        save_rig_calibration,
    )
    from roadscope.benchmarks.tables import pose_table

    place = None if out is None else calibration_path(out)
    with progress_bars() as progress:
        found = calibrate_rig(
            rig,
            poses=poses,
            seed=seed,
            known_intrinsics=known_intrinsics,
            corners_only=corners_only,
            upright=upright,
            scans=scans,
            outliers=outliers,
            progress=progress,
        )
    last = found.rows[-1]
    headline(f"{rig}: both sensors saw the whole board in {found.seen} of {found.asked} poses")
    show(
        f"places 8 to 30 m off {last.held_out_px:.2f} px off the truth, "
        f"{last.corners_px:.2f} px from corners alone"
    )
    show(f"camera's pose        {100 * last.position_m:.1f} cm and {last.rotation_deg:.2f} deg off")
    show(
        f"reprojection error   {last.reprojection_px:.2f} px of {found.result.inliers.sum()} "
        f"corners in scans, {(~found.result.inliers).sum()} left out: scans tell corners so "
        "badly\n"
    )
    show(pose_table(found.rows))
    show("Medians over choices of poses; worst: of them. Errors against the truth.", dim=True)
    show(f"From {enough(found.rows)} poses on the error stays within half more than with all.")
    if place is not None:
        origin = f"roadscope calibrate --rig {rig} --poses {poses} --seed {seed}"
        origin += " --known-intrinsics" * known_intrinsics + " --corners-only" * corners_only
        origin += " --upright" * upright + f" --outliers {outliers:g}" * bool(outliers)
        save_rig_calibration(found, place, origin + f" --scans {scans}" * (scans != 25))
        typer.echo(f"written: {place}")
