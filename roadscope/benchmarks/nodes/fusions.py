"""Fused detections of a LiDAR detector and a camera detector."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensing_of
from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.images import believed_projections, projection_of
from roadscope.benchmarks.kinds import FUSION
from roadscope.benchmarks.loop import CallInput, Replies, RunOptions, run_plugin
from roadscope.benchmarks.metrics.fusion import FARTHEST_M, FusionTargets
from roadscope.benchmarks.nodes.detections import DetectionNode
from roadscope.benchmarks.nodes.images import ImageNode
from roadscope.benchmarks.records import EpisodeDetections, EpisodeFusions, EpisodeImageDetections
from roadscope.benchmarks.references import CALIBRATION, CAMERA_ALONE, LIDAR_ALONE
from roadscope.core import Detections, Pose, Spec, Truth
from roadscope.core.category import families_of
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.core.spec import FUSED
from roadscope.envs.sensors.rigs import rig
from roadscope.fusion.calibration import read_calibration
from roadscope.fusion.overlap import projected_boxes
from roadscope.fusion.pairing import ALONE, ClocksApartError, moved_projection, nearest_images

NEAREST_M = 3.0
"""Least distance of eligible objects."""
MOST_HIDDEN, LEAST_SIDE_PX = 0.9, 3.0
"""An object is in the image if a smaller share of it is hidden and both sides of its box are
longer."""
LEAST_RETURNS, LEAST_PIXELS, LEAST_HEIGHT_PX = 5, 60, 12.0
"""Either so many returns, or so many visible pixels and a box of this height make it eligible."""
PARKED_SIZE_M = (4.4, 1.8, 1.5)
"""Length, width and height that are assumed for parked cars, of which only the centre is known."""


@dataclass(frozen=True)
class FusionNode(Node):
    """The answers of a fusion to the detections of both sensors.

    fusion: the resolved spec; with `alone` it gets the detections of one sensor only.
    calibration: a file with the calibration that the fusion gets; empty: that of the rig.
    every_s: seconds from scan to scan; 0: all scans.
    alone: `LIDAR_ALONE`, `CAMERA_ALONE` or empty.
    """

    lidar: DetectionNode
    camera: ImageNode
    fusion: Spec
    calibration: str = ""
    every_s: float = 0.0
    alone: str = ""

    stage = "fusions"
    folder = "fusions"
    record = EpisodeFusions

    @staticmethod
    def of(
        fused: Spec, episode: Episode, rule: Eligibility, *, every_s: float = 0.0, alone: str = ""
    ) -> FusionNode:
        """Return the node of a resolved spec `fused?lidar=A&camera=B&fusion=C`."""
        return FusionNode(
            DetectionNode(fused.parts["lidar"], episode, rule),
            ImageNode(fused.parts["camera"], episode, every_s, of_scans=True),
            fused.parts["fusion"],
            str(fused.arguments.get(CALIBRATION, "")),
            every_s,
            alone,
        )

    @property
    def episode(self) -> Episode:
        """The episode."""
        return self.lidar.episode

    @property
    def inputs(self) -> str:
        """The two detectors whose detections are fused, in words."""
        return f"{self.lidar.source} + {self.camera.source}"

    def content(self) -> Mapping[str, Any]:
        """Return what the fused detections depend on; of a calibration its matrix, not its path."""
        believed = read_calibration(self.calibration).matrix.tolist() if self.calibration else None
        return {**super().content(), "calibration": believed}

    def compute(self, options: RunOptions) -> EpisodeFusions:
        """Fuse each scan with the image nearest in time, moved by the ego's motion in between.

        A blank image counts as missing. Fusions get None for a missing image or scan.
        """
        lidar: EpisodeDetections = self.lidar.read(options)
        camera: EpisodeImageDetections = self.camera.read(options)
        rows = self.scan_rows(len(lidar.truths))
        inputs = self._inputs(lidar, camera, rows)
        replies: Replies[float, FusedDetections]
        replies = run_plugin(self.fusion, FUSION, inputs, options=options)
        fused = tuple(
            FusedDetections.of(Detections.empty(stamp_s), None)
            if answer is None
            else replace(answer, stamp_s=stamp_s)
            for answer, stamp_s in zip(replies.answers, replies.contexts, strict=True)
        )
        return EpisodeFusions(rows, fused, self.targets(lidar, camera, rows), replies.times)

    def scan_rows(self, scans: int) -> np.ndarray:
        """Return (K,) int64, which scans are fused: all, or one every `every_s` but the first."""
        if not self.every_s:
            return np.arange(scans)
        step = max(1, round(self.every_s / rig(self.episode.rig).lidar.spec.period_s))
        return np.arange(0 if step == 1 else step, scans, step)

    def targets(
        self, lidar: EpisodeDetections, camera: EpisodeImageDetections, rows: np.ndarray
    ) -> tuple[FusionTargets, ...]:
        """Return the objects at each scan; their image boxes are of the nearest image, lost or not.

        Empty for recorded data: their rules need the labels themselves. rows: of the fused scans.
        """
        if not self.episode.simulated:
            return ()
        true_projection = projection_of(rig(self.episode.rig))
        targets = []
        for row in rows.tolist():
            truth = lidar.truths[row]
            image = camera.truths[nearest_image(truth, camera)]
            moved = _moved(true_projection, lidar, row, image.stamp_s - truth.stamp_s)
            targets.append(targets_of(truth, image, lidar.parked, moved))
        return tuple(targets)

    def _inputs(
        self, lidar: EpisodeDetections, camera: EpisodeImageDetections, rows: np.ndarray
    ) -> Iterator[CallInput[float]]:
        """Yield the detections of scans paired with those of images, with the projection."""
        sensing = sensing_of(self.episode) if self.episode.simulated else None
        # Detections in a lost (black) image say nothing about the scene.
        usable = [
            detections
            for detections, image in zip(camera.detections, camera.rows.tolist(), strict=True)
            if detections is not None and (sensing is None or not sensing.image_lost(image))
        ]
        scan_s = np.array([lidar.truths[row].stamp_s for row in rows])
        nearest = _nearest_images(scan_s, np.array([d.stamp_s for d in usable]))
        projections = believed_projections(self.episode, len(rows))
        if self.calibration and projections:
            calibration = fitting_calibration(self.calibration, projections[0])
            projections = [calibration] * len(rows)
        for row, image, believed in zip(rows.tolist(), nearest.tolist(), projections, strict=True):
            truth = lidar.truths[row]
            boxes = None if image == ALONE or self.alone == LIDAR_ALONE else usable[image]
            scan_lost = sensing is not None and sensing.scan_lost(row)
            no_scan = scan_lost or self.alone == CAMERA_ALONE
            points = lidar.detections[row].moved(truth.world_from_ego.inverse(), "ego")
            gap_s = 0.0 if boxes is None else boxes.stamp_s - truth.stamp_s
            projection = _moved(believed, lidar, row, gap_s)
            arguments = (None if no_scan else points, boxes, projection)
            yield CallInput(arguments, truth.stamp_s, call=not (no_scan and boxes is None))


@dataclass(frozen=True)
class FusedDetectionNode(Node):
    """Fused detections of all scans as those of a detector; targets without a box are left out.

    Times are the sum of both detectors and the fusion.
    """

    fusion: FusionNode

    stage = "fusions"
    folder = "detections"
    record = EpisodeDetections

    @property
    def episode(self) -> Episode:
        """The episode."""
        return self.fusion.episode

    def compute(self, options: RunOptions) -> EpisodeDetections:
        """Select the targets with a box in space."""
        fusions: EpisodeFusions = self.fusion.read(options)
        lidar: EpisodeDetections = self.fusion.lidar.read(options)
        camera: EpisodeImageDetections = self.fusion.camera.read(options)
        scans = max(len(fusions.rows), 1)
        return replace(
            lidar,
            detections=tuple(
                fused.detections().moved(truth.world_from_ego, "world")
                for fused, truth in zip(fusions.fused, lidar.truths, strict=True)
            ),
            times=(lidar.times + fusions.times).shifted(
                float(camera.times.processor_ms.sum()) / scans,
                float(camera.times.wall_ms.sum()) / scans,
            ),
        )


def detection_node(source: Spec, episode: Episode, rule: Eligibility) -> Node:
    """Return the node of a source of detections in space, `references.detection_source`."""
    if source.kind == FUSED:
        return FusedDetectionNode(FusionNode.of(source, episode, rule))
    return DetectionNode(source, episode, rule)


def fitting_calibration(path: str, rig_projection: Projection) -> Projection:
    """Read a calibration; raise `ValueError` if it is for images of another size than the rig's."""
    calibration = read_calibration(path)
    width, height = rig_projection.width, rig_projection.height
    if (calibration.width, calibration.height) != (width, height):
        raise ValueError(
            f"{path}: is for images of {calibration.width} x {calibration.height} pixels, the "
            f"rig's have {width} x {height}"
        )
    return calibration


def _nearest_images(scan_s: np.ndarray, image_s: np.ndarray) -> np.ndarray:
    try:
        return nearest_images(scan_s, image_s)
    except ClocksApartError:
        # The clocks of an episode agree, so the images near these few scans are lost.
        return np.full(len(scan_s), ALONE)


def _moved(projection: Projection, lidar: EpisodeDetections, row: int, gap_s: float) -> Projection:
    """Return the projection gap_s seconds after a scan, moved by the ego's true motion."""
    truths = lidar.truths
    if len(truths) < 2:
        return projection
    before, now = truths[max(row, 1) - 1], truths[max(row, 1)]
    motion: Pose = before.world_from_ego.inverse() @ now.world_from_ego
    return moved_projection(projection, motion, now.stamp_s - before.stamp_s, gap_s)


def nearest_image(truth: Truth, camera: EpisodeImageDetections) -> int:
    """Return which image of a record, lost or not, is nearest in time to a scan."""
    image_s = np.array([image.stamp_s for image in camera.truths])
    return int(np.abs(image_s - truth.stamp_s).argmin())


def rows_in_both(truth: Truth, image: Truth) -> np.ndarray:
    """Return (R,) int64, the rows of a scan's objects that the truth of its image has too."""
    return np.flatnonzero(np.isin(truth.ids, image.ids))


def targets_of(
    truth: Truth, image: Truth, parked: np.ndarray, projection: Projection
) -> FusionTargets:
    """Return the objects in a scan and its image, in the order of `rows_in_both`.

    (P, 2) parked cars come last, not eligible.

    Eligible are objects in the image, 3 to 60 m away, less than nine tenths hidden, with at least 5
    returns, or with 60 visible pixels and a height of 12.
    """
    assert image.image_boxes is not None
    row_in_image = {int(identity): row for row, identity in enumerate(image.ids)}
    rows = rows_in_both(truth, image)
    image_rows = np.array([row_in_image[int(truth.ids[k])] for k in rows], np.int64)
    centres = truth.world_from_ego.inverse().apply(truth.centres[rows])
    boxes = image.image_boxes[image_rows]
    sides = boxes[:, 2:] - boxes[:, :2]
    in_image = (sides > LEAST_SIDE_PX).all(axis=1)
    in_image &= image.occluded_fraction[image_rows] < MOST_HIDDEN
    by_camera = image.visible_pixels[image_rows] >= LEAST_PIXELS
    by_camera &= sides[:, 1] >= LEAST_HEIGHT_PX
    by_lidar = truth.lidar_returns[rows] >= LEAST_RETURNS
    ranges = np.hypot(centres[:, 0], centres[:, 1])
    eligible = in_image & (by_camera | by_lidar) & (ranges >= NEAREST_M) & (ranges <= FARTHEST_M)
    cars = truth.world_from_ego.inverse().apply(
        np.column_stack([parked, np.full(len(parked), PARKED_SIZE_M[2] / 2)])
    )
    n = len(cars)
    car_boxes, _ = projected_boxes(
        Detections(
            cars,
            np.tile(PARKED_SIZE_M, (n, 1)),
            np.zeros(n),
            np.zeros(n, np.int8),
            np.ones(n),
            "ego",
            truth.stamp_s,
        ),
        projection,
    )
    return FusionTargets(
        np.concatenate([families_of(truth.categories[rows]), np.zeros(n, np.int64)]),
        np.concatenate([centres, cars]),
        np.concatenate([boxes, car_boxes]),
        np.concatenate([eligible, np.zeros(n, bool)]),
        np.concatenate([image.occluded_fraction[image_rows], np.zeros(n)]),
    )
