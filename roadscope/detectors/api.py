"""What a detector is."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from roadscope.core import Detections, Frame, ImageDetections


@runtime_checkable
class Detector(Protocol):
    """Finds road users in one frame.

    Constructor arguments are keyword-only and all have defaults. 3-D boxes come back in the ego
    frame (rear axle on the ground), image boxes in pixels, both with the stamp of their sensor.
    """

    def reset(self) -> None:
        """Forget all frames so far."""

    def detect(self, frame: Frame) -> Detections | ImageDetections:
        """Return the detections of this frame, or of an earlier one that needed later frames.

        The stamp says which frame they are of: one of those since `reset`. Detections in the ego
        frame are relative to where the ego stood at that stamp. An empty answer leaves its frame
        open, so a detector that answers late returns one while it has nothing to say; a frame
        with detections is not answered again.

        For a frame without a scan a LiDAR detector returns no detections, with the frame's stamp:
        scans can be lost. A caller that must know the difference looks at `frame.lidar`, and gives
        a fusion None for that sensor. A camera detector refuses a frame without an image: images
        have a clock of their own, and frames between them are not for it.
        """
