"""Files of what was detected in a recording: KITTI's labels, one JSON file, and pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.benchmarks.cache import FolderError, usable_folder
from roadscope.benchmarks.detection_runner import CAMERA, LIDAR, DetectedFrame, DetectionJob
from roadscope.benchmarks.formats.kitti_frames import kitti_results
from roadscope.benchmarks.formats.kitti_labels import write_kitti_object_results
from roadscope.benchmarks.formats.table import FormatError, visible
from roadscope.benchmarks.run_pictures import LEAST_SCORE
from roadscope.core import Category, ImageDetections, Pose
from roadscope.core.fused import FusedDetections
from roadscope.envs.drawing.birds_eye import scan_view
from roadscope.envs.drawing.panels import image_view
from roadscope.fusion.pairing import ALONE

LABELS, RESULTS = "labels", "detections.json"
"""The folder with a label file for each frame, and the file with all detections."""
SCAN_VIEW, IMAGE_VIEW = "_scan.png", "_image.png"
"""Endings of the names of bird's-eye views and of images with boxes."""


def result_folder(folder: Path, job: DetectionJob) -> Path:
    """Make a folder for results; refuse one with labels of other frames than these."""
    labels = usable_folder(usable_folder(folder) / LABELS)
    others = {path.stem for path in visible(labels, "*.txt")} - set(job.names)
    if others:
        raise FolderError(
            f"{labels} has labels of other scans, such as {min(others)}.txt: name another "
            "folder, --out DIR"
        )
    return folder


def write_results(
    folder: Path, job: DetectionJob, frames: Sequence[DetectedFrame], about: Mapping[str, Any]
) -> None:
    """Write a label file for each frame, and one JSON file, whose boxes are in the LiDAR's axes.

    folder: of `result_folder`. about: what else the JSON file says, before its frames.
    """
    for frame in frames:
        rows = kitti_results(frame.detections, frame.camera)
        write_kitti_object_results(folder / LABELS / f"{frame.name}.txt", rows)
    lidar_from_ego = job.ego_from_lidar.inverse()
    content = {**about, "frames": [_content(frame, lidar_from_ego) for frame in frames]}
    text = json.dumps(content, indent=1, allow_nan=False)
    (folder / RESULTS).write_text(f"{text}\n", encoding="utf-8")


def _content(frame: DetectedFrame, lidar_from_ego: Pose) -> dict[str, Any]:
    """Return a frame as a dictionary that JSON can hold."""
    targets = [frame.detections.select(np.array([k])) for k in range(len(frame.detections))]
    problems = [frame.problem, "" if frame.fused else "stopped before detections were fused"]
    problem = {"problem": "; ".join(filter(None, problems))} if any(problems) else {}
    boxes = [_box(target, lidar_from_ego) for target in targets]
    return {"name": frame.name, "stamp_s": frame.stamp_s, **problem, "detections": boxes}


def _box(target: FusedDetections, lidar_from_ego: Pose) -> dict[str, Any]:
    """Return the only target as a dictionary; what is not known of it is left out."""
    content: dict[str, Any] = {
        "category": Category(int(target.categories[0])).name.lower(),
        "score": float(target.scores[0]),
    }
    if target.has_box[0]:
        box = target.detections().moved(lidar_from_ego, LIDAR)
        content["centre_m"], content["size_m"] = box.centres[0].tolist(), box.sizes[0].tolist()
        content["yaw_rad"] = float(box.yaws[0])
    if target.has_image_box[0]:
        content["image_box_px"] = target.image_boxes[0].tolist()
    sensors = {LIDAR: target.by_lidar[0], CAMERA: target.by_camera[0]}
    return {**content, "sensors": [name for name, detected in sensors.items() if detected]}


def picture_folder(path: Path, job: DetectionJob) -> Path:
    """Make a folder for pictures and return it; one with images of the recording is refused."""
    folder = usable_folder(path)
    place = None if job.images is None else job.images.place
    if place is not None and place.samefile(folder):
        raise FormatError(f"{folder} has the images of the recording: name another folder")
    return folder


def save_views(job: DetectionJob, row: int, frame: DetectedFrame, folder: Path) -> None:
    """Write a bird's-eye view of the scan of a frame, and its image with boxes, if it has them."""
    if job.scans is not None:
        (scan,) = job.scans.part(row, row + 1)
        boxes = frame.detections.detections()
        shown = boxes.select(boxes.scores >= LEAST_SCORE)
        view = scan_view(scan, job.ego_from_lidar, shown)
        _save_png(view, folder / f"{frame.name}{SCAN_VIEW}")
    image = job.image_rows[row]
    pixels = None if job.images is None or image == ALONE else job.images.read(image)
    if pixels is not None:
        _save_png(image_view(pixels, _image_boxes(frame)), folder / f"{frame.name}{IMAGE_VIEW}")


def _image_boxes(frame: DetectedFrame) -> ImageDetections:
    """Return the boxes of a frame in its image, those of boxes in space included."""
    rows = kitti_results(frame.detections, frame.camera)
    shown = rows.in_image & (rows.scores >= LEAST_SCORE)
    categories = frame.detections.categories[shown]
    return ImageDetections(rows.boxes[shown], categories, rows.scores[shown], frame.stamp_s)


def _save_png(picture: np.ndarray, path: Path) -> None:
    from PIL import Image

    Image.fromarray(picture).save(path, compress_level=1)
