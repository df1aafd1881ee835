"""The middle image of an episode, with the boxes of a camera detector drawn in."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from roadscope.benchmarks.cache import usable_file, write_atomically
from roadscope.benchmarks.episode import Episode, check_episode
from roadscope.benchmarks.images import Picture, camera_of, image_rows, pictures
from roadscope.benchmarks.nodes.images import detect_in_picture
from roadscope.benchmarks.references import check_image_source
from roadscope.benchmarks.single import PICTURES
from roadscope.core import Category, ImageDetections
from roadscope.envs.sensors.rigs import rig

COLOURS = {"vehicle": (255, 170, 0), "cyclist": (0, 200, 255), "pedestrian": (255, 60, 120)}
"""Colour of the boxes of each family, RGB."""
LEAST_SCORE = 0.3
"""Boxes with lower scores are not drawn: they would hide the picture."""
LINE_PX = 2
TEXT_PX = 11


def check_view(episode: Episode, detector: str, path: Path | str) -> None:
    """Refuse a rig without camera, a wrong detector, and a file that cannot be written."""
    check_episode(episode)
    camera_of(rig(episode.rig))
    check_image_source(detector)
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
    return drawn(picture.frame.camera.pixels, detections), detections


def save_view(episode: Episode, detector: str, path: Path | str) -> int:
    """Write `camera_view` to a file, in the format of its ending; return the number of boxes."""
    from matplotlib.image import imsave

    check_view(episode, detector, path)
    pixels, detections = camera_view(episode, detector)
    place = Path(path)
    write_atomically(place, lambda part: imsave(part, pixels, format=place.suffix[1:].lower()))
    return len(detections)


def drawn(pixels: np.ndarray, detections: ImageDetections) -> np.ndarray:
    """Return (H, W, 3) uint8 pixels with boxes in their family's colour, category and score."""
    from PIL import Image, ImageDraw

    image = Image.fromarray(pixels)
    pen = ImageDraw.Draw(image)
    for box, number, score in zip(
        detections.boxes, detections.categories, detections.scores, strict=True
    ):
        category = Category(int(number))
        colour = COLOURS[category.family.value]
        pen.rectangle(box.tolist(), outline=colour, width=LINE_PX)
        label = f"{category.name.lower()} {score:.2f}"
        pen.text((box[0], max(0.0, box[1] - TEXT_PX)), label, fill=colour)
    return np.asarray(image)


def _middle(episode: Episode) -> Picture:
    rows = image_rows(episode, 0.0)
    middle = len(rows) // 2
    for row in sorted(rows, key=lambda number: abs(number - rows[middle])):
        (picture,) = pictures(episode, (row,))
        if picture.frame.camera is not None:
            return picture
    raise ValueError(f"no image of {episode.scenario} is left: {episode.condition}")
