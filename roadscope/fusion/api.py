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
        self, lidar: Detections | None, camera: ImageDetections | None, projection: Projection
    ) -> FusedDetections:
        """Join the detections of a scan, ego frame, and of the image nearest in time.

        lidar, camera: None if the sensor has no measurement, for example because the scan was
            lost; if it has one without detections, an empty record. One of the two is needed.
        projection: from the ego frame at the scan's stamp to the pixels of the image.

        Returns targets with the stamp of `lidar`, or that of `camera` if `lidar` is None. Raises
        `RecordError` if scan and image are more than a second apart, if the projection is for
        another size of image, or if masses are not on vehicle, cyclist, pedestrian and ignorance.
        """
