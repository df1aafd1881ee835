"""Detectors made of ground removal, clustering and shape (Lu 2018, figure 3), and a score."""

from __future__ import annotations

import inspect
from collections.abc import Sequence

import numpy as np

from roadscope.core import Bounds, Detections, Frame
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering import Clustering
from roadscope.detectors.drops import check_faint, without_faint
from roadscope.detectors.ground import Ground, GroundSurface
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.scoring import scores
from roadscope.detectors.shape import Shape, Vehicle
from roadscope.detectors.shape.cluster import clusters
from roadscope.detectors.stages import Option, chosen_stages, listed


class ClusterDetector:
    """Detects road users as clusters of returns, by any ground removal, clustering and shape."""

    def __init__(
        self,
        *,
        ground: str = "grid",
        clustering: str = "pag",
        shape: str = "iepf",
        min_score: float = 0.0,
        exclusive: bool = False,
        faint: float = 0.0,
        residual_m: float | None = None,
        view_deg: float = 110.0,
        level: bool = True,
        **options: Option | None,
    ) -> None:
        """Choose the stages and set their options.

        ground, clustering, shape: names in `GROUNDS`, `CLUSTERINGS`, `SHAPES`.
        min_score: detections that are less probable are left out.
        exclusive: whether only the more probable one of two boxes is kept if one covers the other's
            centre, because two bodies cannot be in one place.
        faint: returns of less intensity than this within 15 m count as drops of fog or rain and are
            left out (after Park et al. 2020, low-intensity outlier removal).
        residual_m: greatest root mean square distance of an outline from its lines; outlines beyond
            it are left out. None leaves out none, as in the paper.
        view_deg: field of view of a sensor that does not turn fully, by default the LUX's. A body
            at its ends may go on outside.
        level: whether heights are counted from the ground that is estimated around the sensor;
            otherwise from the plane on which the wheels stand, as calibrated.
        options: of the chosen stages, such as `distance_m` of the clustering `distance`. None
            is the stage's own default. Options of stages that are not chosen are refused.
        """
        names = {"ground": ground, "clustering": clustering, "shape": shape}
        stages = chosen_stages(names, options, f"; the detector takes {_own_arguments()}")
        self._ground: Ground = stages["ground"]
        self._clustering: Clustering = stages["clustering"]
        self._shape: Shape = stages["shape"]
        if not 0 <= min_score < 1:
            raise ValueError(f"min_score must be at least 0 and below 1, got {min_score!r}")
        if residual_m is not None and not 0 < residual_m < np.inf:
            raise ValueError(f"residual_m must be a positive length in metres, got {residual_m!r}")
        if not 0 < view_deg <= 360:
            raise ValueError(f"view_deg must be above 0 and at most 360 degrees, got {view_deg!r}")
        self._min_score, self._exclusive, self._faint = min_score, exclusive, check_faint(faint)
        self._residual_m = np.inf if residual_m is None else residual_m
        self._level = level
        self._half_view = float(np.radians(view_deg)) / 2

    def reset(self) -> None:
        """Do nothing: each scan is treated by itself."""

    def detect(self, frame: Frame) -> Detections:
        """Return the road users in the frame's scan, ego frame, at the scan's stamp."""
        if frame.lidar is None:
            return Detections.empty(frame.stamp_s)
        scan = without_faint(frame.lidar, self._faint)
        ego_from_lidar = frame.calibration.pose(scan.sensor)
        cloud = Cloud.of(scan, ego_from_lidar)
        ground = GroundSurface(None, cloud.origin)
        if self._level:
            ground, cloud = GroundSurface.levelled(cloud)
        vehicles, horizon = self.propose(cloud, ego_from_lidar.yaw)
        height_m = float(ego_from_lidar.translation[2] - ground.below(cloud.origin[None])[0])
        probabilities = scores(vehicles, cloud, horizon, height_m)
        rows = np.flatnonzero(probabilities >= self._min_score)
        if self._exclusive:
            rows = rows[exclusive_rows([vehicles[k] for k in rows], probabilities[rows])]
        return _detections([vehicles[k] for k in rows], probabilities[rows], scan.stamp_s, ground)

    def propose(self, cloud: Cloud, yaw: float) -> tuple[list[Vehicle], Horizon]:
        """Return the vehicles in all clusters, before scoring, and the horizon.

        yaw: yaw of the sensor in the ego frame, radians.
        """
        standing, view = self._ground(cloud), Bounds(yaw - self._half_view, yaw + self._half_view)
        horizon, above = Horizon.of(cloud, standing, view), cloud.select(standing)
        vehicles = [
            vehicle
            for cluster in clusters(above, self._clustering(above))
            for vehicle in self._shape(cluster, horizon)
            if vehicle.residual_m <= self._residual_m
        ]
        return vehicles, horizon


def _own_arguments() -> str:
    """Return the detector's own arguments with their defaults, for an error message."""
    parameters = inspect.signature(ClusterDetector).parameters
    return listed({name: p for name, p in parameters.items() if p.kind is p.KEYWORD_ONLY})


def exclusive_rows(vehicles: Sequence[Vehicle], probabilities: np.ndarray) -> np.ndarray:
    """Return the rows, in order, of vehicles that do not collide with a more probable one.

    Two vehicles collide if the footprint of one holds the centre of the other.
    """
    rows: list[int] = []
    for row in np.argsort(-probabilities, kind="stable"):
        one = vehicles[row]
        if not any(_covers(one, vehicles[k]) or _covers(vehicles[k], one) for k in rows):
            rows.append(int(row))
    return np.array(sorted(rows), np.int64)


def _covers(one: Vehicle, other: Vehicle) -> bool:
    """Return whether the footprint of one holds the centre of the other."""
    dx, dy = other.centre[0] - one.centre[0], other.centre[1] - one.centre[1]
    cos, sin = np.cos(one.yaw), np.sin(one.yaw)
    inside = abs(cos * dx + sin * dy) < one.size[0] / 2, abs(cos * dy - sin * dx) < one.size[1] / 2
    return all(inside)


def _detections(
    vehicles: Sequence[Vehicle], probabilities: np.ndarray, stamp_s: float, ground: GroundSurface
) -> Detections:
    if not vehicles:
        return Detections.empty(stamp_s)
    sizes = np.array([vehicle.size for vehicle in vehicles])
    places = np.array([vehicle.centre for vehicle in vehicles])
    return Detections(
        centres=np.column_stack([places, sizes[:, 2] / 2 + ground.below(places)]),
        sizes=sizes,
        yaws=np.array([vehicle.yaw for vehicle in vehicles]),
        categories=np.array([vehicle.category for vehicle in vehicles], np.int8),
        scores=probabilities,
        frame="ego",
        stamp_s=stamp_s,
    )
