"""The promises of camera detectors."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.images import pictures
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.image_detection import camera_scores
from roadscope.benchmarks.nodes.images import ImageNode, extinction_per_m
from roadscope.benchmarks.records import EpisodeImageDetections
from roadscope.benchmarks.references import image_source
from roadscope.core import CameraImage, Frame, ImageDetections
from roadscope.core.answers import check_image_detections
from roadscope.testing.shared import figure_in_words, input_promise, memory_promises, start_promises
from roadscope.testing.subject import Instance, Promise, PromiseError, Subject

SCENE = Episode("street", 1, "wide", 2.0)
"""Traffic, one of the training seeds, sensors, seconds."""
ROWS = (0, 10, 20, 30)
"""Images of the scene, by number, that most promises use."""
EVERY_S = 0.4
"""Seconds from image to image where average precision is measured."""
SIZES_PX = ((480, 640), (240, 320), (600, 1000))
"""Heights and widths of images that a detector must accept."""
REFERENCE, MARK = "network", "colour-blobs"
SHARE_OF_MARK = 0.5
"""A detector with a smaller share of the lower mark's average precision is broken.

Chosen by hand: the mark has 0.009. This refuses detectors that find nobody, and boxes in other
units.
"""


@lru_cache(maxsize=1)
def frames() -> tuple[Frame, ...]:
    """Return a few frames of the scene, with images."""
    return tuple(picture.frame for picture in pictures(SCENE, ROWS))


def detect(instance: Instance, frame: Frame) -> ImageDetections:
    """Return the detections in the image of a frame."""
    return check_image_detections(instance.call("detect", frame), stamp_s=frame.stamp_s)


def detect_scene(instance: Instance) -> list[ImageDetections]:
    """Return the detections in the images of the scene."""
    return [detect(instance, frame) for frame in frames()]


def detect_mirrored(instance: Instance) -> list[ImageDetections]:
    """Return the detections in mirror images of the scene, the last of them first."""
    return [
        detect(instance, _with_pixels(frame.camera.pixels[:, ::-1].copy()))
        for frame in reversed(frames())
        if frame.camera is not None
    ]


def answers(subject: Subject) -> str:
    """Run it over the scene, and have every answer checked."""
    with subject.started() as instance:
        count = sum(map(len, detect_scene(instance)))
    return f"{count / len(ROWS):.1f} boxes an image of a street"


def black_image(subject: Subject) -> str:
    """Refuse detections in an image that is black all over, like that of a covered lens."""
    with subject.started() as instance:
        detections = detect(instance, _with_pixels(np.zeros((480, 640, 3), np.uint8)))
    if len(detections):
        raise PromiseError(f"{len(detections)} boxes in an image that is black all over")
    return ""


def other_sizes(subject: Subject) -> str:
    """Refuse boxes that reach beyond an image, whatever its size."""
    image = frames()[0].camera
    assert image is not None
    with subject.started() as instance:
        for height, width in SIZES_PX:
            rows = np.arange(height) * image.pixels.shape[0] // height
            columns = np.arange(width) * image.pixels.shape[1] // width
            frame = _with_pixels(image.pixels[rows][:, columns].copy())
            boxes = detect(instance, frame).boxes
            if ((boxes < 0) | (boxes > np.array([width, height, width, height]))).any():
                raise PromiseError(f"boxes reach beyond an image of {width} x {height} pixels")
    return ""


def compare(subject: Subject) -> str:
    """Detect in two seconds of a street; refuse a detector that finds hardly anybody."""
    detections = ImageNode(subject.spec, SCENE, EVERY_S).compute(subject.options)
    precision = _average_precision(detections)
    beside = {name: _precision_of(name) for name in (REFERENCE, MARK)}
    words = figure_in_words("average precision (AP50) in a street", precision, beside=beside)
    if precision < SHARE_OF_MARK * beside[MARK]:
        count = sum(len(each) for each in detections.filled)
        raise PromiseError(
            f"{words}: {count} boxes in {len(detections.rows)} images, hardly any on a road user; "
            "boxes are left, top, right, bottom in pixels"
        )
    return words


@lru_cache(maxsize=2)
def _precision_of(name: str) -> float:
    node = ImageNode(image_source(name), SCENE, EVERY_S)
    return _average_precision(node.compute(RunOptions()))


def _average_precision(detections: EpisodeImageDetections) -> float:
    labels = detections.labels(extinction_per_m(SCENE))
    precision = camera_scores(detections.filled, labels)["ap50"].value
    return float(np.nan_to_num(precision))


def _with_pixels(pixels: np.ndarray) -> Frame:
    """Return the first frame with other pixels."""
    frame = frames()[0]
    image = frame.camera
    assert image is not None
    return replace(frame, camera=CameraImage(pixels, image.intrinsics, image.stamp_s, image.sensor))


PROMISES = (
    *start_promises("detect", "frame"),
    Promise("answers with boxes in the image that it got", answers),
    input_promise(detect_scene),
    *memory_promises(detect_scene, detect_mirrored, inputs="images", answers="boxes"),
    Promise("finds nothing in a black image", black_image),
    Promise("takes images of other sizes", other_sizes),
    Promise("detects in two seconds of a street", compare),
)
