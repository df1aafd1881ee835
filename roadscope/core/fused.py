"""Fused detections: targets that LiDAR, camera or both detected."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core.category import Family, families_of
from roadscope.core.checks import (
    RecordError,
    check_categories,
    check_image_boxes,
    check_scores,
    check_sizes,
    require,
    settle_arrays,
)
from roadscope.core.detections import Detections, ImageDetections
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class FusedDetections(Record):
    """The targets that a fusion reports for one moment.

    categories: (N,) int8, values of `Category`. scores: (N,) float64 in 0 to 1.
    by_lidar, by_camera: (N,) bool, whether that sensor detected the target.
    has_box: (N,) bool, whether centre, size and yaw are known.
    centres, sizes: (N, 3) float64, metres, yaws: (N,) radians, frame `ego`; 0, 1 and 0 where
        unknown.
    distances_m: (N,) float64, from the ego over ground, -1 where unknown.
    lidar_rows: (N,) int64, row of the LiDAR detection that the target is made from, -1 without one;
        several targets in a crowd may share one.
    has_image_box: (N,) bool. image_boxes: (N, 4) float64, pixels, left top right bottom; 0
        where unknown.
    masses: (N, K) float64 Dempster-Shafer masses, the last column for ignorance.
    stamp_s: seconds since reset.
    """

    categories: np.ndarray
    scores: np.ndarray
    by_lidar: np.ndarray
    by_camera: np.ndarray
    has_box: np.ndarray
    centres: np.ndarray
    sizes: np.ndarray
    yaws: np.ndarray
    distances_m: np.ndarray
    lidar_rows: np.ndarray
    has_image_box: np.ndarray
    image_boxes: np.ndarray
    masses: np.ndarray
    stamp_s: float

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            categories=(np.int8, ("N",)),
            scores=(np.float64, ("N",)),
            by_lidar=(np.bool_, ("N",)),
            by_camera=(np.bool_, ("N",)),
            has_box=(np.bool_, ("N",)),
            centres=(np.float64, ("N", 3)),
            sizes=(np.float64, ("N", 3)),
            yaws=(np.float64, ("N",)),
            distances_m=(np.float64, ("N",)),
            lidar_rows=(np.int64, ("N",)),
            has_image_box=(np.bool_, ("N",)),
            image_boxes=(np.float64, ("N", 4)),
            masses=(np.float64, ("N", "K")),
        )
        check_categories(self, "categories", self.categories)
        check_scores(self, "scores", self.scores)
        check_sizes(self, "sizes", self.sizes[self.has_box])
        check_image_boxes(self, "image_boxes", self.image_boxes[self.has_image_box])
        detected = self.by_lidar | self.by_camera
        require(
            bool(detected.all()),
            self,
            "by_lidar",
            "True where by_camera is False, for a sensor detects every target",
            False,
        )

    def __len__(self) -> int:
        return len(self.scores)

    @staticmethod
    def of(
        lidar: Detections | None,
        camera: ImageDetections | None,
        *,
        pairs: np.ndarray | None = None,
        scores: np.ndarray | None = None,
    ) -> FusedDetections:
        """Return all detections of both sensors as targets, one target for each pair.

        For fusions that only say which detections belong together. A pair has the box in space of
        its LiDAR detection, the image box of its camera detection, the greater score and the
        category that goes with it.

        lidar, camera: detections in frame `ego` and in the image, None for a sensor without
            measurement; at least one of them is needed.
        pairs: (M, 2) rows of `lidar` and `camera` that belong together; each row once at most.
        scores: (M,) of the pairs, in place of the greater score.
        """
        rows = _pair_rows(pairs, _count(lidar), _count(camera))
        lidar_only = np.setdiff1d(np.arange(_count(lidar)), rows[:, 0])
        camera_only = np.setdiff1d(np.arange(_count(camera)), rows[:, 1])
        lidar_rows = np.concatenate([rows[:, 0], lidar_only, np.full(len(camera_only), -1)])
        camera_rows = np.concatenate([rows[:, 1], np.full(len(lidar_only), -1), camera_only])
        all_scores = None
        if scores is not None:
            all_scores = np.concatenate(
                [
                    np.asarray(scores, np.float64),
                    _scores(lidar)[lidar_only],
                    _scores(camera)[camera_only],
                ]
            )
        return FusedDetections.from_rows(
            lidar, camera, lidar_rows=lidar_rows, camera_rows=camera_rows, scores=all_scores
        )

    @staticmethod
    def from_rows(
        lidar: Detections | None,
        camera: ImageDetections | None,
        *,
        lidar_rows: np.ndarray,
        camera_rows: np.ndarray,
        categories: np.ndarray | None = None,
        scores: np.ndarray | None = None,
        masses: np.ndarray | None = None,
        lidar_boxes: np.ndarray | None = None,
    ) -> FusedDetections:
        """Return targets, each made from a row of one sensor's detections or of both.

        lidar, camera: as in `of`.
        lidar_rows, camera_rows: (N,) rows of the detections, -1 where a target has none.
        categories, scores: (N,); those of the sensor with the greater score if left out.
        masses: (N, K) with ignorance last; if left out (N, 4) with the score as the mass of the
            family, in the order vehicle, cyclist, pedestrian.
        lidar_boxes: (L, 4) pixels, all LiDAR detections projected into the image, zeros where
            outside. Targets that the camera did not detect get them as their image boxes.
        """
        lidar, camera = _both(lidar, camera)
        lidar_rows = _rows("lidar_rows", lidar_rows, len(lidar))
        camera_rows = _rows("camera_rows", camera_rows, len(camera))
        _check_equal_lengths(lidar_rows, camera_rows)
        by_lidar, by_camera = lidar_rows >= 0, camera_rows >= 0
        lidar_scores = _rows_or(lidar.scores, lidar_rows, -1.0)
        camera_scores = _rows_or(camera.scores, camera_rows, -1.0)
        if categories is None:
            categories = np.where(
                lidar_scores > camera_scores,
                _rows_or(lidar.categories, lidar_rows, 0),
                _rows_or(camera.categories, camera_rows, 0),
            )
        if scores is None:
            scores = np.maximum(lidar_scores, camera_scores)
        boxes = _rows_or(camera.boxes, camera_rows, 0.0)
        projected_boxes = np.zeros_like(boxes)
        if lidar_boxes is not None:
            projected_boxes = _rows_or(np.asarray(lidar_boxes, np.float64), lidar_rows, 0.0)
        inside = (projected_boxes[:, 2:] > projected_boxes[:, :2]).all(axis=1)
        from_lidar = by_lidar & ~by_camera & inside
        boxes[from_lidar] = projected_boxes[from_lidar]
        centres = _rows_or(lidar.centres, lidar_rows, 0.0)
        return FusedDetections(
            categories=categories,
            scores=scores,
            by_lidar=by_lidar,
            by_camera=by_camera,
            has_box=by_lidar,
            centres=centres,
            sizes=_rows_or(lidar.sizes, lidar_rows, 1.0),
            yaws=_rows_or(lidar.yaws, lidar_rows, 0.0),
            distances_m=np.where(by_lidar, np.hypot(centres[:, 0], centres[:, 1]), -1.0),
            lidar_rows=lidar_rows,
            has_image_box=by_camera | from_lidar,
            image_boxes=boxes,
            masses=_simple_masses(categories, scores) if masses is None else masses,
            stamp_s=lidar.stamp_s,
        )

    def select(self, index: np.ndarray) -> FusedDetections:
        """Return the rows that a mask or an index array selects."""
        names = [name for name in FusedDetections.__slots__ if name != "stamp_s"]
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def detections(self) -> Detections:
        """Return the targets with a box in space, as a tracker takes them."""
        boxed = self.select(self.has_box)
        return Detections(
            boxed.centres,
            boxed.sizes,
            boxed.yaws,
            boxed.categories,
            boxed.scores,
            "ego",
            boxed.stamp_s,
        )


def _both(
    lidar: Detections | None, camera: ImageDetections | None
) -> tuple[Detections, ImageDetections]:
    """Return the detections of both sensors, an empty record in place of None."""
    if lidar is not None and lidar.frame != "ego":
        raise RecordError(
            f"FusedDetections: expected detections in frame ego, got those in frame {lidar.frame}"
        )
    if lidar is not None:
        return lidar, ImageDetections.empty(lidar.stamp_s) if camera is None else camera
    if camera is not None:
        return Detections.empty(camera.stamp_s), camera
    raise RecordError("FusedDetections: expected detections of one sensor at least")


def _count(detections: Detections | ImageDetections | None) -> int:
    return 0 if detections is None else len(detections)


def _scores(detections: Detections | ImageDetections | None) -> np.ndarray:
    return np.empty(0) if detections is None else detections.scores


def _pair_rows(pairs: np.ndarray | None, lidar_count: int, camera_count: int) -> np.ndarray:
    """Return (M, 2) rows; refuse other shapes, rows that do not exist and rows used twice."""
    array = np.empty((0, 2), np.int64) if pairs is None else np.asarray(pairs)
    if array.size == 0:
        return np.empty((0, 2), np.int64)
    if array.ndim != 2 or array.shape[1] != 2:
        raise RecordError(f"FusedDetections: expected pairs (M, 2), got shape {array.shape}")
    columns = (("LiDAR", array[:, 0], lidar_count), ("camera", array[:, 1], camera_count))
    for sensor, column, count in columns:
        rows = _rows(f"rows of {sensor} in pairs", column, count)
        if (rows < 0).any() or len(np.unique(rows)) < len(rows):
            raise RecordError(
                f"FusedDetections: expected each row of {sensor} detections once at "
                f"most in pairs, from 0 to {count - 1}, got {rows.tolist()}"
            )
    return array.astype(np.int64)


def _rows(name: str, rows: np.ndarray, count: int) -> np.ndarray:
    """Return (N,) rows; refuse numbers that are not whole and rows that do not exist."""
    array = np.asarray(rows)
    whole = array.dtype.kind in "iu" or array.size == 0
    if (
        array.ndim != 1
        or not whole
        or (array.size and not -1 <= array.min() <= array.max() < count)
    ):
        raise RecordError(
            f"FusedDetections: expected {name} (N,), whole numbers from -1 to "
            f"{count - 1}, got {array.tolist()}"
        )
    return array.astype(np.int64)


def _check_equal_lengths(lidar_rows: np.ndarray, camera_rows: np.ndarray) -> None:
    if len(lidar_rows) != len(camera_rows):
        raise RecordError(
            f"FusedDetections: expected as many lidar_rows as camera_rows, got "
            f"{len(lidar_rows)} and {len(camera_rows)}"
        )


def _rows_or(values: np.ndarray, rows: np.ndarray, otherwise: float) -> np.ndarray:
    """Return these rows of values, the constant `otherwise` where the row is -1."""
    picked = np.full((len(rows), *values.shape[1:]), otherwise, values.dtype)
    picked[rows >= 0] = values[rows[rows >= 0]]
    return picked


def _simple_masses(categories: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """Return (N, 4) masses: the score for the family, one minus the score for ignorance."""
    families = families_of(categories)
    masses = np.zeros((len(families), len(Family) + 1))
    masses[np.arange(len(families)), families] = scores
    masses[:, -1] = 1.0 - np.asarray(scores)
    return masses
