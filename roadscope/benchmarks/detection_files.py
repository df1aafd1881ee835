"""Files of what was detected in a recording: KITTI's label files, and one JSON file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.benchmarks.cache import FolderError, usable_folder
from roadscope.benchmarks.detection_runner import CAMERA, LIDAR, DetectedFrame, DetectionJob
from roadscope.benchmarks.formats.kitti_frames import kitti_results
from roadscope.benchmarks.formats.kitti_labels import write_kitti_object_results
from roadscope.benchmarks.formats.table import visible
from roadscope.core import Category, Pose
from roadscope.core.fused import FusedDetections

LABELS, RESULTS = "labels", "detections.json"
"""The folder with a label file for each frame, and the file with all detections."""


@dataclass(frozen=True, slots=True)
class ResultWriter:
    """Writes detections to a folder: a label file for each frame, and one JSON file.

    lidar_from_ego: boxes in the JSON file are in the LiDAR's own axes.
    """

    folder: Path
    lidar_from_ego: Pose

    @staticmethod
    def open(folder: Path, job: DetectionJob) -> ResultWriter:
        """Make the folder; refuse one with labels of other frames than these."""
        labels = usable_folder(usable_folder(folder) / LABELS)
        others = {path.stem for path in visible(labels, "*.txt")} - set(job.names)
        if others:
            raise FolderError(
                f"{labels} has labels of other scans, such as {min(others)}.txt: name another "
                "folder, --out DIR"
            )
        return ResultWriter(folder, job.ego_from_lidar.inverse())

    def write(self, frames: Sequence[DetectedFrame], about: Mapping[str, Any]) -> None:
        """Write all files. about: what else the JSON file says, before its frames."""
        for frame in frames:
            rows = kitti_results(frame.detections, frame.camera)
            write_kitti_object_results(self.folder / LABELS / f"{frame.name}.txt", rows)
        content = {**about, "frames": [self._content(frame) for frame in frames]}
        text = json.dumps(content, indent=1, allow_nan=False)
        (self.folder / RESULTS).write_text(f"{text}\n", encoding="utf-8")

    def _content(self, frame: DetectedFrame) -> dict[str, Any]:
        """Return a frame as a dictionary that JSON can hold."""
        boxes = [
            self._box(frame.detections.select(np.array([k]))) for k in range(len(frame.detections))
        ]
        problems = [frame.problem, "" if frame.fused else "stopped before detections were fused"]
        problem = {"problem": "; ".join(filter(None, problems))} if any(problems) else {}
        return {"name": frame.name, "stamp_s": frame.stamp_s, **problem, "detections": boxes}

    def _box(self, target: FusedDetections) -> dict[str, Any]:
        """Return the only target as a dictionary; what is not known of it is left out."""
        content: dict[str, Any] = {
            "category": Category(int(target.categories[0])).name.lower(),
            "score": float(target.scores[0]),
        }
        if target.has_box[0]:
            box = target.detections().moved(self.lidar_from_ego, LIDAR)
            content["centre_m"], content["size_m"] = box.centres[0].tolist(), box.sizes[0].tolist()
            content["yaw_rad"] = float(box.yaws[0])
        if target.has_image_box[0]:
            content["image_box_px"] = target.image_boxes[0].tolist()
        sensors = {LIDAR: target.by_lidar[0], CAMERA: target.by_camera[0]}
        return {**content, "sensors": [name for name, detected in sensors.items() if detected]}
