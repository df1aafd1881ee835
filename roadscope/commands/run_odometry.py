"""`roadscope run-odometry`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadscope.commands.terminal import complain, headline, progress_bars, show

if TYPE_CHECKING:
    from roadscope.benchmarks.followed import Inertial, Wheels
    from roadscope.benchmarks.formats.scan_folder import ScanFolder
    from roadscope.core import Pose

NONE = "none"
IMU_HELP = (
    "Lines of stamp wx wy wz ax ay az, s, rad/s, m/s^2; imu.csv or imu.txt in DIR or beside it if "
    "not given; none: no IMU."
)
WHEELS_HELP = (
    "Lines of stamp and speed, s, m/s, for odometries that take them, lidar-inertial?wheels=true; "
    "wheels.csv or wheels.txt in DIR or beside it if not given; none: no wheels."
)


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
    imu: Annotated[str | None, typer.Option(metavar="FILE", help=IMU_HELP)] = None,
    mounting: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z,ROLL,PITCH,YAW",
            help="Where the IMU sits in the LiDAR's frame, metres and degrees.",
        ),
    ] = None,
    wheels: Annotated[str | None, typer.Option(metavar="FILE", help=WHEELS_HELP)] = None,
    truth: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="True poses of the LiDAR, as KITTI or TUM, to compare."),
    ] = None,
) -> None:
    """Tell from a folder of scans how the LiDAR moved.

    Scans are stamped with the middle of their sweep, by times.txt in DIR or beside it, one number
    of seconds a line. Poses are the LiDAR's in its first frame, x ahead, y left, z up. After
    Ctrl-C those that are known are kept.
    """
    from roadscope.benchmarks.followed import Truth, compared, write_followed
    from roadscope.benchmarks.formats.scan_folder import ScanFolder

    scans = ScanFolder.find(folder, rate_hz=rate_hz)
    _spare(out, truth, imu, wheels)
    inertial = _inertial(folder, scans, imu, mounting)
    true = Truth.read(truth, scans.stamps_s) if truth else None
    rolled = _wheels(folder, scans, odometry, wheels)
    if inertial is not None:
        complain(f"with {len(inertial.samples.stamps_s)} inertial samples of {inertial.path}")
    if rolled is not None:
        complain(f"with {len(rolled.samples.stamps_s)} wheel speeds of {rolled.path}")
    reasons: Counter[str] = Counter()
    poses: list[Pose] = []
    try:
        with progress_bars() as progress:
            for told in write_followed(scans, odometry, out, format, inertial, rolled):
                poses.append(told.start_from_lidar)
                reasons.update([told.reason] if told.reason else [])
                progress("scans", len(poses), len(scans))
    except KeyboardInterrupt:
        complain(f"{len(poses)} of {len(scans)} poses are kept in {out}")
        raise
    _tell(odometry, poses, reasons)
    if true is not None:
        typer.echo(f"beside {truth}: {compared(poses, true)}")
    typer.echo(f"written: {out}")


def _spare(out: Path, *read: Path | str | None) -> None:
    """Refuse to write over what is read."""
    from roadscope.benchmarks.formats.table import FormatError

    given = [Path(each) for each in read if each is not None]
    if any(each.exists() and out.exists() and each.samefile(out) for each in given):
        raise FormatError(f"{out} is read here: --out names another file for the poses")


def _tell(odometry: str, poses: Sequence[Pose], reasons: Counter[str]) -> None:
    """Say where the last scan was taken, and in how many the odometry was degraded."""
    x, y, z = poses[-1].translation
    headline(
        f"{odometry}: {len(poses)} scans, from the first to the last {x:.2f} {y:.2f} {z:.2f} m"
    )
    if reasons:
        show(f"degraded in {reasons.total()} scans, mostly: {reasons.most_common(1)[0][0]}")


def _inertial(
    folder: Path, scans: ScanFolder, given: str | None, mounting: str | None
) -> Inertial | None:
    """Read the samples that are named or lie beside the scans."""
    from roadscope.benchmarks.followed import Inertial, check_times
    from roadscope.benchmarks.formats.imu_file import NAMES, find_imu, parse_mounting, read_imu
    from roadscope.benchmarks.formats.table import FormatError

    mounted = parse_mounting(mounting) if mounting else None
    path = find_imu(folder) if given is None else Path(given)
    if path is None or given == NONE:
        if mounted is not None:
            raise FormatError(f"a mounting is of an IMU: expected {' or '.join(NAMES)} in or "
                              f"beside {folder}, or --imu FILE")  # fmt: skip
        return None
    inertial = Inertial(read_imu(path), mounted, path)
    check_times(inertial, scans.stamps_s)
    return inertial


def _wheels(folder: Path, scans: ScanFolder, odometry: str, given: str | None) -> Wheels | None:
    """Read the wheel speeds that are named or lie beside the scans, if anybody takes them."""
    from roadscope.benchmarks.followed import Wheels, check_times
    from roadscope.benchmarks.formats.table import FormatError
    from roadscope.benchmarks.formats.wheel_file import find_wheels, read_wheels
    from roadscope.odometry import ODOMETRIES
    from roadscope.odometry.api import takes_wheels

    path = find_wheels(folder) if given is None else Path(given)
    if path is None or given == NONE:
        return None
    if not takes_wheels(ODOMETRIES.make(odometry)):
        if given is None:
            return None
        raise FormatError(f"{odometry} takes no wheel speeds; lidar-inertial?wheels=true does")
    wheels = Wheels(read_wheels(path), path)
    check_times(wheels, scans.stamps_s)
    return wheels
