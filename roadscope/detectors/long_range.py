"""Moving vehicles and their poses from sparse returns (Zhang 2017), as detectors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core import Category, Detections, Frame, Pose
from roadscope.detectors.moving import Memory, extract
from roadscope.detectors.moving.links import Chain, Links
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.pose.matched_filter import fit_single
from roadscope.detectors.pose.multi_frame import fit_multi
from roadscope.detectors.pose.ransac import fit_ransac
from roadscope.detectors.shape.bodies import BODIES, Body

FITS = ("single", "multi", "ransac")
MOST_POINTS = 150
"""Returns that a fit is given: more, on a near vehicle, tell it nothing new."""
FRAMES = 3
VEHICLES = (Category.CAR, Category.VAN, Category.TRUCK, Category.MOTORCYCLE)
RIDER_M = 1.3
"""Height that a rider reaches and a corner of a car does not."""


class LongRangeDetector:
    """Finds vehicles that move, and fits a usual one of their size to each.

    What stands is not found, by design: `moving` says what counts as moving. A vehicle is
    reported from its second sighting on. The paper's filter knows the vehicle's size; here it is
    the usual car's, or of the smallest usual body that has room for what is seen.
    """

    def __init__(self, *, fit: str = "single", late: bool = False) -> None:
        """Name the fit.

        fit: `single` and `ransac` fit one scan, `multi` three in a row.
        late: answer each frame in the next one, `multi` then fits the middle of its three as the
            paper does; otherwise it fits the newest.
        """
        if fit not in FITS:
            raise ValueError(f"no fit '{fit}'; known: {', '.join(FITS)}")
        self._fit, self._late = fit, late
        self._memory = Memory()
        self.reset()

    def reset(self) -> None:
        """Forget everything seen."""
        self._memory.reset()
        self._links = Links()
        self._open: tuple[float, Pose] | None = None

    def detect(self, frame: Frame) -> Detections:
        """Return moving vehicles, ego frame, in the frame's scan or, if late, in the last one."""
        memory = self._memory
        if self._open is not None and frame.stamp_s <= memory.stamp_s:
            self.reset()
        memory.add(frame)
        if frame.lidar is None or memory.now is None:
            return Detections.empty(frame.stamp_s)
        before, here = self._open, (frame.stamp_s, memory.drive_from_ego)
        self._open = here
        self._links.update(frame.stamp_s, extract(memory.now, memory.back()), here[1])
        asked = before if self._late else here
        if asked is None:
            return Detections.empty(frame.stamp_s)
        found = [_found(chain, *asked, self._fit) for chain in self._links.chains]
        return _detections([f for f in found if f is not None], asked[0])


class Found(NamedTuple):
    """A vehicle in the ego frame at the stamp that is answered."""

    centre: tuple[float, float, float]
    yaw: float
    size: tuple[float, float, float]
    category: Category
    score: float


def _found(chain: Chain, stamp_s: float, drive_from_ego: Pose, fit: str) -> Found | None:
    """Return a chain's vehicle at a stamp, None when it was not seen then or does not move."""
    rows = [k for k, s in enumerate(chain.sightings) if s.stamp_s == stamp_s]
    if not rows or not chain.moves:
        return None
    at = rows[0]
    seen = chain.sightings[at]
    body, size = _usual(chain)
    pose = _posed(chain, at, fit, size)
    # The vehicle was met before or after the stamp and has moved meanwhile.
    place = pose.centre + chain.velocity * (stamp_s - seen.met_s)
    x, y, _ = drive_from_ego.inverse().apply(np.append(place, 0.0))
    sure = 1.0 - np.exp(-seen.candidate.evidence / 6.0)
    score = float(sure * min(chain.count, 5) / 5)
    yaw = pose.yaw - drive_from_ego.yaw
    return Found((x, y, size[2] / 2), yaw, size, body.category, score)


def _posed(chain: Chain, at: int, fit: str, size: tuple[float, float, float]) -> VehiclePose:
    length_m, width_m, _ = size
    first = max(0, min(at - 1, len(chain.sightings) - FRAMES))
    window = chain.sightings[first : first + FRAMES] if fit == "multi" else [chain.sightings[at]]
    points = [_few(s.points[:, :2]) for s in window]
    origins = [s.origin for s in window]
    if len(window) > 1:
        return fit_multi(
            points, origins, [s.met_s for s in window],
            length_m=length_m, width_m=width_m, at=at - first,
        )  # fmt: skip
    if fit == "ransac":
        rng = np.random.default_rng(0)
        return fit_ransac(points[0], origins[0], rng, length_m=length_m, width_m=width_m)
    return fit_single(points[0], origins[0], length_m=length_m, width_m=width_m)


def _few(points: np.ndarray) -> np.ndarray:
    return points[:: -(-len(points) // MOST_POINTS)]


def _usual(chain: Chain) -> tuple[Body, tuple[float, float, float]]:
    """Return the first usual body that has room for what is seen, and its size.

    Two-wheelers come first, and are told by their rider: as narrow a part of a car is low.
    """
    spans = [_spans(s.points[:, :2], chain.velocity) for s in chain.sightings]
    along, across = np.median(spans, axis=0)
    top = max(float(s.points[:, 2].max()) for s in chain.sightings)
    known = [b for b in BODIES if b.category in VEHICLES]
    if top > RIDER_M:
        known.sort(key=lambda body: body.category is not Category.MOTORCYCLE)
    body = next((b for b in known if _room(b, along, across, top)), known[-1])
    return body, (max(body.length[0], float(along)), body.width[0], body.height[0])


def _spans(points: np.ndarray, velocity: np.ndarray) -> tuple[float, float]:
    """Return how far (N, 2) points reach along and across a body that goes about that way."""
    yaws = np.arctan2(velocity[1], velocity[0]) + np.radians(np.arange(-24, 25, 4))
    along = np.ptp(points @ np.stack([np.cos(yaws), np.sin(yaws)]), axis=0)
    across = np.ptp(points @ np.stack([-np.sin(yaws), np.cos(yaws)]), axis=0)
    best = int(np.argmin(along * across))
    return float(along[best]), float(across[best])


def _room(body: Body, along: float, across: float, top: float) -> bool:
    seen = zip((along, across, top), (body.length, body.width, body.height), strict=True)
    return all(extent <= mean + 2 * spread for extent, (mean, spread) in seen)


def _detections(found: list[Found], stamp_s: float) -> Detections:
    if not found:
        return Detections.empty(stamp_s)
    return Detections(
        centres=np.array([f.centre for f in found]),
        sizes=np.array([f.size for f in found]),
        yaws=np.array([f.yaw for f in found]),
        categories=np.array([f.category for f in found], np.int8),
        scores=np.array([f.score for f in found]),
        frame="ego",
        stamp_s=stamp_s,
    )
