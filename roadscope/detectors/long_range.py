"""Moving vehicles and their poses from sparse returns (Zhang 2017), as detectors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from roadscope.core import Category, Detections, Frame
from roadscope.detectors.drops import check_faint, without_faint
from roadscope.detectors.long_range_body import AnsweredScan, body_poses
from roadscope.detectors.long_range_scores import FEATURES, features, shipped_model
from roadscope.detectors.moving import Memory, extract
from roadscope.detectors.moving.lidar import lidar_of
from roadscope.detectors.moving.links import BodySize, Chain, Links, usual
from roadscope.detectors.moving.view import inverse_of
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.pose.matched_filter import fit_multi, fit_single
from roadscope.detectors.pose.ransac import fit_ransac
from roadscope.detectors.shape.bodies import Body

FITS = ("single", "multi", "ransac", "body")
MOST_POINTS = 150
"""Most returns for a fit; more returns of a near vehicle do not improve it."""
FRAMES = 3
"""Sightings that `multi` fits together, as the paper does."""
BIN_M, STEP_DEG = 0.04, 2.0
"""Bins and steps of `multi`. Bins are as wide as the filter's edges, and a parabola gives the angle
between two steps. The paper's bins and steps, half as wide, are not more accurate and take twice as
long."""


class LongRangeDetector:
    """Detects moving vehicles, and fits a typical body of their size to each.

    Standing vehicles are not detected, by design; the package `moving` decides what moves. A
    vehicle is reported from its second sighting on. The paper knows the vehicle's size; here it is
    that of a typical car, or of the smallest typical body that is as large as the returns.
    """

    def __init__(
        self,
        *,
        fit: str = "single",
        late: bool = False,
        min_score: float = 0.0,
        faint: float = 0.0,
        range_noise_m: float | None = None,
        range_max_m: float = 100.0,
        detection_limit: float = 0.4,
    ) -> None:
        """Choose the fit.

        fit: `single` and `ransac` fit one scan, `multi` three in a row, `body` all rays of one.
        late: whether each frame is answered one frame later. `multi` then fits the middle of its
            three scans, as the paper does; otherwise it fits the newest.
        min_score: detections that are less probable are left out.
        faint: returns of less intensity than this within 15 m count as drops of fog or rain and are
            left out, as in `ClusterDetector`.
        range_noise_m, range_max_m, detection_limit: of the LiDAR, as in `LidarSpec`; only `body`
            uses them. With None the noise is estimated from each scan. The default limits are the
            HDL-32E's.
        """
        if fit not in FITS:
            raise ValueError(f"no fit '{fit}'; known: {', '.join(FITS)}")
        if not 0 <= min_score < 1:
            raise ValueError(f"min_score must be at least 0 and below 1, got {min_score!r}")
        self._fit, self._late, self._faint = fit, late, check_faint(faint)
        self._min_score = min_score
        self._figures = _lidar_figures(range_noise_m, range_max_m, detection_limit)
        self._memory = Memory()
        self.reset()

    def reset(self) -> None:
        """Forget all scans."""
        self._memory.reset()
        self._links = Links()
        self._last: AnsweredScan | None = None

    def detect(self, frame: Frame) -> Detections:
        """Return moving vehicles, ego frame, in the frame's scan or, if late, in the last one."""
        vehicles, stamp_s = self.propose(frame)
        values = np.array([v.features for v in vehicles]).reshape(-1, len(FEATURES))
        scores = shipped_model().probabilities(values)
        probable = np.flatnonzero(scores >= self._min_score)
        return detections([vehicles[k] for k in probable], scores[probable], stamp_s)

    def propose(self, frame: Frame) -> tuple[list[MovingVehicle], float]:
        """Return the moving vehicles, before scoring, and the stamp of their scan."""
        if frame.lidar is not None:
            frame = replace(frame, lidar=without_faint(frame.lidar, self._faint))
        memory, scan = self._memory, frame.lidar
        if frame.stamp_s <= memory.stamp_s:
            self.reset()
        memory.add(frame)
        if scan is None or memory.now is None:
            return [], frame.stamp_s
        self._links.update(
            scan.stamp_s, extract(memory.now, memory.earlier_views()), memory.drive_from_ego
        )
        mount = frame.calibration.pose(scan.sensor)
        spec = lidar_of(scan, **self._figures) if self._fit == "body" else None
        answered = AnsweredScan(scan, memory.now, memory.drive_from_ego, mount, spec)
        reported, self._last = (self._last if self._late else answered), answered
        if reported is None:
            return [], scan.stamp_s
        vehicles = _moving_vehicles(self._links.chains, reported, self._fit)
        return vehicles, reported.scan.stamp_s


def _lidar_figures(
    range_noise_m: float | None, range_max_m: float, detection_limit: float
) -> dict[str, Any]:
    """Return the arguments of `lidar_of`; ValueError for one that is impossible."""
    if range_noise_m is not None and not 0 <= range_noise_m < np.inf:
        raise ValueError(f"range_noise_m must be None or from 0 up, got {range_noise_m!r}")
    if not 0 < range_max_m < np.inf:
        raise ValueError(f"range_max_m must be a positive length in metres, got {range_max_m!r}")
    if not 0 <= detection_limit < np.inf:
        raise ValueError(f"detection_limit must be from 0 up, got {detection_limit!r}")
    return {
        "range_noise_m": range_noise_m,
        "range_max_m": range_max_m,
        "detection_limit": detection_limit,
    }


class MovingVehicle(NamedTuple):
    """A vehicle in the ego frame at the stamp of its scan.

    centre, size: metres. yaw: radians. features: (F,), from which its score is computed.
    """

    centre: tuple[float, float, float]
    yaw: float
    size: tuple[float, float, float]
    category: Category
    features: np.ndarray


def _moving_vehicles(
    chains: Sequence[Chain], answered: AnsweredScan, fit: str
) -> list[MovingVehicle]:
    """Return the vehicles of the chains that move and have a sighting in the answered scan."""
    stamp_s, rings = answered.scan.stamp_s, answered.scan.ring
    places = ((c, k) for c in chains for k, s in enumerate(c.sightings) if s.stamp_s == stamp_s)
    moving = [(chain, at) for chain, at in places if chain.moves]
    usuals = usual([chain for chain, _ in moving])
    poses = _poses(moving, answered, fit, usuals)
    # As Python numbers: for single points they are faster than an array.
    ego_from_drive = inverse_of(answered.drive_from_ego).tolist()
    vehicles = []
    for (chain, at), pose, (body, size) in zip(moving, poses, usuals, strict=True):
        sighting = chain.sightings[at]
        values = features(chain, sighting, rings[sighting.candidate.rows], pose)
        height, category = size.height, body.category
        centre, yaw = _in_ego(pose, height, ego_from_drive)
        dimensions = (pose.length, pose.width, height)
        vehicles.append(MovingVehicle(centre, yaw, dimensions, category, values))
    return vehicles


def _poses(
    moving: Sequence[tuple[Chain, int]],
    answered: AnsweredScan,
    fit: str,
    usuals: Sequence[tuple[Body, BodySize]],
) -> list[VehiclePose]:
    """Return a pose for each chain at one of its sightings, in the drive's frame."""
    if fit == "body":
        fitted = body_poses(moving, answered, [body for body, _ in usuals])
    else:
        fitted = [None] * len(moving)
    return [
        pose or _posed(chain, at, fit, size)
        for pose, (chain, at), (_, size) in zip(fitted, moving, usuals, strict=True)
    ]


def _in_ego(
    pose: VehiclePose, height: float, ego_from_drive: list[list[float]]
) -> tuple[tuple[float, float, float], float]:
    """Map a pose from the drive's frame into the ego frame; return its centre and yaw.

    height: height of the vehicle. ego_from_drive: (4, 4). In metres and radians.
    """
    (a, b, _, ahead), (c, d, _, left), *_ = ego_from_drive
    x, y = pose.x * a + pose.y * b + ahead, pose.x * c + pose.y * d + left
    return (x, y, height / 2), pose.yaw + math.atan2(c, a)


def _posed(chain: Chain, at: int, fit: str, size: BodySize) -> VehiclePose:
    """Return the pose of a chain at one of its sightings by the fit with this name."""
    if fit == "multi":
        return _posed_by_window(chain, at, size)
    sighting = chain.sightings[at]
    points, origin = sighting.at_stamp(chain.velocity, most=MOST_POINTS), sighting.origin
    if fit == "ransac":
        rng = np.random.default_rng(0)
        return fit_ransac(points, origin, rng, length_m=size.length, width_m=size.width)
    return fit_single(points, origin, length_m=size.length, width_m=size.width)


def _posed_by_window(chain: Chain, at: int, size: BodySize) -> VehiclePose:
    """Return the pose at a sighting by `fit_multi`, with the sightings around it."""
    first = max(0, min(at - 1, len(chain.sightings) - FRAMES))
    window = chain.sightings[first : first + FRAMES]
    return fit_multi(
        [sighting.at_stamp(chain.velocity, most=MOST_POINTS) for sighting in window],
        [sighting.origin for sighting in window],
        [sighting.stamp_s for sighting in window],
        length_m=size.length,
        width_m=size.width,
        at=at - first,
        bin_m=BIN_M,
        step_deg=STEP_DEG,
    )


def detections(vehicles: Sequence[MovingVehicle], scores: np.ndarray, stamp_s: float) -> Detections:
    """Return vehicles with scores as detections in the ego frame."""
    if not vehicles:
        return Detections.empty(stamp_s)
    return Detections(
        centres=np.array([v.centre for v in vehicles]),
        sizes=np.array([v.size for v in vehicles]),
        yaws=np.array([v.yaw for v in vehicles]),
        categories=np.array([v.category for v in vehicles], np.int8),
        scores=scores,
        frame="ego",
        stamp_s=stamp_s,
    )
