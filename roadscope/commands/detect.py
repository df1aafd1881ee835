"""`roadscope detect`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from roadscope.commands import completion
from roadscope.commands.options import Json, Layout, Quiet, Rate, Topics
from roadscope.commands.terminal import complain, headline, print_json, progress_bars, show

if TYPE_CHECKING:
    import numpy as np

    from roadscope.benchmarks.detection_runner import DetectedFrame, DetectionJob

HIGHEST_M = 5.0
"""No LiDAR on the road is higher above the ground. Chosen by hand."""

Folder = Annotated[
    Path,
    typer.Argument(
        metavar="DIR",
        help="Folder of scans (.bin, .pcd, .npy, .ply, .las or .laz), of images (.png, .jpg), or "
        "of KITTI with both, in the order of their names; or a bag of ROS 2: a folder of rosbag2, "
        "a file .mcap or .db3.",
    ),
]
DetectorSpec = Annotated[
    str,
    typer.Option(
        metavar="SPEC",
        help="A LiDAR detector, a camera detector, or fused?lidar=A&camera=B&fusion=C: names or "
        "file.py:Class; see: roadscope list. If left out, distance-l-shape for scans, network for "
        "images, fused for both with a calibration.",
        autocompletion=completion.detectors,
    ),
]
Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder for the results.")]
Pictures = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Folder for pictures: each scan from above and each image, with the boxes that have a "
        "score of 0.3 or more.",
    ),
]
Images = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Folder of the images, if they are not in DIR."),
]
Calibration = Annotated[
    Path | None,
    typer.Option(
        metavar="PATH",
        help="KITTI's calibration with P2 and the LiDAR: a file, or a folder with one for each "
        "scan. If left out, calib.txt or calib in DIR or beside it.",
    ),
]
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
    detector: DetectorSpec = "",
    out: Out = Path("detections"),
    pictures: Pictures = None,
    images: Images = None,
    calibration: Calibration = None,
    height: Height = None,
    lidar_mounting: LidarMounting = None,
    poses: Poses = None,
    rate_hz: Rate = 10.0,
    layout: Layout = "",
    topic: Topics = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Detect road users in a folder of scans, images or both.

    The results are a label file of KITTI for each scan (labels/NAME.txt) and one JSON file with
    all boxes (detections.json). Boxes in the JSON file are in the LiDAR's own axes. Label files are
    in the frame of the camera; without a calibration, it is taken to be at the LiDAR. After Ctrl-C
    the results so far are written, those of a fusion's LiDAR detector too. A scan that cannot be
    read counts as empty.
    """
    from roadscope.benchmarks.detection_files import ResultWriter
    from roadscope.benchmarks.detection_runner import RecordingOptions, detection_job
    from roadscope.benchmarks.detection_views import picture_folder, save_views
    from roadscope.benchmarks.formats.point_layout import parse_columns

    columns = parse_columns(layout) if layout else ()
    turn, height_m = _turn(lidar_mounting), _checked_height(height)
    options = RecordingOptions(
        detector,
        images,
        calibration,
        height_m,
        turn,
        poses,
        rate_hz=rate_hz,
        columns=columns,
        topics=tuple(topic or ()),
    )
    job = detection_job(folder, options)
    for note in job.notes:
        complain(note)
    writer = ResultWriter.open(out, job)
    views = None if pictures is None else picture_folder(pictures, job)
    found: dict[int, DetectedFrame] = {}
    with progress_bars(quiet=quiet) as progress:
        try:
            found.update(job.frames(progress))
        finally:
            frames = [found[row] for row in sorted(found)]
            about = _about(job)
            if frames:
                writer.write(frames, about)
            unfused = sum(not frame.fused for frame in frames)
            if unfused or 0 < len(frames) < len(job):
                alone = f", of the LiDAR alone in {unfused} of them" if unfused else ""
                complain(f"results of {len(frames)} of {len(job)} frames are kept in {out}{alone}")
        for row, frame in enumerate(frames if views is not None else ()):
            assert views is not None
            save_views(job, row, frame, views)
            progress("pictures", row + 1, len(frames))
    for note in job.losses():
        complain(note)
    if json:
        print_json({**about, "frames": len(frames), "detections": _counts(frames)})
    elif not quiet:
        _report(job, frames)
        typer.echo(f"written: {out}" if views is None else f"written: {out}, {views}")


def _turn(mounting: str | None) -> np.ndarray:
    """Return the (3, 3) rotation of the option --lidar-mounting."""
    import numpy as np

    from roadscope.benchmarks.formats.samples import parse_mounting

    return parse_mounting(mounting).rotation if mounting else np.eye(3)


def _checked_height(height_m: float | None) -> float | None:
    """Return the height of the option --height; refuse one that no LiDAR has."""
    from roadscope.benchmarks.formats.table import FormatError

    if height_m is not None and not 0 < height_m <= HIGHEST_M:
        raise FormatError(
            f"--height: expected metres above 0 and up to {HIGHEST_M:g}, got {height_m:g}"
        )
    return height_m


def _about(job: DetectionJob) -> dict[str, Any]:
    """Return what the JSON file says of a run before its frames."""
    specs = zip(job.detectors._fields, job.detectors, strict=True)
    content: dict[str, Any] = {
        "detectors": {name: str(spec) for name, spec in specs if spec is not None}
    }
    if job.scans is not None:
        content["lidar_height_m"] = float(job.ego_from_lidar.translation[2])
    if job.cameras is not None:
        content["calibration"] = str(job.cameras.path)
    return content


def _counts(frames: Sequence[DetectedFrame]) -> dict[str, int]:
    """Return how many detections there are of each category."""
    from roadscope.core import Category

    counts = Counter(c for each in frames for c in each.detections.categories.tolist())
    return {Category(c).name.lower(): count for c, count in sorted(counts.items())}


def _report(job: DetectionJob, frames: Sequence[DetectedFrame]) -> None:
    """Print how many detections there are."""
    counts, detectors = _counts(frames), " + ".join(str(each) for each in job.detectors if each)
    what = "images" if job.scans is None else "scans"
    headline(f"{detectors}: {sum(counts.values())} boxes in {len(frames)} {what}")
    if counts:
        show(", ".join(f"{name} {count}" for name, count in counts.items()))
