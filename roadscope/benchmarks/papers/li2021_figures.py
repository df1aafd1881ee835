"""Figures 5 to 8 of Li 2021 from our scenes with the first test seed.

Boxes are those of the LiDAR's clusters, of the shipped network and of the paper's fusion. Below a
box stand its number and its distance, above it its class and score, where there is room: near
targets come first, and labels do not overlap.
"""

from __future__ import annotations

from functools import cache, partial
from operator import attrgetter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.papers.drawing import caption
from roadscope.benchmarks.papers.li2021 import DURATION_S, EVERY, RIG, fuse
from roadscope.benchmarks.papers.li2021_pairs import SensorPair, sense_pairs
from roadscope.benchmarks.papers.reproduction import FIRST_SEED
from roadscope.core import Category, Detections, Frame, ImageDetections
from roadscope.core.fused import FusedDetections
from roadscope.core.palette import DETECTION_COLOURS, hex_colour
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.fusion.cluster_boxes import ClusterBoxes

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import BboxBase

LEAST_SCORE = 0.3
"""Fainter boxes would hide the picture."""
LEAST_WIDTH_PX = 16.0
"""Narrower boxes have no labels: nobody could say whose a label is."""
ROOM_PX = 22.0
"""Height of a label in pixels of the image, roughly."""
MARGIN_PX = 60.0
"""Height of the image above and below all boxes that is drawn."""
LABELS = "labels where there is room"
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

    def rows(self) -> tuple[float, float]:
        """Return the first and last row of the image around all boxes."""
        boxes = [
            fused.image_boxes[_shown(fused)] for fused in self.detections.values() if len(fused)
        ]
        tops, bottoms = np.concatenate(boxes)[:, [1, 3]].T
        last = float(len(self.pixels))
        return max(tops.min() - MARGIN_PX, 0.0), min(bottoms.max() + MARGIN_PX, last)


class BoxLabel(NamedTuple):
    """A text at a box (left, top, right, bottom: pixels), above or below it."""

    text: str
    box: np.ndarray
    above: bool
    colour: str

    @property
    def area(self) -> float:
        """Of the box, pixels."""
        left, top, right, bottom = self.box
        return float((right - left) * (bottom - top))


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


def _shown(fused: FusedDetections) -> np.ndarray:
    """Return the rows of the boxes that are drawn."""
    return np.flatnonzero(fused.has_image_box & (fused.scores >= LEAST_SCORE))


def _draw_scenes(figure: Figure, places: Iterable[Axes], scene: DrawnScene, *shown: str) -> None:
    """Draw an image as it is, and with the boxes of each method."""
    first, last = scene.rows()
    methods = (None, *shown)
    labels_of = []
    for axes, method in zip(places, methods, strict=True):
        axes.imshow(scene.pixels)
        axes.set_axis_off()
        axes.set(title=method or "image", ylim=(last, first))
        labels_of.append(
            (axes, _draw_boxes(axes, scene.detections[method], method) if method else [])
        )
    # The size of the axes, and so the room for labels, is known after the layout.
    figure.draw_without_rendering()
    for axes, labels in labels_of:
        _draw_labels(axes, labels)


def _draw_boxes(axes: Axes, fused: FusedDetections, method: str) -> list[BoxLabel]:
    """Draw the boxes of a method and return their labels."""
    from matplotlib.patches import Rectangle

    labels = []
    for k in _shown(fused):
        box = left, top, right, bottom = fused.image_boxes[k]
        category = Category(int(fused.categories[k]))
        colour = hex_colour(DETECTION_COLOURS[category.family])
        axes.add_patch(Rectangle((left, top), right - left, bottom - top, fill=False, color=colour))
        if right - left < LEAST_WIDTH_PX:
            continue
        if fused.distances_m[k] >= 0 and method != CAMERA:
            below = f"{fused.lidar_rows[k]}: {fused.distances_m[k]:.1f} m"
            labels.append(BoxLabel(below, box, False, colour))
        if method != LIDAR:
            name = f"{category.name.lower()} {fused.scores[k]:.2f}"
            labels.append(BoxLabel(name, box, True, colour))
    return labels


def _draw_labels(axes: Axes, labels: Sequence[BoxLabel]) -> None:
    """Write labels, those of large boxes first; one that would overlap another is left out."""
    from matplotlib.patheffects import withStroke

    last, first = axes.get_ylim()
    inside, written = axes.get_window_extent(), list["BboxBase"]()
    for label in sorted(labels, key=attrgetter("area"), reverse=True):
        left, top, right, bottom = label.box
        # Inside the box where the image ends beside it.
        if label.above:
            row, side = (top - 3, "bottom") if top - ROOM_PX > first else (top + 3, "top")
        else:
            row, side = (bottom + 3, "top") if bottom + ROOM_PX < last else (bottom - 3, "bottom")
        for column, align in ((left, "left"), (right, "right")):
            text = axes.text(column, row, label.text, color=label.colour, fontsize=6)
            outline = withStroke(linewidth=1.5, foreground="#202020")
            text.set(ha=align, va=side, path_effects=[outline])
            extent = text.get_window_extent().padded(1.0)
            is_inside = inside.contains(*extent.min) and inside.contains(*extent.max)
            if is_inside and not any(extent.overlaps(other) for other in written):
                written.append(extent)
                break
            text.remove()


def _set_size(figure: Figure, scene: DrawnScene, rows: int) -> None:
    """Set a size for two images side by side, in rows of them."""
    first, last = scene.rows()
    height = 5.9 * (last - first) / scene.pixels.shape[1]
    figure.set_size_inches(12.0, 0.3 + rows * (height + 0.3))


def one_sensor(method: str, figure: Figure) -> None:
    """Figures 5 and 6: an image, and what one sensor detects in it."""
    scene = _scene("street")
    _set_size(figure, scene, 1)
    caption(figure, f"scenario street, {method}; {LABELS}")
    _draw_scenes(figure, figure.subplots(1, 2), scene, method)


def fused_scene(scenario: str, figure: Figure) -> None:
    """Figures 7 and 8: an image, and what LiDAR, camera and both detect in it."""
    scene = _scene(scenario)
    _set_size(figure, scene, 2)
    caption(figure, f"scenario {scenario}, {LIDAR}, {CAMERA}, {FUSED}; {LABELS}")
    _draw_scenes(figure, figure.subplots(2, 2).flat, scene, LIDAR, CAMERA, FUSED)


FIGURES = {
    "figure-05": partial(one_sensor, LIDAR),
    "figure-06": partial(one_sensor, CAMERA),
    "figure-07": partial(fused_scene, "street"),
    "figure-08": partial(fused_scene, "town-crossing"),
}
"""By the paper's number."""
