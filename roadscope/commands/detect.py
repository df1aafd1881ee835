"""`roadscope detect`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roadscope.commands import completion, options
from roadscope.commands.options import RECORDED, argument, option
from roadscope.commands.terminal import complain, headline, print_json, progress_bars, say, show

if TYPE_CHECKING:
    import numpy as np

    from roadscope.benchmarks.detection_runner import DetectedFrame, DetectionJob

HIGHEST_M = 5.0
"""No LiDAR on the road is higher above the ground. Chosen by hand."""


def detect(
    folder: Path = argument(
        "DIR",
        "Scans (.bin, .pcd, .npy, .ply, .las, .laz), images (.png, .jpg) or both as KITTI has "
        "them; or a bag of ROS 2",
    ),
    detector: str = option(
        "SPEC",
        "NAME, file.py:Class or fused?lidar=A&camera=B&fusion=C; if left out, "
        "distance-l-shape, network or both fused",
        names=completion.detectors,
        default="",
    ),
    out: Path = option("DIR", "Folder for the results", default=Path("detections")),
    pictures: Path | None = option("DIR", "Draw scans and images with boxes scored 0.3 or more"),
    height: float | None = option(
        "M", "Height of the LiDAR above the ground; if left out, estimated from scans"
    ),
    calibration: Path | None = option(
        "PATH",
        "KITTI calibration, file or folder; if left out, calib.txt or calib in DIR or beside it",
    ),
    images: Path | None = option("DIR", "The images, if they are not in DIR", RECORDED),
    poses: Path | None = option(
        "FILE",
        "Poses by run-odometry, for long-range and zhang2017; else the LiDAR stands still",
        RECORDED,
    ),
    lidar_mounting: str | None = options.LIDAR_MOUNTING,
    rate_hz: float | None = options.RATE,
    layout: str = options.LAYOUT,
    topic: list[str] | None = options.TOPICS,
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Detect road users in a folder of scans, images or both.

    Writes labels/NAME.txt for each scan in KITTI's format, in the frame of the camera (at the
    LiDAR without a calibration), and detections.json, in the LiDAR's axes. Results so far are
    written after Ctrl-C. A scan that cannot be read counts as empty.
    """
    from roadscope.benchmarks.detection_files import (
        picture_folder,
        result_folder,
        save_views,
        write_results,
    )
    from roadscope.benchmarks.detection_runner import RecordingOptions, detection_job
    from roadscope.benchmarks.formats.point_layout import parse_columns

    columns = parse_columns(layout) if layout else ()
    turn, height_m = _turn(lidar_mounting), _checked_height(height)
    recording = RecordingOptions(
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
    job = detection_job(folder, recording)
    for note in job.notes:
        complain(note)
    result_folder(out, job)
    views = None if pictures is None else picture_folder(pictures, job)
    frames_by_row: dict[int, DetectedFrame] = {}
    with progress_bars(quiet=quiet) as progress:
        try:
            frames_by_row.update(job.frames(progress))
        finally:
            frames = [frames_by_row[row] for row in sorted(frames_by_row)]
            about = _about(job)
            if frames:
                write_results(out, job, frames, about)
            _report_missing(job, frames, out)
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
        say(f"written: {out}" if views is None else f"written: {out}, {views}")


def _turn(mounting: str | None) -> np.ndarray | None:
    """Return the (3, 3) rotation of the option --lidar-mounting; None without it."""
    from roadscope.benchmarks.formats.samples import parse_mounting

    return None if mounting is None else parse_mounting(mounting).rotation


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


def _report_missing(job: DetectionJob, frames: Sequence[DetectedFrame], out: Path) -> None:
    """Print how many frames have results, if some have none or only results of the LiDAR."""
    unfused = sum(not frame.fused for frame in frames)
    if unfused or 0 < len(frames) < len(job):
        alone = f", of the LiDAR alone in {unfused} of them" if unfused else ""
        complain(f"results of {len(frames)} of {len(job)} frames are kept in {out}{alone}")


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
