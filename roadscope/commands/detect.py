"""`roadscope detect`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadscope.commands import completion
from roadscope.commands.options import Json, Layout, Quiet, Rate
from roadscope.commands.terminal import complain, headline, print_json, progress_bars, show

if TYPE_CHECKING:
    from roadscope.benchmarks.detection_runner import DetectedFrame
    from roadscope.benchmarks.formats.scan_folder import ScanFolder
    from roadscope.core import Pose

DEFAULT_DETECTOR = "distance-l-shape"

Folder = Annotated[
    Path,
    typer.Argument(
        metavar="DIR", help="Folder of scans, in the order of their names: .bin, .pcd or .npy."
    ),
]
DetectorSpec = Annotated[
    str,
    typer.Option(
        metavar="SPEC",
        help="The detector: a name or file.py:Class; see: roadscope list detectors.",
        autocompletion=completion.detectors,
    ),
]
Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder for the results.")]
Height = Annotated[
    float | None,
    typer.Option(
        metavar="METRES",
        help="Height of the LiDAR above the ground. If left out, scans show it.",
    ),
]
LidarMounting = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z,ROLL,PITCH,YAW",
        help="Mounting pose of the LiDAR in the vehicle's frame, x ahead, y left, z up; only the "
        "angles count. If left out, x is taken to point ahead and z up.",
    ),
]
Poses = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Poses of the LiDAR, as run-odometry writes them, for detectors of what moves, such "
        "as long-range. Without it, the LiDAR is taken to stand.",
    ),
]


def detect(
    folder: Folder,
    detector: DetectorSpec = DEFAULT_DETECTOR,
    out: Out = Path("detections"),
    height: Height = None,
    lidar_mounting: LidarMounting = None,
    poses: Poses = None,
    rate_hz: Rate = 10.0,
    layout: Layout = "",
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Detect road users in a folder of scans.

    The results are a label file of KITTI for each scan (labels/NAME.txt) and one JSON file with
    all boxes (detections.json). Boxes in the JSON file are in the LiDAR's own axes. After Ctrl-C
    the results so far are written. A scan that cannot be read counts as empty.
    """
    from roadscope.benchmarks.detection_runner import (
        DetectedFrame,
        ResultWriter,
        detector_of,
        scan_detections,
    )
    from roadscope.benchmarks.formats.point_layout import parse_columns
    from roadscope.benchmarks.formats.scan_folder import ScanFolder
    from roadscope.benchmarks.odometry_runner import TruePoses
    from roadscope.core import Detections
    from roadscope.core.fused import FusedDetections

    spec = detector_of(detector)
    columns = parse_columns(layout) if layout else ()
    scans = ScanFolder.find(folder, rate_hz=rate_hz, columns=columns)
    for note in scans.notes:
        complain(note)
    ego_from_lidar = _mounting(scans, height, lidar_mounting)
    moved = TruePoses.read(poses, scans.stamps_s).poses if poses else ()
    writer = ResultWriter.open(out, scans.names, ego_from_lidar)
    found: dict[int, Detections] = {}
    try:
        with progress_bars(quiet=quiet) as progress:
            for row, detections in scan_detections(scans, spec, ego_from_lidar, poses=moved):
                found[row] = detections
                progress("scans", len(found), len(scans))
    finally:
        frames = [
            DetectedFrame(
                scans.names[row],
                scans.stamps_s[row],
                FusedDetections.of(each, None),
                str(scans.losses.scans.get(scans.files[row], "")),
            )
            for row, each in sorted(found.items())
        ]
        if frames:
            about = {
                "detector": detector,
                "lidar_height_m": float(ego_from_lidar.translation[2]),
            }
            writer.write(frames, about)
        if 0 < len(frames) < len(scans):
            complain(f"results of {len(frames)} of {len(scans)} scans are kept in {out}")
    for note in scans.losses.notes():
        complain(note)
    if json:
        print_json({**about, "scans": len(frames), "detections": _counts(frames)})
    elif not quiet:
        _report(detector, frames)
        typer.echo(f"written: {out}")


def _mounting(scans: ScanFolder, height_m: float | None, mounting: str | None) -> Pose:
    """Return `ego_from_lidar`, the ego on the ground below the LiDAR, and say how high it is."""
    import numpy as np

    from roadscope.benchmarks.detection_runner import height_above_ground
    from roadscope.benchmarks.formats.samples import parse_mounting
    from roadscope.benchmarks.formats.table import FormatError
    from roadscope.core import Pose

    rotation = parse_mounting(mounting).rotation if mounting else np.eye(3)
    if height_m is not None and not 0 < height_m < np.inf:
        raise FormatError(f"--height: expected metres above 0, got {height_m:g}")
    measured = height_above_ground(scans, rotation) if height_m is None else height_m
    if measured is None:
        raise FormatError(
            "the scans show no ground below the LiDAR: name its height, --height METRES, and if "
            "its z axis does not point up, --lidar-mounting"
        )
    source = "by the ground in the scans" if height_m is None else "as named"
    complain(f"the LiDAR is {measured:.2f} m above the ground, {source}")
    return Pose.from_parts(rotation, np.array([0.0, 0.0, measured]))


def _counts(frames: Sequence[DetectedFrame]) -> dict[str, int]:
    """Return how many detections there are of each category."""
    from roadscope.core import Category

    counts = Counter(c for each in frames for c in each.detections.categories.tolist())
    return {Category(c).name.lower(): count for c, count in sorted(counts.items())}


def _report(detector: str, frames: Sequence[DetectedFrame]) -> None:
    """Print how many detections there are."""
    counts = _counts(frames)
    headline(f"{detector}: {sum(counts.values())} boxes in {len(frames)} scans")
    if counts:
        show(", ".join(f"{name} {count}" for name, count in counts.items()))
