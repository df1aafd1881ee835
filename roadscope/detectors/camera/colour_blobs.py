"""Boxes from colours alone: the lower mark of camera detectors."""

from __future__ import annotations

import numpy as np

from roadscope.core import CameraImage, Category, Frame, ImageDetections, RecordError
from roadscope.core.arguments import check_positive_or_infinite
from roadscope.detectors.camera.detector import no_detections

# All constants are chosen by hand.
SQUARE = 4
"""Side of the squares, in pixels, over which colours are averaged."""
LEAST_SQUARES = 6
"""Least number of squares of a blob."""
TALL = 1.6
"""Blobs higher than this many widths count as people."""
FILLED = 0.35
"""Least share of its box that a blob fills."""


class ColourBlobs:
    """Boxes around patches whose colour differs from that of their row of the image.

    Nothing is learned. Below the horizon most of an image is road and grass, whose colour hardly
    changes along a row. Scores grow with the contrast; they are not probabilities.
    """

    def __init__(self, *, contrast: float = 0.14, horizon: float = 0.42) -> None:
        """Set the detector up.

        contrast: least distance to the row's median colour, all colours in 0 to 1.
        horizon: share of the image, from the top, that is ignored.
        """
        check_positive_or_infinite(contrast=contrast)
        if not 0 <= horizon < 1:
            raise ValueError(f"horizon must be at least 0 and below 1, got {horizon!r}")
        self.contrast = contrast
        self.horizon = horizon

    def reset(self) -> None:
        """Do nothing: each image is treated by itself."""

    def detect(self, frame: Frame) -> ImageDetections:
        """Return a box for each patch."""
        from scipy.ndimage import find_objects, label

        if frame.camera is None:
            raise RecordError("the frame has no image: a camera detector needs one in each frame")
        if frame.camera.blank:
            return no_detections(frame.camera)
        contrasts = self._contrasts(frame.camera.pixels)
        blobs, _ = label(contrasts >= self.contrast)
        patches = []
        for number, (rows, columns) in enumerate(find_objects(blobs), start=1):
            inside = blobs[rows, columns] == number
            if inside.sum() >= LEAST_SQUARES and inside.mean() >= FILLED:
                strength = contrasts[rows, columns][inside].mean()
                patches.append((columns.start, rows.start, columns.stop, rows.stop, strength))
        return _detections(np.array(patches).reshape(-1, 5), frame.camera)

    def _contrasts(self, pixels: np.ndarray) -> np.ndarray:
        """Return the distance of every square's colour to the median of its row, (h, w)."""
        height, width = (n // SQUARE for n in pixels.shape[:2])
        cut = pixels[: height * SQUARE, : width * SQUARE].astype(np.float32) / 255
        means = cut.reshape(height, SQUARE, width, SQUARE, 3).mean(axis=(1, 3))
        row_colours = np.median(means, axis=1)[:, None]
        contrasts: np.ndarray = np.linalg.norm(means - row_colours, axis=-1)
        contrasts[: int(self.horizon * height)] = 0.0
        return contrasts


def _detections(patches: np.ndarray, image: CameraImage) -> ImageDetections:
    """Return the detections of (N, 5) patches: left, top, right, bottom in squares, contrast."""
    boxes = patches[:, :4] * SQUARE
    tall = (boxes[:, 3] - boxes[:, 1]) > TALL * (boxes[:, 2] - boxes[:, 0])
    categories = np.where(tall, Category.PEDESTRIAN, Category.CAR).astype(np.int8)
    scores = 1 - np.exp(-2 * patches[:, 4])
    return ImageDetections(boxes, categories, scores, image.stamp_s, size_px=image.size_px)
