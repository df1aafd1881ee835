"""Ground removal, clustering, line extraction and recognition in a row (Lu 2018, figure 3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from roadscope.core import Detections, Frame
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering import CLUSTERINGS, Clustering
from roadscope.detectors.ground import GROUNDS, Ground
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape import SHAPES, Shape, Vehicle
from roadscope.detectors.shape.cluster import clusters


class ClusterDetector:
    """Finds vehicles as clusters of returns with straight outlines."""

    def __init__(
        self,
        *,
        ground: str = "grid",
        clustering: str = "pag",
        shape: str = "iepf",
        distance_m: float = 1.0,
        split_m: float = 0.3,
        residual_m: float | None = None,
        view_deg: float = 110.0,
    ) -> None:
        """Name the stages and their lengths.

        ground, clustering, shape: names in `GROUNDS`, `CLUSTERINGS`, `SHAPES`.
        distance_m: threshold of the clustering `distance`.
        split_m: distance from a line at which the shape `iepf` splits it.
        residual_m: outlines farther from their lines (root mean square) are refused; None
            refuses none, as in the paper.
        view_deg: field of view of a sensor that does not turn fully, the LUX's: what touches
            its ends may go on outside.
        """
        lengths = {
            "distance": {"distance_m": _length("distance_m", distance_m)},
            "iepf": {"split_m": _length("split_m", split_m)},
        }
        self._ground: Ground = _stage("ground", ground, GROUNDS, lengths)
        self._clustering: Clustering = _stage("clustering", clustering, CLUSTERINGS, lengths)
        self._shape: Shape = _stage("shape", shape, SHAPES, lengths)
        self._residual_m = np.inf if residual_m is None else _length("residual_m", residual_m)
        if not 0 < view_deg <= 360:
            raise ValueError(f"view_deg must be above 0 and at most 360 degrees, got {view_deg!r}")
        self._half_view = float(np.radians(view_deg)) / 2

    def reset(self) -> None:
        """Forget nothing: every scan is looked at alone."""

    def detect(self, frame: Frame) -> Detections:
        """Return the vehicles in the frame's scan, ego frame, at the scan's stamp."""
        scan = frame.lidar
        if scan is None:
            return Detections.empty(frame.stamp_s)
        ego_from_lidar = frame.calibration.pose(scan.sensor)
        cloud = Cloud.of(scan, ego_from_lidar)
        standing = self._ground(cloud)
        view = (ego_from_lidar.yaw - self._half_view, ego_from_lidar.yaw + self._half_view)
        horizon, cloud = Horizon.of(cloud, standing, view), cloud.select(standing)
        found = [
            vehicle
            for cluster in clusters(cloud, self._clustering(cloud))
            for vehicle in self._shape(cluster, horizon)
            if vehicle.residual_m <= self._residual_m
        ]
        return _detections(found, scan.stamp_s)


def _detections(vehicles: list[Vehicle], stamp_s: float) -> Detections:
    if not vehicles:
        return Detections.empty(stamp_s)
    sizes = np.array([vehicle.size for vehicle in vehicles])
    places = np.array([vehicle.centre for vehicle in vehicles])
    return Detections(
        centres=np.column_stack([places, sizes[:, 2] / 2]),
        sizes=sizes,
        yaws=np.array([vehicle.yaw for vehicle in vehicles]),
        categories=np.array([vehicle.category for vehicle in vehicles], np.int8),
        scores=np.array([_score(vehicle) for vehicle in vehicles]),
        frame="ego",
        stamp_s=stamp_s,
    )


def _score(vehicle: Vehicle) -> float:
    """Rank by support and straightness: ten points on a line score near 1."""
    return min(1.0, vehicle.points / 10) * float(np.exp(-vehicle.residual_m / 0.3))


def _stage(
    kind: str,
    name: str,
    known: Mapping[str, Callable[..., Any]],
    options: Mapping[str, Mapping[str, float]],
) -> Callable[..., Any]:
    if name not in known:
        raise ValueError(f"no {kind} stage '{name}'; known: {', '.join(known)}")
    return partial(known[name], **options.get(name, {}))


def _length(name: str, value: float) -> float:
    if not 0 < value < np.inf:
        raise ValueError(f"{name} must be a positive length in metres, got {value!r}")
    return value
