"""What a camera detector promises, one by one."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from roadscope.benchmarks.check.items import (
    Promise,
    PromiseError,
    begins,
    begun,
    having,
    leaving_alone,
    settled,
)
from roadscope.benchmarks.jobs.look import checked
from roadscope.benchmarks.jobs.stack import EntryError, guarded
from roadscope.core import CameraImage, Frame, ImageDetections
from roadscope.core.registry import Plugin

IMAGES = ("street", 0, "wide", 2.0)
"""The scene: traffic, one of the training seeds, sensors, length."""
ROWS = (0, 10, 20, 30)
EVERY_S = 0.4
SIZES = ((480, 640), (240, 320), (600, 1000))
"""Heights and widths that are tried."""


@lru_cache(maxsize=1)
def frames() -> tuple[Frame, ...]:
    """Return a few frames with images of the scene."""
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.images import pictures

    return tuple(picture.frame for picture in pictures(Episode(*IMAGES), ROWS))


def detected(plugin: Plugin[Any], detector: Any, frame: Frame) -> ImageDetections:
    """Call detect; an answer that is not what the contract says is a fault."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        answer = guarded(plugin.spec, detector.detect, frame)
    try:
        return checked(plugin.spec, answer, frame.stamp_s)
    except EntryError as error:
        raise PromiseError(str(error).removeprefix(f"{plugin.spec}: ")) from None


def told(plugin: Plugin[Any], detector: Any) -> list[ImageDetections]:
    """Run a detector over the scene."""
    return [detected(plugin, detector, frame) for frame in frames()]


def answers(plugin: Plugin[Any]) -> str:
    """Look at what comes back."""
    count = sum(len(found) for found in told(plugin, begun(plugin)))
    return f"{count / len(ROWS):.1f} boxes an image of a street"


def takes_black_images(plugin: Plugin[Any]) -> str:
    """Look at what is found where nothing can be seen, as of a covered lens."""
    found = detected(plugin, begun(plugin), with_pixels(np.zeros((480, 640, 3), np.uint8)))
    if len(found):
        raise PromiseError(f"{len(found)} boxes in an image that is black all over")
    return ""


def takes_other_sizes(plugin: Plugin[Any]) -> str:
    """Look at images of other sizes: boxes lie within them."""
    detector = begun(plugin)
    image = frames()[0].camera
    assert image is not None
    for height, width in SIZES:
        rows = np.arange(height) * image.pixels.shape[0] // height
        columns = np.arange(width) * image.pixels.shape[1] // width
        found = detected(plugin, detector, with_pixels(image.pixels[rows][:, columns].copy()))
        limit = np.array([width, height, width, height])
        if ((found.boxes < 0) | (found.boxes > limit)).any():
            raise PromiseError(f"boxes reach beyond an image of {width} x {height} pixels")
    return ""


def with_pixels(pixels: np.ndarray) -> Frame:
    """Return the first frame with other pixels in it."""
    frame = frames()[0]
    image = frame.camera
    assert image is not None
    return replace(frame, camera=CameraImage(pixels, image.intrinsics, image.stamp_s, image.sensor))


def two_seconds(plugin: Plugin[Any]) -> str:
    """Look at two seconds of a street; how well is remarked."""
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.jobs.look import look
    from roadscope.benchmarks.metrics.image_detection import score_images

    seen = look(plugin.spec, Episode(*IMAGES), EVERY_S)
    scores = score_images(seen.found, seen.labels(0.0)).named()
    rate, calls_ms = scores["detection_rate"].value, np.median(seen.calls_ms)
    text = (
        f"detection rate {rate:.2f} with {scores['false_alarms'].value:.1f} false alarms an image"
    )
    if not rate and any(len(found) for found in seen.found):
        text += " (boxes are left, top, right, bottom in pixels; those below a score of 0.5 do not"
        text += " count)"
    return f"{text} in a street, {calls_ms:.2g} ms an image"


PROMISES = (
    *begins("detect", having("detect", "frame")),
    Promise("answers with boxes in the image it saw", answers, frames),
    leaving_alone(detected, frames, "detect changed the frame it was given"),
    *settled(told, "images", "boxes"),
    Promise("finds nothing in a black image", takes_black_images),
    Promise("takes images of other sizes", takes_other_sizes),
    Promise("looks at two seconds of a street", two_seconds, frames),
)
