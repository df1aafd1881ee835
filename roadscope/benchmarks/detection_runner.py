"""Runs a detector on a folder of scans, and writes what it detects."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.benchmarks.cache import FolderError, usable_folder
from roadscope.benchmarks.formats.kitti_frames import (
    CAMERA_FROM_EGO,
    LabelCamera,
    kitti_results,
)
from roadscope.benchmarks.formats.kitti_labels import write_kitti_object_results
from roadscope.benchmarks.formats.scan_folder import ScanFolder
from roadscope.benchmarks.formats.table import visible
from roadscope.benchmarks.isolation import Limits, PluginError, open_plugin
from roadscope.benchmarks.references import (
    check_detection_source,
    made_from_truth,
)
from roadscope.benchmarks.travel import turned_scan
from roadscope.core import Calibration, Category, Detections, Frame, Pose, Spec, SpecError
from roadscope.core.answers import AnswerError, check_detections, same_stamp
from roadscope.core.fused import FusedDetections
from roadscope.odometry.above_ground import sensor_height

DEFAULT_DETECTOR = "distance-l-shape"
LIMITS = Limits(episode_s=float("inf"))
"""A recording may be of any length."""
LIDAR = "lidar"
"""The name of the LiDAR in `Calibration`, as `ScanFolder` has it."""
HEIGHT_SCANS = 20
"""Most scans by which the height of the LiDAR is estimated."""
LABELS, RESULTS = "labels", "detections.json"
"""Where detections are written: a folder with a label file for each frame, and a file with all."""


def detector_of(text: str) -> Spec:
    """Return the resolved spec of a detector that runs on recorded scans; others are refused."""
    spec = check_detection_source(text)
    if made_from_truth(spec):
        raise SpecError(f"{text} is made from the truth: it can run only on boards")
    return spec


def height_above_ground(scans: ScanFolder, rotation: np.ndarray) -> float | None:
    """Return the median height of the LiDAR in metres; None where no ground is visible.

    rotation: (3, 3), brings the LiDAR's axes to x ahead, y left, z up.
    """
    rows = np.unique(np.linspace(0, len(scans) - 1, HEIGHT_SCANS).round().astype(int))
    some = (scan for row in rows.tolist() for scan in scans.part(row, row + 1))
    heights = np.array([sensor_height(turned_scan(scan, rotation).points) for scan in some])
    finite = heights[np.isfinite(heights)]
    return float(np.median(finite)) if len(finite) else None


def scan_detections(
    scans: ScanFolder,
    detector: Spec,
    ego_from_lidar: Pose,
    *,
    poses: Sequence[np.ndarray | None] = (),
) -> Iterator[tuple[int, Detections]]:
    """Yield the number of a scan and the detections in it, ego frame, scan by scan.

    A detector that answers late has an empty answer for a scan first, and then another one.
    A plug-in that fails raises `PluginError`. One that is not part of roadscope runs in a process
    of its own, without a time limit for the whole recording.

    poses: `start_from_lidar`, (4, 4), of each scan, for detectors that use the ego's motion.
    """
    calibration = Calibration(((LIDAR, ego_from_lidar),))
    stamps_s: list[float] = []
    answered: list[Detections] = []
    with open_plugin(detector.plain, limits=LIMITS) as plugin:
        plugin.call("reset")
        for now, scan in enumerate(scans):
            motion = _motion(poses[now - 1 : now + 1], ego_from_lidar) if now else None
            frame = Frame(scan.stamp_s, calibration, lidar=scan, previous_from_ego=motion)
            stamps_s.append(scan.stamp_s)
            answered.append(Detections.empty(scan.stamp_s))
            with warnings.catch_warnings():
                # Warnings of plug-ins are not shown to the reader.
                warnings.simplefilter("ignore")
                answer = plugin.call("detect", frame).answer
            try:
                detections = check_detections(answer, stamps_s=stamps_s)
                row = _row_of(detections, stamps_s, answered)
            except AnswerError as error:
                raise PluginError(str(detector), str(error), plugin.log) from error
            answered[row] = detections
            if row != now:
                yield now, answered[now]
            yield row, detections


def _row_of(
    detections: Detections, stamps_s: Sequence[float], answered: Sequence[Detections]
) -> int:
    """Return the scan that is answered; raise `AnswerError` if it had detections already."""
    if detections.frame != "ego":
        raise AnswerError(f"detections in frame '{detections.frame}'; possible here: ego")
    rows = range(len(stamps_s) - 1, -1, -1)
    row = next(k for k in rows if same_stamp(detections.stamp_s, stamps_s[k]))
    if len(answered[row]):
        raise AnswerError(f"two answers to the frame at {stamps_s[row]:.6g} s")
    return row


def _motion(poses: Sequence[np.ndarray | None], ego_from_lidar: Pose) -> Pose | None:
    """Return `previous_from_ego` of the poses of the last scan and of this one, if known."""
    if len(poses) < 2 or poses[0] is None or poses[1] is None:
        return None
    previous_from_now = Pose(poses[0]).inverse() @ Pose(poses[1])
    return ego_from_lidar @ previous_from_now @ ego_from_lidar.inverse()


# --------------------------------------------------------------------------------------------------
# Files of results.


@dataclass(frozen=True, slots=True)
class DetectedFrame:
    """What was detected at one moment.

    name: of the scan or image, without ending. problem: why it could not be read, or "".
    """

    name: str
    stamp_s: float
    detections: FusedDetections
    problem: str = ""


@dataclass(frozen=True, slots=True)
class ResultWriter:
    """Writes detections to a folder: a label file for each frame, and one JSON file.

    camera: in whose frame label files are.
    ego_from_lidar: boxes in the JSON file are in the LiDAR's own axes; None without a LiDAR.
    """

    folder: Path
    camera: LabelCamera
    ego_from_lidar: Pose | None

    @staticmethod
    def open(
        folder: Path, names: Sequence[str], ego_from_lidar: Pose, camera: LabelCamera | None = None
    ) -> ResultWriter:
        """Make the folder; refuse one with labels of other frames than these.

        camera: None puts one at the LiDAR, with the axes of KITTI's cameras.
        """
        labels = usable_folder(usable_folder(folder) / LABELS)
        others = {path.stem for path in visible(labels, "*.txt")} - set(names)
        if others:
            raise FolderError(
                f"{labels} has labels of other scans, such as {min(others)}.txt: name another "
                "folder, --out DIR"
            )
        at_lidar = LabelCamera(
            CAMERA_FROM_EGO @ Pose.from_parts(np.eye(3), -ego_from_lidar.translation)
        )
        return ResultWriter(folder, camera or at_lidar, ego_from_lidar)

    def write(self, frames: Sequence[DetectedFrame], about: Mapping[str, Any]) -> None:
        """Write all files. about: what else the JSON file says, before its frames."""
        for frame in frames:
            rows = kitti_results(frame.detections, self.camera)
            write_kitti_object_results(self.folder / LABELS / f"{frame.name}.txt", rows)
        content = {**about, "frames": [self._content(frame) for frame in frames]}
        text = json.dumps(content, indent=1, allow_nan=False)
        (self.folder / RESULTS).write_text(f"{text}\n", encoding="utf-8")

    def _content(self, frame: DetectedFrame) -> dict[str, Any]:
        """Return a frame as a dictionary that JSON can hold."""
        fused = frame.detections
        boxes = fused.detections()
        if self.ego_from_lidar is not None:
            boxes = boxes.moved(self.ego_from_lidar.inverse(), LIDAR)
        rows = np.cumsum(fused.has_box) - 1
        listed = []
        for k, category in enumerate(fused.categories.tolist()):
            each: dict[str, Any] = {
                "category": Category(category).name.lower(),
                "score": float(fused.scores[k]),
            }
            if fused.has_box[k]:
                each["centre_m"] = boxes.centres[rows[k]].tolist()
                each["size_m"] = boxes.sizes[rows[k]].tolist()
                each["yaw_rad"] = float(boxes.yaws[rows[k]])
            if fused.has_image_box[k]:
                each["image_box_px"] = fused.image_boxes[k].tolist()
            listed.append(each)
        problem = {"problem": frame.problem} if frame.problem else {}
        return {"name": frame.name, "stamp_s": frame.stamp_s, **problem, "detections": listed}
