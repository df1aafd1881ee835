"""The middle image of an episode, with the boxes of a camera detector drawn in."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from roadscope.benchmarks.cache import usable_file
from roadscope.benchmarks.episode import Episode, check_episode
from roadscope.benchmarks.images import Picture, camera_of, image_rows, pictures
from roadscope.benchmarks.nodes.images import detect_in_picture
from roadscope.benchmarks.references import check_image_source
from roadscope.benchmarks.run_pictures import LEAST_SCORE, PICTURES, save_image
from roadscope.core import ImageDetections
from roadscope.envs.drawing.panels import image_view
from roadscope.envs.sensors.rigs import rig


def check_camera_detector(episode: Episode, detector: str) -> None:
    """Refuse a rig without camera, and a wrong detector."""
    check_episode(episode)
    camera_of(rig(episode.rig))
    check_image_source(detector)


def check_view(episode: Episode, detector: str, path: Path | str) -> None:
    """Refuse a rig without camera, a wrong detector, and a file that cannot be written."""
    check_camera_detector(episode, detector)
    usable_file(path, PICTURES, "an image")


def camera_view(episode: Episode, detector: str) -> tuple[np.ndarray, ImageDetections]:
    """Return the middle image with boxes drawn in, (H, W, 3) uint8, and their detections.

    detector: spec of a camera detector, `oracle` or a noise model. Boxes have a score of at least
    `LEAST_SCORE`. Images that are lost by a fault are left out; `ValueError` if all are lost.
    """
    picture = _middle(episode)
    assert picture.frame.camera is not None
    detections = detect_in_picture(check_image_source(detector), episode, picture)
    detections = detections.select(detections.scores >= LEAST_SCORE)
    return image_view(picture.frame.camera.pixels, detections), detections


def save_view(episode: Episode, detector: str, path: Path | str) -> int:
    """Write `camera_view` to a file, in the format of its ending; return the number of boxes."""
    check_view(episode, detector, path)
    pixels, detections = camera_view(episode, detector)
    save_image(pixels, Path(path))
    return len(detections)


def _middle(episode: Episode) -> Picture:
    rows = image_rows(episode, 0.0)
    middle = len(rows) // 2
    for row in sorted(rows, key=lambda number: abs(number - rows[middle])):
        (picture,) = pictures(episode, (row,))
        if picture.frame.camera is not None:
            return picture
    raise ValueError(f"no image of {episode.scenario} is left: {episode.condition}")
