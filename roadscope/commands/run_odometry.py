"""`roadscope run-odometry`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadscope.commands import completion
from roadscope.commands.terminal import complain, headline, printable, progress_bars, show

if TYPE_CHECKING:
    from roadscope.benchmarks.formats.scan_folder import ScanFolder
    from roadscope.benchmarks.odometry_runner import RecordedImu, RecordedWheels, TruePoses
    from roadscope.core import Pose

NONE = "none"
USUAL = "lidar-inertial"
MANY = 0.2
"""Share of degraded scans from which on the poses are not to be trusted as they are."""

Folder = Annotated[
    Path, typer.Argument(metavar="DIR", help="Scans in order of name: .bin, .pcd or .npy.")
]
OdometrySpec = Annotated[
    str,
    typer.Option(
        metavar="SPEC",
        help="Name or file.py:Class; roadscope list odometries.",
        autocompletion=completion.odometries,
    ),
]
Out = Annotated[Path, typer.Option(help="File for the poses.")]
Format = Annotated[str, typer.Option(help="kitti: 3 x 4 matrices; tum: with stamps.")]
Rate = Annotated[float, typer.Option(help="Scans a second, where DIR has no times.txt.")]
Imu = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="Lines of stamp wx wy wz ax ay az, s, rad/s, m/s^2; imu.csv or imu.txt in DIR or "
        "beside it if not given; none: no IMU.",
    ),
]
Mounting = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z,ROLL,PITCH,YAW",
        help="Where the IMU sits in the LiDAR's frame, metres and degrees.",
    ),
]
WheelsFile = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="Lines of stamp and speed, s, m/s, for odometries that take them, "
        "lidar-inertial?wheels=true; wheels.csv or wheels.txt in DIR or beside it if not given; "
        "none: no wheels.",
    ),
]
TruthFile = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="True poses of the LiDAR, as KITTI or TUM, to compare."),
]


def run_odometry(
    folder: Folder,
    odometry: OdometrySpec = USUAL,
    out: Out = Path("poses.txt"),
    format: Format = "kitti",
    rate_hz: Rate = 10.0,
    imu: Imu = None,
    mounting: Mounting = None,
    wheels: WheelsFile = None,
    truth: TruthFile = None,
) -> None:
    """Estimate from a folder of scans how the LiDAR moved.

    Scans are stamped with the middle of their sweep, by times.txt in DIR or beside it, one number
    a line, seconds or milli-, micro- or nanoseconds. Poses are the LiDAR's in its first frame, x
    ahead, y left, z up. After Ctrl-C, or a scan that cannot be read, those that are known are kept.
    """
    from roadscope.benchmarks.formats.scan_folder import ScanFolder
    from roadscope.benchmarks.odometry_runner import TruePoses, write_estimates

    scans = ScanFolder.find(folder, rate_hz=rate_hz)
    inertial = _inertial(folder, scans, imu, mounting)
    true = TruePoses.read(truth, scans.stamps_s) if truth else None
    rolled = _wheels(folder, scans, wheels)
    found = [each.path for each in (inertial, rolled) if each is not None]
    _spare(out, truth, scans.times, *scans.files, *found)
    _tell_missing(scans, folder, without_imu=inertial is None and imu is None)
    _check_use(
        odometry,
        inertial,
        rolled,
        imu_named=bool(imu or mounting),
        wheels_named=wheels is not None,
    )
    reasons: Counter[str] = Counter()
    poses: list[Pose] = []
    try:
        with progress_bars() as progress:
            for estimate in write_estimates(
                scans, odometry, out, format, imu=inertial, wheels=rolled
            ):
                poses.append(estimate.start_from_lidar)
                reasons.update([estimate.reason] if estimate.reason else [])
                progress("scans", len(poses), len(scans))
    except BaseException:
        if poses:
            complain(f"{len(poses)} of {len(scans)} poses are kept in {out}")
        raise
    _tell(odometry, poses, reasons)
    if true is not None:
        _compare(poses, true, truth)
    typer.echo(f"written: {out}")


def _tell_missing(scans: ScanFolder, folder: Path, *, without_imu: bool) -> None:
    """Say what is taken for granted where the recording does not tell it."""
    from roadscope.benchmarks.formats.imu_file import NAMES
    from roadscope.benchmarks.formats.scan_folder import TIMES

    if scans.times is None:
        complain(f"no {TIMES}: scans are taken to be {scans.rate_hz:g} a second")
    if without_imu:
        complain(f"no IMU: {' or '.join(NAMES)} in or beside {folder}, or --imu FILE")
    if not next(iter(scans)).time_offset_s.any():
        complain(
            "points without times: each scan is taken to be seen at once, or to be deskewed already"
        )


def _spare(out: Path, *read: Path | None) -> None:
    """Refuse to write over what is read, or where nothing can be written."""
    from roadscope.benchmarks.formats.table import FormatError

    if not out.absolute().parent.is_dir() or out.is_dir():
        raise FormatError(f"{out}: cannot be written: --out names a file in a folder that is there")
    given = [each for each in read if each is not None]
    if out.exists() and any(each.samefile(out) for each in given if each.exists()):
        raise FormatError(f"{out} is read here: --out names another file for the poses")


def _tell(odometry: str, poses: Sequence[Pose], reasons: Counter[str]) -> None:
    """Say where the last scan was taken, and in how many the odometry was degraded."""
    x, y, z = poses[-1].translation
    headline(
        f"{odometry}: {len(poses)} scans, from the first to the last {x:.2f} {y:.2f} {z:.2f} m"
    )
    if reasons:
        share = reasons.total() / len(poses)
        show(
            f"degraded in {reasons.total()} of {len(poses)} scans, mostly: "
            f"{printable(reasons.most_common(1)[0][0])}"
        )
        if share > MANY:
            complain(
                "so many degraded scans: do not trust the poses before you have looked at them"
            )


def _compare(poses: Sequence[Pose], true: TruePoses, path: Path | None) -> None:
    """Say how far off the poses are, and what is odd about the true ones."""
    if true.look_like_a_cameras():
        complain(
            f"{path}: its z axis points ahead: expected poses of the LiDAR, x ahead, not of a "
            "camera, as KITTI's own are"
        )
    typer.echo(f"beside {path}: {true.errors_in_words(poses)}")


def _inertial(
    folder: Path, scans: ScanFolder, given: str | None, mounting: str | None
) -> RecordedImu | None:
    """Read the samples that are named or lie beside the scans."""
    import numpy as np

    from roadscope.benchmarks.formats.imu_file import NAMES, find_imu, parse_mounting, read_imu
    from roadscope.benchmarks.formats.table import FormatError
    from roadscope.benchmarks.odometry_runner import RecordedImu
    from roadscope.odometry.imu_buffer import GAP_S

    mounted = parse_mounting(mounting) if mounting else None
    path = find_imu(folder) if given is None else Path(given)
    if path is None or given == NONE:
        if mounted is not None:
            raise FormatError(
                f"a mounting is of an IMU: expected {' or '.join(NAMES)} in or "
                f"beside {folder}, or --imu FILE"
            )
        return None
    samples, left_out = read_imu(path)
    inertial = RecordedImu(samples, path, left_out, mounted)
    inertial.check_times(scans.stamps_s)
    step_s = float(np.median(np.diff(samples.stamps_s)))
    if step_s > GAP_S:
        complain(
            f"{path}: samples {step_s:.2g} s apart are too few: they are used where they are "
            f"{GAP_S:g} s apart at most"
        )
    return inertial


def _wheels(folder: Path, scans: ScanFolder, given: str | None) -> RecordedWheels | None:
    """Read the wheel speeds that are named or lie beside the scans."""
    from roadscope.benchmarks.formats.wheel_file import find_wheels, read_wheels
    from roadscope.benchmarks.odometry_runner import RecordedWheels

    path = find_wheels(folder) if given is None else Path(given)
    if path is None or given == NONE:
        return None
    samples, left_out = read_wheels(path)
    wheels = RecordedWheels(samples, path, left_out)
    wheels.check_times(scans.stamps_s)
    return wheels


def _check_use(
    odometry: str,
    inertial: RecordedImu | None,
    wheels: RecordedWheels | None,
    *,
    imu_named: bool,
    wheels_named: bool,
) -> None:
    """Say what is used beside the scans and what is not; what was named, and is not, is refused."""
    from roadscope.benchmarks.formats.table import FormatError
    from roadscope.benchmarks.isolation import open_plugin
    from roadscope.benchmarks.references import made_from_truth, pose_source

    source = pose_source(odometry)
    if made_from_truth(source):
        raise FormatError(f"{odometry} is made from truth: it stands on boards only")
    with open_plugin(source) as plugin:
        traits = plugin.traits
    kinds = (
        (inertial, traits.takes_imu, "an IMU; lidar-inertial does", imu_named),
        (
            wheels,
            traits.takes_wheels,
            "wheel speeds; lidar-inertial?wheels=true does",
            wheels_named,
        ),
    )
    for samples, taken, what, named in kinds:
        if samples is None:
            continue
        if not taken and named:
            raise FormatError(f"{odometry} has no use for {what}")
        complain(
            f"with {samples}"
            if taken
            else f"{samples.path} is not used: {odometry} has no use for {what}"
        )
