"""`roadscope run-odometry`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from roadscope.commands import completion, options
from roadscope.commands.options import RECORDED, argument, option
from roadscope.commands.terminal import (
    complain,
    headline,
    print_json,
    printable,
    progress_bars,
    say,
    show,
)

if TYPE_CHECKING:
    from roadscope.benchmarks.formats.scan_folder import ScanFolder
    from roadscope.benchmarks.odometry_runner import RecordedImu, RecordedWheels
    from roadscope.core import Pose

NONE = "none"
"""Value of --imu and --wheels that stands for no file."""
DEFAULT_ODOMETRY = "lidar-inertial"
MANY_DEGRADED = 0.2
"""Share of degraded scans above which a warning is printed."""


def run_odometry(
    folder: Path = argument(
        "DIR",
        "Scans (.bin, .pcd, .npy, .ply, .las, .laz) in the order of their names, or a bag of ROS 2",
    ),
    odometry: str = option(
        "SPEC",
        "See roadscope list odometries, or file.py:Class",
        names=completion.odometries,
        default=DEFAULT_ODOMETRY,
    ),
    out: Path = option("FILE", "File for the poses", default=Path("poses.txt")),
    format: str = option(
        "NAME", "Format of poses: kitti (3 x 4 matrices) or tum (with stamps)", default="kitti"
    ),
    truth: Path | None = option("FILE", "Compare with true poses of the LiDAR, KITTI or TUM"),
    imu: str | None = option(
        "FILE", "Lines of stamp wx wy wz ax ay az, s, rad/s, m/s^2; none: no IMU"
    ),
    mounting: str | None = option(
        "POSE",
        "Pose of the IMU in the LiDAR's frame: x,y,z,roll,pitch,yaw, metres, degrees",
        RECORDED,
    ),
    wheels: str | None = option(
        "FILE",
        "Lines of stamp and speed, for lidar-inertial?wheels=true; none: no wheels",
        RECORDED,
    ),
    lidar_mounting: str | None = options.LIDAR_MOUNTING,
    rate_hz: float | None = options.RATE,
    layout: str = options.LAYOUT,
    topic: list[str] | None = options.TOPICS,
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Estimate the poses of a LiDAR from a folder of its scans.

    times.txt has the stamp of the middle of each sweep, one a line, in s, ms, us or ns. It,
    imu.csv or .txt, and wheels.csv or .txt are looked for in DIR and beside it. Poses are those of
    the LiDAR in its first frame and its own axes. Poses so far stay in the file after Ctrl-C. A
    scan that cannot be read counts as empty.
    """
    from roadscope.benchmarks.formats.point_layout import parse_columns
    from roadscope.benchmarks.odometry_runner import (
        TruePoses,
        find_scans,
        folder_estimates,
        write_estimates,
    )

    columns = parse_columns(layout) if layout else ()
    topics = tuple(topic or ())
    scans = find_scans(folder, rate_hz=rate_hz, columns=columns, topics=topics)
    inertial = _inertial(folder, scans, imu, mounting, topics)
    place = scans.place
    true = TruePoses.read(truth, scans.stamps_s).of_lidar(truth, place) if truth else None
    wheel_speeds = _wheels(folder, scans, wheels)
    inputs = [each.path for each in (inertial, wheel_speeds) if each is not None]
    _check_out(out, truth, scans.times_file, *scans.inputs, *inputs)
    _check_use(
        odometry,
        inertial,
        wheel_speeds,
        imu_named=bool(imu or mounting),
        wheels_named=wheels is not None,
    )
    for note in scans.notes:
        complain(note)
    _report_doubts(scans, inertial, wheel_speeds)
    turn = _turn(scans, lidar_mounting)
    reasons: Counter[str] = Counter()
    poses: list[Pose] = []
    try:
        with progress_bars(quiet=quiet) as progress:
            estimates = folder_estimates(
                scans, odometry, imu=inertial, wheels=wheel_speeds, ahead_from_lidar=turn
            )
            for estimate in write_estimates(estimates, out, format):
                poses.append(estimate.start_from_lidar)
                reasons.update([estimate.reason] if estimate.reason else [])
                progress("scans", len(poses), len(scans))
    except BaseException:
        if poses:
            complain(f"{len(poses)} of {len(scans)} poses are kept in {out}")
        raise
    errors = None if true is None else true.errors(poses)
    if json:
        print_json(
            {
                "odometry": odometry,
                "scans": len(poses),
                "last_position_m": poses[-1].translation.tolist(),
                "degraded": dict(reasons),
                "errors": None if errors is None else errors._asdict(),
            }
        )
    elif not quiet:
        _report_poses(odometry, poses, reasons)
    for note in scans.losses.notes():
        complain(note)
    if reasons.total() > MANY_DEGRADED * len(poses):
        complain("many scans are degraded: check the poses before you use them")
    if not (json or quiet):
        if errors is not None:
            say(f"compared with {truth}: {errors}")
        say(f"written: {out}")


def _report_doubts(
    scans: ScanFolder, inertial: RecordedImu | None, wheels: RecordedWheels | None
) -> None:
    """Print how IMU and wheels contradict the scans."""
    from roadscope.benchmarks.imu_check import doubt_of_imu, doubt_of_wheels

    if inertial is not None and (doubt := doubt_of_imu(scans, inertial)):
        complain(f"{inertial.path}: {doubt}")
    if wheels is not None and (doubt := doubt_of_wheels(scans, wheels)):
        complain(f"{wheels.path}: {doubt}")


def _turn(scans: ScanFolder, mounting: str | None) -> Pose | None:
    """Return the rotation that brings the LiDAR's axes to x ahead; None if they are so.

    mounting: text of the option --lidar-mounting, which scans may contradict; without it, they show
        the direction of travel.
    """
    import numpy as np

    from roadscope.benchmarks.formats.samples import parse_mounting
    from roadscope.benchmarks.odometry_runner import TurnedScans
    from roadscope.core import Pose
    from roadscope.odometry.travel import AGREEMENT_RAD, direction_of_travel

    if mounting is not None:
        rotation = parse_mounting(mounting).rotation
        azimuth = direction_of_travel(TurnedScans(scans, rotation))
        if azimuth is not None and abs(azimuth) >= AGREEMENT_RAD:
            complain(
                f"by its scans the LiDAR drives to {np.rad2deg(azimuth):.0f} degrees from the x "
                "axis of the vehicle: is --lidar-mounting right?"
            )
        return Pose.from_parts(rotation, np.zeros(3))
    azimuth = direction_of_travel(scans)
    if azimuth is None:
        complain(
            "scans do not show where the LiDAR drives to: its x axis is taken to point ahead, "
            "--lidar-mounting says otherwise"
        )
    if azimuth is None or abs(azimuth) < AGREEMENT_RAD:
        return None
    degrees = round(np.rad2deg(azimuth))
    complain(
        f"the LiDAR drives to {degrees} degrees from its x axis: scans are turned by that "
        f"(--lidar-mounting 0,0,0,0,0,{-degrees})"
    )
    return Pose.from_euler(0, 0, 0, yaw=-azimuth)


def _check_out(out: Path, *inputs: Path | None) -> None:
    """Refuse to overwrite an input, or a path that cannot be written."""
    from roadscope.benchmarks.formats.table import FormatError

    if not out.absolute().parent.is_dir() or out.is_dir():
        raise FormatError(f"{out}: cannot be written: --out needs a file in an existing folder")
    existing = [each for each in inputs if each is not None and each.exists()]
    if out.exists() and any(each.samefile(out) for each in existing):
        raise FormatError(
            f"{out} is an input of this run: name another file for the poses, --out FILE"
        )


def _report_poses(odometry: str, poses: Sequence[Pose], reasons: Counter[str]) -> None:
    """Print the last position, and in how many scans the odometry was degraded."""
    x, y, z = poses[-1].translation
    headline(
        f"{odometry}: {len(poses)} scan{'s' * (len(poses) != 1)}, from the first to the last "
        f"{x:.2f} {y:.2f} {z:.2f} m"
    )
    if reasons:
        show(
            f"degraded in {reasons.total()} of {len(poses)} scans, mostly: "
            f"{printable(reasons.most_common(1)[0][0])}"
        )


def _inertial(
    folder: Path, scans: ScanFolder, file: str | None, mounting: str | None, topics: Sequence[str]
) -> RecordedImu | None:
    """Read the IMU samples of a file, or of one in or beside the folder; None if there are none.

    Samples too far apart are used only where the user names them or their mounting.

    file: of the option --imu. mounting: text of the option --mounting. topics: see `read_bag_imu`.
    """
    import numpy as np

    from roadscope.benchmarks.formats import samples as files
    from roadscope.benchmarks.formats.table import FormatError
    from roadscope.benchmarks.odometry_runner import RecordedImu
    from roadscope.odometry.imu_buffer import GAP_S

    mounted = files.parse_mounting(mounting) if mounting else None
    path = files.find_imu(folder) if file is None else Path(file)
    of_bag = None
    if path is None and scans.bag is not None:
        of_bag = files.read_bag_imu(scans.bag, topics)
        path = None if of_bag is None else scans.bag.path
    if path is None or file == NONE:
        if mounted is not None:
            raise FormatError(
                f"a mounting is of an IMU: expected {' or '.join(files.IMU_FILES)} in or "
                f"beside {folder}, or --imu FILE"
            )
        if file is None:
            complain(f"no IMU: {' or '.join(files.IMU_FILES)} in or beside {folder}, or --imu FILE")
        return None
    samples, left_out = of_bag or files.read_imu(path)
    inertial = RecordedImu(samples, path, left_out, mounted or files.mounting_of(path))
    inertial.check_times(scans.stamps_s)
    step_s = float(np.median(np.diff(samples.stamps_s)))
    if step_s <= GAP_S:
        return inertial
    is_named = bool(file or mounting)
    use = f"used where they are {GAP_S:g} s apart at most" if is_named else "not used"
    complain(f"{path}: samples {step_s:.2g} s apart are too few: they are {use}")
    return inertial if is_named else None


def _wheels(folder: Path, scans: ScanFolder, file: str | None) -> RecordedWheels | None:
    """Read the wheel speeds of a file, or of one in or beside the folder; None if there are none.

    file: of the option --wheels.
    """
    from roadscope.benchmarks.formats.samples import find_wheels, read_wheels
    from roadscope.benchmarks.odometry_runner import RecordedWheels

    path = find_wheels(folder) if file is None else Path(file)
    if path is None or file == NONE:
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
    """Print which of IMU and wheels is used; refuse a file that was named and is not used."""
    from roadscope.benchmarks.formats.table import FormatError
    from roadscope.benchmarks.isolation import open_plugin
    from roadscope.benchmarks.references import made_from_truth, pose_source

    source = pose_source(odometry)
    if made_from_truth(source):
        raise FormatError(f"{odometry} is made from the truth: it can run only on boards")
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
