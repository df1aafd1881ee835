"""Figures 5 to 8 of Li 2021 from our scenes with the first test seed.

Boxes are those of the LiDAR's clusters, of the shipped network and of the paper's fusion. Below a
box stand its number and its distance, above it its class and score.
"""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.papers.li2021 import DURATION_S, EVERY, RIG, fuse
from roadscope.benchmarks.papers.li2021_pairs import SensorPair, sense_pairs
from roadscope.benchmarks.papers.reproduction import FIRST_SEED
from roadscope.core import Category, Detections, Frame, ImageDetections
from roadscope.core.fused import FusedDetections
from roadscope.core.palette import DETECTION_COLOURS, hex_colour
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.fusion.cluster_boxes import ClusterBoxes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEAST_SCORE = 0.3
"""Fainter boxes would hide the picture."""
LIDAR, CAMERA, FUSED = "LiDAR alone", "camera alone", "li2021"


class ImageKeeper:
    """A camera detector that remembers the frames it was given."""

    def __init__(self) -> None:
        self._detector, self.frames = CAMERA_DETECTORS.make("network"), list[Frame]()

    def reset(self) -> None:
        """Do nothing: images do not depend on one another."""

    def detect(self, frame: Frame) -> Detections | ImageDetections:
        """Return the network's detections."""
        self.frames.append(frame)
        return self._detector.detect(frame)


class DrawnScene(NamedTuple):
    """The pixels of the image with the most targets, and what each method detects, by name."""

    pixels: np.ndarray
    detections: dict[str, FusedDetections]


@cache
def _scene(scenario: str) -> DrawnScene:
    keeper = ImageKeeper()
    episode = Episode(scenario, FIRST_SEED, RIG, DURATION_S)
    pairs = sense_pairs(episode, every=EVERY, detector=keeper)
    k = max(range(len(pairs)), key=lambda k: int(pairs[k].targets.eligible.sum()))
    image = keeper.frames[k].camera
    assert image is not None
    return DrawnScene(
        image.pixels, {name: _detected(name, pairs[k]) for name in (LIDAR, CAMERA, FUSED)}
    )


def _detected(method: str, pair: SensorPair) -> FusedDetections:
    clusters = ClusterBoxes().detect(pair.scan)
    fused = fuse(method, [pair], [clusters], "clear")
    assert fused is not None
    return fused[0]


def _draw_scene(axes: Axes, scene: DrawnScene, method: str | None) -> None:
    """Draw an image with the boxes of a method; None: as it is."""
    from matplotlib.patches import Rectangle

    axes.imshow(scene.pixels)
    axes.set_axis_off()
    axes.set_title(method or "image")
    if method is None:
        return
    fused = scene.detections[method]
    for k in np.flatnonzero(fused.has_image_box & (fused.scores >= LEAST_SCORE)):
        left, top, right, bottom = fused.image_boxes[k]
        category = Category(int(fused.categories[k]))
        colour = hex_colour(DETECTION_COLOURS[category.family])
        box = Rectangle((left, top), right - left, bottom - top, fill=False, color=colour)
        axes.add_patch(box)
        if method != LIDAR:
            name = f"{category.name.lower()} {fused.scores[k]:.2f}"
            axes.text(left, top - 2, name, color=colour, fontsize=5, clip_on=True)
        if fused.distances_m[k] >= 0 and method != CAMERA:
            below = f"{fused.lidar_rows[k]}: {fused.distances_m[k]:.1f} m"
            axes.text(left, bottom + 2, below, color=colour, fontsize=5, va="top", clip_on=True)


def one_sensor(method: str, figure: Figure) -> None:
    """Figures 5 and 6: an image, and what one sensor detects in it."""
    scene = _scene("street")
    for axes, shown in zip(figure.subplots(1, 2), (None, method), strict=True):
        _draw_scene(axes, scene, shown)


def fused_scene(scenario: str, figure: Figure) -> None:
    """Figures 7 and 8: an image, and what LiDAR, camera and both detect in it."""
    figure.set_size_inches(9.0, 7.0)
    scene = _scene(scenario)
    for axes, shown in zip(figure.subplots(2, 2).flat, (None, LIDAR, CAMERA, FUSED), strict=True):
        _draw_scene(axes, scene, shown)


FIGURES = {
    "figure-05": partial(one_sensor, LIDAR),
    "figure-06": partial(one_sensor, CAMERA),
    "figure-07": partial(fused_scene, "street"),
    "figure-08": partial(fused_scene, "town-crossing"),
}
"""By the paper's number."""
