"""From pairs of rows to fused detections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Category, Detections, ImageDetections, RecordError
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.fusion.evidence import FAMILIES, families_of
from roadscope.fusion.overlap import projected_boxes
from roadscope.fusion.pairing import check_moment

_CATEGORY_OF_FAMILY = np.array([Category.CAR, Category.CYCLIST, Category.PEDESTRIAN], np.int8)


@dataclass(frozen=True, slots=True)
class Views:
    """Both sensors' detections of one moment, none for a sensor that brought nothing.

    lidar_boxes: (N, 4) projected into the image, in_image: (N,) bool.
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
        points = Detections.empty(stamp_s) if lidar is None else lidar
        if points.frame != "ego":
            raise RecordError(f"fusion: expected LiDAR detections in frame ego, got {points.frame}")
        if lidar is not None and camera is not None:
            check_moment(lidar.stamp_s, camera.stamp_s)
        if camera is not None:
            _check_size(camera, projection)
        image = ImageDetections.empty(stamp_s) if camera is None else camera
        return Views(points, image, *projected_boxes(points, projection))


def _check_size(camera: ImageDetections, projection: Projection) -> None:
    """Refuse detections in an image of another size.

    If detections do not know the size of their image, boxes outside of it show that it is another.
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
    """Join rows of both sensors, -1 where a target has none, with (N, 4) fused masses.

    The family is the one with the greatest mass. The category is that of a sensor that reports this
    family, the camera first, else a usual one. The score is the family's mass unless given.
    """
    lidar, camera = views.lidar, views.camera
    family = masses[:, : len(FAMILIES)].argmax(axis=1)
    categories = _CATEGORY_OF_FAMILY[family]
    for rows, detections in ((lidar_rows, lidar), (camera_rows, camera)):
        known = np.flatnonzero(rows >= 0)
        reported = detections.categories[rows[known]]
        agrees = families_of(reported) == family[known]
        categories[known[agrees]] = reported[agrees]
    believed = masses[np.arange(len(masses)), family] if scores is None else scores
    return FusedDetections.from_rows(
        lidar,
        camera,
        lidar_rows=lidar_rows,
        camera_rows=camera_rows,
        categories=categories,
        scores=np.clip(believed, 0.0, 1.0),
        masses=masses,
        lidar_boxes=views.lidar_boxes,
    )
