"""Finds road users in images with the shipped network."""

from __future__ import annotations

import re
import warnings
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from roadscope.core import CameraImage, Frame, ImageDetections, RecordError
from roadscope.detectors.camera.calibration import BoxCalibration
from roadscope.detectors.camera.decoding import FINE, Peaks, decode
from roadscope.detectors.camera.precision import AUTO, PRECISIONS, fastest, whole_float32
from roadscope.detectors.camera.weight_file import SHIPPED, load

if TYPE_CHECKING:
    from roadscope.detectors.camera.network import CentreNetwork

DEVICE = re.compile(r"cpu|cuda(:\d+)?")
COARSEST = 32
"""The network's coarsest stride, pixels: heights and widths must be multiples of it."""
GREY = 127
"""Bytes that fill the image up on the right and below, to multiples of the coarsest stride."""
LARGEST_WIDTH = 960
"""Wider images are halved by averaging pixels, as often as needed: 1280 pixels become 640, the
width for which the network was trained."""


class BlankImageWarning(UserWarning):
    """An image shows nothing: the lens is covered, or there was no image."""


class CameraDetector:
    """A convolutional network that was trained on rendered traffic.

    Takes images of any size from 32 x 32 up. A frame without an image is refused. A blank image
    gives no detections and a `BlankImageWarning`. A score is the probability that the box is right,
    calibrated on images with which the network was not trained.
    """

    def __init__(
        self,
        *,
        weights: str = "",
        min_score: float = 0.05,
        precision: str = "float32",
        threads: int = 1,
        device: str = "cpu",
    ) -> None:
        """Set the detector up; the network is read with the first image.

        weights: a .safetensors file; the shipped one if left out.
        min_score: least score of a detection; peaks of less heat than `decoding.FLOOR` have none.
        precision: float32, bfloat16, or auto for the faster one on the device. With bfloat16
            the last digits of boxes and scores depend on the processor.
        threads: processor cores that torch may use while it detects.
        device: cpu, cuda or cuda:1.
        """
        if not 0 < min_score < 1:
            raise ValueError(f"min_score must lie between 0 and 1, got {min_score!r}")
        if precision not in PRECISIONS:
            raise ValueError(f"no precision {precision!r}; known: {', '.join(PRECISIONS)}")
        if threads < 1:
            raise ValueError(f"threads must be at least 1, got {threads!r}")
        if not DEVICE.fullmatch(device):
            raise ValueError(f"no device {device!r}; known: cpu, cuda, cuda:0 and so on")
        self.weights = Path(weights) if weights else SHIPPED
        self.min_score = min_score
        self.precision = fastest(device) if precision == AUTO else precision
        self.threads = threads
        self.device = device

    def reset(self) -> None:
        """Do nothing: each image is treated by itself."""

    def prepare(self) -> None:
        """Read the network now; `WeightsError` names the file and what is wrong with it."""
        _ = self._loaded

    def detect(self, frame: Frame) -> ImageDetections:
        """Return the boxes in the frame's image, the greatest score first."""
        if frame.camera is None:
            raise RecordError("the frame has no image: a camera detector needs one in each frame")
        image = frame.camera
        if image.blank:
            return no_detections(image)
        peaks = self.peaks(image.pixels)
        scores = self._loaded[1].scores(peaks.traits, peaks.families)
        rows = np.flatnonzero(scores >= self.min_score)
        order = rows[np.argsort(-scores[rows], kind="stable")]
        return ImageDetections(
            peaks.boxes[order],
            peaks.categories[order].astype(np.int8),
            scores[order],
            image.stamp_s,
            size_px=image.size_px,
        )

    def peaks(self, pixels: np.ndarray) -> Peaks:
        """Return boxes and their traits in (H, W, 3) uint8 pixels."""
        height, width = pixels.shape[:2]
        if min(height, width) < COARSEST:
            raise RecordError(
                f"an image of at least 32 x 32 pixels is needed, got {width} x {height}"
            )
        shrunk, factor = _shrunk(pixels)
        answers = _answers(self._loaded[0], shrunk, self.threads)
        peaks = decode(answers, height_px=shrunk.shape[0], width_px=shrunk.shape[1])
        boxes = np.minimum(peaks.boxes * factor, [width, height, width, height])
        return Peaks(boxes, peaks.families, peaks.categories, peaks.traits)

    @cached_property
    def _loaded(self) -> tuple[CentreNetwork, BoxCalibration]:
        import torch

        if self.device != "cpu" and not torch.cuda.is_available():
            raise ValueError(f"torch finds no device {self.device!r} here; there is: cpu")
        network, calibration = load(self.weights)
        folded = network.folded(getattr(torch, self.precision))
        return folded.to(self.device), calibration


def no_detections(image: CameraImage) -> ImageDetections:
    """Warn the caller of `detect` of a blank image; return a record without detections."""
    warnings.warn(
        f"camera '{image.sensor}' at {image.stamp_s:.3f} s: the image is blank",
        BlankImageWarning,
        stacklevel=3,
    )
    return ImageDetections(
        np.empty((0, 4)), np.empty(0, np.int8), np.empty(0), image.stamp_s, size_px=image.size_px
    )


def _shrunk(pixels: np.ndarray) -> tuple[np.ndarray, int]:
    """Halve an image until it is narrow enough; return it and the factor by which it shrank."""
    factor = 1
    while pixels.shape[1] > LARGEST_WIDTH:
        rows, columns = (n // 2 * 2 for n in pixels.shape[:2])
        even = pixels[:rows, :columns].astype(np.uint16)
        total = even[::2, ::2] + even[::2, 1::2] + even[1::2, ::2] + even[1::2, 1::2]
        pixels = ((total + 2) // 4).astype(np.uint8)
        factor *= 2
    return pixels, factor


def squared(pixels: np.ndarray) -> np.ndarray:
    """Turn (H, W, 3) bytes into (H / 2, W / 2, 12) as `network.squares` does, in half the time."""
    rows, columns = (n // 2 for n in pixels.shape[:2])
    blocks = np.empty((rows, columns, 2, 6), np.uint8)
    for k in range(2):
        blocks[:, :, k] = pixels[k::2].reshape(rows, columns, 6)
    return blocks.reshape(rows, columns, 12)


def _answers(network: CentreNetwork, pixels: np.ndarray, threads: int) -> np.ndarray:
    """Return the answers (h, w, 4, 12) of one image, padded below and on the right with grey."""
    import torch

    height, width = (-(-n // COARSEST) * COARSEST for n in pixels.shape[:2])
    parameter = next(network.parameters())
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        with torch.inference_mode(), whole_float32():
            full = np.full((height, width, 3), GREY, np.uint8)
            full[: pixels.shape[0], : pixels.shape[1]] = pixels
            blocks = torch.from_numpy(squared(full)).to(parameter.device, parameter.dtype)
            colours = blocks.div_(127.5).sub_(1.0).permute(2, 0, 1)[None]
            answers = network.answers(colours)[0].cpu().numpy()
            return answers.reshape(*answers.shape[:2], FINE * FINE, -1)
    finally:
        torch.set_num_threads(before)
