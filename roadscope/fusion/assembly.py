"""The input of all fusions, checked, and fused detections from rows of both sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Detections, ImageDetections, RecordError
from roadscope.core.category import CATEGORY_OF_FAMILY, families_of
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.fusion.evidence import FAMILIES
from roadscope.fusion.overlap import projected_boxes
from roadscope.fusion.pairing import check_moment


@dataclass(frozen=True, slots=True)
class Views:
    """Both sensors' detections of one moment; an empty record for a sensor without measurement.

    lidar_boxes: (N, 4) pixels, left top right bottom, the boxes of `lidar` projected into the image
        and cut to it, zeros where nothing of them lies in the image.
    in_image: (N,) bool, whether any part of the box lies in the image.
    """

    lidar: Detections
    camera: ImageDetections
    lidar_boxes: np.ndarray
    in_image: np.ndarray

    @staticmethod
    def of(
        lidar: Detections | None, camera: ImageDetections | None, projection: Projection
    ) -> Views:
        """Check the detections and project those of the LiDAR.

        Raises `RecordError` if both are None, if more than a second is between them, if LiDAR
        detections are not in the ego frame, or if the image does not have the projection's size.
        """
        if not isinstance(projection, Projection):
            raise RecordError(
                f"fusion: expected a Projection, got {type(projection).__name__}; "
                "`read_calibration` and `Projection.of` make one"
            )
        if lidar is None and camera is None:
            raise RecordError("fusion: expected detections of one sensor at least, got none")
        stamp_s = (
            lidar.stamp_s if lidar is not None else camera.stamp_s if camera is not None else 0.0
        )
        boxes = Detections.empty(stamp_s) if lidar is None else lidar
        if boxes.frame != "ego":
            raise RecordError(f"fusion: expected LiDAR detections in frame ego, got {boxes.frame}")
        if lidar is not None and camera is not None:
            check_moment(lidar.stamp_s, camera.stamp_s)
        if camera is not None:
            _check_size(camera, projection)
        image = ImageDetections.empty(stamp_s) if camera is None else camera
        return Views(boxes, image, *projected_boxes(boxes, projection))


def _check_size(camera: ImageDetections, projection: Projection) -> None:
    """Refuse detections in an image of another size.

    If the detections do not state the size of their image, boxes outside of the expected size show
    that it is another one.
    """
    size = np.array([projection.width, projection.height])
    expected = f"fusion: the calibration is of images of {projection.width} x {projection.height}, "
    if camera.size_px is not None and camera.size_px != tuple(size):
        raise RecordError(f"{expected}but this one has {camera.size_px[0]} x {camera.size_px[1]}")
    outside = ((camera.boxes[:, :2] > size) | (camera.boxes[:, 2:] < 0)).any(axis=1)
    if outside.any():
        first = camera.boxes[outside][0].round(1).tolist()
        raise RecordError(f"{expected}but a box is at {first} (left top right bottom)")


def assemble(
    views: Views,
    lidar_rows: np.ndarray,
    camera_rows: np.ndarray,
    masses: np.ndarray,
    scores: np.ndarray | None = None,
) -> FusedDetections:
    """Return N targets made from rows of both sensors' detections.

    The family of a target is that of the greatest mass. Its category is that of a detection of this
    family, of the camera's if both are, and car, cyclist or pedestrian if neither is.

    lidar_rows, camera_rows: (N,) rows of the detections, -1 where a target has none.
    masses: (N, 4) fused masses: vehicle, cyclist, pedestrian, ignorance.
    scores: (N,) clipped to 0 to 1; None for the mass of the family.
    """
    lidar, camera = views.lidar, views.camera
    family = masses[:, : len(FAMILIES)].argmax(axis=1)
    categories = CATEGORY_OF_FAMILY[family]
    for rows, detections in ((lidar_rows, lidar), (camera_rows, camera)):
        detected = np.flatnonzero(rows >= 0)
        reported = detections.categories[rows[detected]]
        agrees = families_of(reported) == family[detected]
        categories[detected[agrees]] = reported[agrees]
    scores = masses[np.arange(len(masses)), family] if scores is None else scores
    return FusedDetections.from_rows(
        lidar,
        camera,
        lidar_rows=lidar_rows,
        camera_rows=camera_rows,
        categories=categories,
        scores=np.clip(scores, 0.0, 1.0),
        masses=masses,
        lidar_boxes=views.lidar_boxes,
    )
