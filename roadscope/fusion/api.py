"""The protocol of fusions."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from roadscope.core import Detections, ImageDetections
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection


@runtime_checkable
class Fusion(Protocol):
    """Joins detections of LiDAR and camera of about the same time.

    Constructor arguments are keyword-only and all have defaults.
    """

    def reset(self) -> None:
        """Forget everything."""

    def fuse(
        self,
        lidar: Detections | None,
        camera: ImageDetections | None,
        projection: Projection,
    ) -> FusedDetections:
        """Join the detections of a scan, ego frame, and of the image nearest in time.

        None means that the sensor brought nothing at all, which is not the same as an empty
        scan; at least one must be there. The answer has the LiDAR's stamp, or the camera's
        without one. `RecordError` says what cannot be joined: moments more than a second apart,
        an image of another size than the projection's, masses on another frame of families.
        """
