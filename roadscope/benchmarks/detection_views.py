"""Pictures of recorded scans and images with the boxes detected in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from roadscope.benchmarks.cache import usable_folder
from roadscope.benchmarks.detection_runner import DetectedFrame, DetectionJob
from roadscope.benchmarks.formats.kitti_frames import kitti_results
from roadscope.benchmarks.formats.table import FormatError
from roadscope.benchmarks.run_pictures import LEAST_SCORE
from roadscope.core import ImageDetections
from roadscope.envs.drawing.birds_eye import scan_view
from roadscope.envs.drawing.panels import image_view
from roadscope.fusion.pairing import ALONE

SCAN_VIEW, IMAGE_VIEW = "_scan.png", "_image.png"
"""Endings of the names of bird's-eye views and of images with boxes."""


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
        _save(view, folder / f"{frame.name}{SCAN_VIEW}")
    image = job.image_rows[row]
    pixels = None if job.images is None or image == ALONE else job.images.read(image)
    if pixels is not None:
        _save(image_view(pixels, _image_boxes(frame)), folder / f"{frame.name}{IMAGE_VIEW}")


def _image_boxes(frame: DetectedFrame) -> ImageDetections:
    """Return the boxes of a frame in its image, those of boxes in space included."""
    rows = kitti_results(frame.detections, frame.camera)
    shown = rows.in_image & (rows.scores >= LEAST_SCORE)
    categories = frame.detections.categories[shown]
    return ImageDetections(rows.boxes[shown], categories, rows.scores[shown], frame.stamp_s)


def _save(picture: np.ndarray, path: Path) -> None:
    from PIL import Image

    Image.fromarray(picture).save(path, compress_level=1)
