"""`roadscope calibrate`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roadscope.commands import completion, options
from roadscope.commands.options import flag, option
from roadscope.commands.terminal import headline, print_json, progress_bars, say, show

if TYPE_CHECKING:
    from roadscope.benchmarks.calibrating import RigCalibration

HOW = "How it is calibrated"


def calibrate(
    rig: str = option(
        "NAME",
        "A rig with a camera: li2021, wide or a .toml file",
        names=completion.rigs,
        default="li2021",
    ),
    poses: int = option("N", "Poses of the target, 4 to 100", min=4, max=100, default=20),
    seed: int = option("N", "Random seed of poses and noise", min=0, default=0),
    out: Path | None = option("FILE", "Write the calibration, .json or .toml"),
    known_intrinsics: bool = flag("--known-intrinsics", "Estimate only the camera's pose", HOW),
    corners_only: bool = flag("--corners-only", "Use corners alone, as the paper does", HOW),
    upright: bool = flag("--upright", "The target stands upright; else it is tilted", HOW),
    scans: int = option("N", "Scans of each pose, up to 1000", HOW, min=1, max=1000, default=25),
    outliers: float = option(
        "SHARE", "Share of poses with a misread corner, up to 0.5", HOW, min=0, max=0.5, default=0.0
    ),
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Calibrate LiDAR and camera with a triangular target that both see (Li 2021).

    Fusions get the calibration in FILE by roadscope leaderboard fusion --calibration FILE.
    """
    from roadscope.benchmarks.calibrating import (
        calibrate_rig,
        calibration_path,
        save_rig_calibration,
    )

    place = None if out is None else calibration_path(out)
    with progress_bars(quiet=quiet) as progress:
        calibration = calibrate_rig(
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
    if json:
        print_json(_content(calibration, rig))
    elif not quiet:
        _show(calibration, rig)
    if place is not None:
        origin = f"roadscope calibrate --rig {rig} --poses {poses} --seed {seed}"
        origin += " --known-intrinsics" * known_intrinsics + " --corners-only" * corners_only
        origin += " --upright" * upright + f" --outliers {outliers:g}" * bool(outliers)
        save_rig_calibration(calibration, place, origin + f" --scans {scans}" * (scans != 25))
        if not (json or quiet):
            say(f"written: {place}")


def _content(calibration: RigCalibration, rig: str) -> dict[str, Any]:
    """Return the calibration and its errors as JSON has them; an error without a bound is None."""
    from dataclasses import asdict

    from roadscope.benchmarks.calibrating import sufficient_poses

    projection = calibration.result.projection
    return {
        "rig": rig,
        "poses": calibration.poses,
        "usable_poses": calibration.usable_poses,
        "sufficient_poses": sufficient_poses(calibration.rows),
        "matrix": projection.matrix.tolist(),
        "width": projection.width,
        "height": projection.height,
        "rows": [
            {name: value if math.isfinite(value) else None for name, value in asdict(row).items()}
            for row in calibration.rows
        ],
    }


def _show(calibration: RigCalibration, rig: str) -> None:
    from roadscope.benchmarks.calibrating import sufficient_poses
    from roadscope.benchmarks.tables import pose_table

    last, inliers = calibration.rows[-1], calibration.result.inliers
    usable = f"{calibration.usable_poses} of {calibration.poses}"
    headline(f"{rig}: both sensors saw the whole target in {usable} poses")
    show(
        f"points 8 to 30 m away  {last.held_out_px:.2f} px off the truth, "
        f"{last.corners_px:.2f} px with corners alone"
    )
    show(f"camera's pose          {100 * last.position_m:.1f} cm, {last.rotation_deg:.2f} deg off")
    show(
        f"reprojection error     {last.reprojection_px:.2f} px over {inliers.sum()} corners in "
        f"scans, {(~inliers).sum()} left out: single returns locate a corner no better\n"
    )
    show(pose_table(calibration.rows))
    show("Medians over choices of poses, and the worst choice. Errors against the truth.", dim=True)
    show(
        f"From {sufficient_poses(calibration.rows)} poses on the error is at most 1.5 times that "
        "of all poses."
    )
