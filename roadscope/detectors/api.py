"""The protocol of detectors."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from roadscope.core import Detections, Frame, ImageDetections


@runtime_checkable
class Detector(Protocol):
    """Detects road users in one frame.

    Constructor arguments are keyword-only and all have defaults. 3-D boxes come back in the ego
    frame (rear axle on the ground), image boxes in pixels, both with the stamp of their sensor.
    """

    def reset(self) -> None:
        """Forget all frames so far."""

    def detect(self, frame: Frame) -> Detections | ImageDetections:
        """Return the detections of this frame, or of an earlier one that needed later frames.

        The stamp says to which of the frames since `reset` they belong. Detections in the ego frame
        are relative to the ego's pose at that stamp. A frame with detections must not be answered
        again. An empty answer leaves its frame open, so a detector that answers late returns empty
        answers at first.

        For a frame without a scan a LiDAR detector returns no detections, with the frame's stamp,
        because scans can be lost. A caller that needs the difference checks `frame.lidar`, and
        gives a fusion None for that sensor. A camera detector refuses a frame without an image:
        images have their own clock, and it does not get the frames between them.
        """
