"""The exact likelihood of what a sweep measured near a car, for any pose and body of the car.

Every ray counts: one with a return by its range, one without by its silence. The model is that of
the simulated LiDAR: range noise, lost returns, a limit of detection.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.papers.zhang2017_scene import FRAME_S, SensedDrive, sensor_path
from roadscope.core.jit import compiled
from roadscope.envs.sensors.lidar_spec import LidarSpec
from roadscope.envs.world.saloon_body import HEIGHT_M, LENGTH_M, WIDTH_M

PRIOR_M, PRIOR_RAD = 0.6, np.radians(15.0)
"""The prior is flat this far around the truth, so that half a turn is no second answer. Chosen by
hand."""
REACH_M = float(np.hypot(LENGTH_M, WIDTH_M)) / 2 + PRIOR_M
"""No point of the car is farther from its true centre."""
GROUND_REFLECTIVITY = 0.15
"""Of the road in the simulated scans."""
IMPOSSIBLE = -60.0
"""Log-likelihood of a return that no surface can have sent. It is finite, so that many bad poses
can be compared."""
CERTAIN_SDS = 11.0
"""A return this many standard deviations below the greatest range is never lost for being beyond
it."""


class SweepRays(NamedTuple):
    """C columns with B beams that may meet the car, in the car's true frame at their own time.

    origins: (C, 2) metres. directions: (C, 2) horizontal unit vectors.
    height_m: of the sensor above the ground.
    slopes, cosines: (B,) tangent and cosine of the elevation of each beam.
    observed_m: (C, B) measured range, 0 for no return.
    """

    origins: np.ndarray
    directions: np.ndarray
    height_m: float
    slopes: np.ndarray
    cosines: np.ndarray
    observed_m: np.ndarray


class PrismBodies(NamedTuple):
    """G bodies of M upright prisms each; they differ only in their footprints.

    planes: (G, M, 12, 3) sides of the footprints as (a, b, c) with a x + b y <= c inside.
    corner_counts: (G, M) how many of the 12 sides are used.
    heights_m: (M, 2) bottom and top. reflectivities: (M,).
    boxes: (M, 4) centre x, y and half extents of what holds all G footprints.
    """

    planes: np.ndarray
    corner_counts: np.ndarray
    heights_m: np.ndarray
    reflectivities: np.ndarray
    boxes: np.ndarray


class Receiver(NamedTuple):
    """What the LiDAR makes of an echo.

    range_sd_m: noise. farthest_m: greatest range. dropout: share of returns that are lost.
    detection_limit: least signal at the greatest range; it falls with the squared distance.
    log_returned, log_lost: logarithms of the probabilities that an echo is returned, and lost.
    """

    range_sd_m: float
    farthest_m: float
    dropout: float
    detection_limit: float
    log_returned: float
    log_lost: float


class CandidateStates(NamedTuple):
    """N poses and bodies.

    offsets: (N, 3) x, y (metres) and yaw (radians) off the true pose, in the car's true frame.
    bodies: (N,) rows of `PrismBodies`.
    """

    offsets: np.ndarray
    bodies: np.ndarray


class EmptyRoad(NamedTuple):
    """What the rays measure without a car.

    distances_m, signals: (B,) horizontal distance to the ground and its echo; inf and 0 for none.
    log_chances: (C, B) of what was measured. column_sums: (C,) of them.
    """

    distances_m: np.ndarray
    signals: np.ndarray
    log_chances: np.ndarray
    column_sums: np.ndarray


class RayLine(NamedTuple):
    """A ray seen from above, in the frame of the body: a point and a unit direction, metres."""

    x: float
    y: float
    direction_x: float
    direction_y: float


class Beam(NamedTuple):
    """Height of the sensor (metres), tangent and cosine of the elevation."""

    height_m: float
    slope: float
    cosine: float


class Echo(NamedTuple):
    """Horizontal distance to a surface (metres) and how much it sends back."""

    distance_m: float
    signal: float


class Crossings(NamedTuple):
    """Footprints that a line crosses, at most M.

    entries_m, exits_m: where the line enters and leaves. cosines: of the incidence at the entry.
    prisms: rows of the prisms.
    """

    entries_m: np.ndarray
    exits_m: np.ndarray
    cosines: np.ndarray
    prisms: np.ndarray


class FrameLikelihood(NamedTuple):
    """A frame's rays, the prisms that they can meet, and the receiver."""

    rays: SweepRays
    bodies: PrismBodies
    receiver: Receiver

    def log_density(self, states: CandidateStates) -> np.ndarray:
        """Return the (N,) logarithm of likelihood times prior."""
        beyond = np.abs(states.offsets) / (PRIOR_M, PRIOR_M, PRIOR_RAD)
        out: np.ndarray = -1e3 * np.maximum(beyond.max(axis=1) - 1.0, 0.0)
        add_log_likelihoods(states, self.rays, self.bodies, self.receiver, out)
        return out

    def thinned(self, stride: int) -> FrameLikelihood:
        """Return the likelihood with one of every `stride` columns."""
        rows, rays = slice(stride // 2, None, stride), self.rays
        return self._replace(
            rays=rays._replace(
                origins=rays.origins[rows],
                directions=rays.directions[rows],
                observed_m=rays.observed_m[rows],
            )
        )


def frame_likelihood(run: SensedDrive, frame: int, bodies: PrismBodies) -> FrameLikelihood:
    """Return the likelihood of one frame for poses near the car's true pose."""
    rays = rays_of(run, frame)
    heights = _heights_near_car(rays.origins, run.sensor_height_m, rays.slopes)
    low, high = heights.min(axis=1)[:, None], heights.max(axis=1)[:, None]
    may_meet = (low < bodies.heights_m[:, 1]) & (high > bodies.heights_m[:, 0])
    prisms = may_meet.any(axis=0)
    parts = PrismBodies(
        np.ascontiguousarray(bodies.planes[:, prisms]),
        np.ascontiguousarray(bodies.corner_counts[:, prisms]),
        bodies.heights_m[prisms],
        bodies.reflectivities[prisms],
        bodies.boxes[prisms],
    )
    return FrameLikelihood(rays, parts, receiver_of(run.spec))


def rays_of(run: SensedDrive, frame: int) -> SweepRays:
    """Return the rays of a frame that may meet the car, in the frame of its true pose."""
    shot, spec = run.sweeps[frame], run.spec
    stamps = np.full(spec.columns, FRAME_S * frame)
    if run.drive.rolling:
        stamps = stamps + spec.column_offsets_s()
    car = run.drive.car(stamps)
    rotations, positions = sensor_path(run.drive, run.sensor_height_m, shot.phase)(stamps)
    azimuths = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]) + spec.azimuths() - car[:, 2]
    cos, sin = np.cos(car[:, 2]), np.sin(car[:, 2])
    dx, dy = (positions[:, :2] - car[:, :2]).T
    origins = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx])
    directions = np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    columns = np.flatnonzero(_columns_near_car(origins, directions))
    slopes = np.tan(spec.elevations)
    heights = _heights_near_car(origins[columns], run.sensor_height_m, slopes)
    beams = np.flatnonzero((heights.max(axis=1) > 0.0) & (heights.min(axis=1) < HEIGHT_M))
    observed_m = np.zeros((spec.columns, spec.beams))
    points = shot.scan.points.astype(np.float64)
    observed_m[shot.scan.column, shot.scan.ring] = np.linalg.norm(points, axis=1)
    return SweepRays(
        origins[columns],
        directions[columns],
        run.sensor_height_m,
        slopes[beams],
        np.cos(spec.elevations[beams]),
        np.ascontiguousarray(observed_m[np.ix_(columns, beams)]),
    )


def _heights_near_car(origins: np.ndarray, height_m: float, slopes: np.ndarray) -> np.ndarray:
    """Return (B, 2) heights of the beams at the nearest and at the farthest place of the car."""
    distances = np.linalg.norm(origins, axis=1)
    ends = np.array([max(distances.min() - REACH_M, 0.1), distances.max() + REACH_M])
    heights: np.ndarray = height_m + np.outer(slopes, ends)
    return heights


def _columns_near_car(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return (C,) bool, which lines come near the car's box for some pose within the prior."""
    turns = np.array([-PRIOR_RAD, 0.0, PRIOR_RAD])
    cos, sin = np.cos(turns)[:, None], np.sin(turns)[:, None]
    x, y = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]).T * np.array([[LENGTH_M], [WIDTH_M]]) / 2
    corners = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1).reshape(-1, 2)
    offsets = corners[None] - origins[:, None]
    across = offsets[..., 0] * directions[:, 1:] - offsets[..., 1] * directions[:, :1]
    ahead = (offsets * directions[:, None]).sum(axis=2).max(axis=1) > -PRIOR_M
    near: np.ndarray = ahead & (across.min(axis=1) < PRIOR_M) & (across.max(axis=1) > -PRIOR_M)
    return near


def receiver_of(spec: LidarSpec) -> Receiver:
    """Return what a LiDAR makes of an echo."""
    return Receiver(
        spec.range_noise_m,
        spec.range_max_m,
        spec.dropout,
        spec.detection_limit,
        math.log1p(-spec.dropout),
        max(math.log(spec.dropout), IMPOSSIBLE) if spec.dropout > 0.0 else IMPOSSIBLE,
    )


@compiled()
def add_log_likelihoods(
    states: CandidateStates,
    rays: SweepRays,
    bodies: PrismBodies,
    receiver: Receiver,
    out: np.ndarray,
) -> None:
    """Add to `out` (N,) the log-likelihood of each candidate.

    The density of a range is taken relative to its greatest value, 1 / (sd sqrt(2 pi)), which all
    candidates share.
    """
    road = _empty_road(rays, receiver)
    prisms = len(bodies.heights_m)
    crossings = Crossings(
        np.empty(prisms), np.empty(prisms), np.empty(prisms), np.empty(prisms, np.int64)
    )
    for n in range(len(states.offsets)):
        cos, sin = math.cos(states.offsets[n, 2]), math.sin(states.offsets[n, 2])
        total = 0.0
        for c in range(len(rays.origins)):
            x = rays.origins[c, 0] - states.offsets[n, 0]
            y = rays.origins[c, 1] - states.offsets[n, 1]
            u, v = rays.directions[c, 0], rays.directions[c, 1]
            line = RayLine(
                cos * x + sin * y, cos * y - sin * x, cos * u + sin * v, cos * v - sin * u
            )
            total += road.column_sums[c]
            nearest_m, count = _cross_footprints(line, bodies, states.bodies[n], crossings)
            if count == 0:
                continue
            for b in range(len(rays.slopes)):
                if nearest_m < road.distances_m[b]:
                    beam = Beam(rays.height_m, rays.slopes[b], rays.cosines[b])
                    behind = Echo(road.distances_m[b], road.signals[b])
                    echo = _nearest_echo(beam, bodies, crossings, count, behind)
                    if echo.distance_m < behind.distance_m:
                        range_m = echo.distance_m / beam.cosine
                        observed_m = rays.observed_m[c, b]
                        chance = _log_chance(observed_m, range_m, echo.signal, receiver)
                        total += chance - road.log_chances[c, b]
        out[n] += total


@compiled()
def _empty_road(rays: SweepRays, receiver: Receiver) -> EmptyRoad:
    beams, columns = len(rays.slopes), len(rays.observed_m)
    road = EmptyRoad(
        np.full(beams, np.inf), np.zeros(beams), np.empty((columns, beams)), np.zeros(columns)
    )
    for b in range(beams):
        slope, cosine = rays.slopes[b], rays.cosines[b]
        if slope < 0.0:
            road.distances_m[b] = -rays.height_m / slope
            road.signals[b] = -GROUND_REFLECTIVITY * slope * cosine
        range_m = road.distances_m[b] / cosine
        for c in range(columns):
            observed_m = rays.observed_m[c, b]
            road.log_chances[c, b] = _log_chance(observed_m, range_m, road.signals[b], receiver)
            road.column_sums[c] += road.log_chances[c, b]
    return road


@compiled(borrowing=True)
def _cross_footprints(
    line: RayLine, bodies: PrismBodies, body: int, crossings: Crossings
) -> tuple[float, int]:
    """Fill `crossings`; return the nearest entry and how many footprints are crossed."""
    nearest_m, count = np.inf, 0
    for m in range(len(bodies.heights_m)):
        box = bodies.boxes[m]
        across = abs((box[0] - line.x) * line.direction_y - (box[1] - line.y) * line.direction_x)
        if across > abs(line.direction_y) * box[2] + abs(line.direction_x) * box[3]:
            continue
        entry_m, exit_m, cosine = _clipped(line, bodies, body, m)
        if entry_m < np.inf:
            crossings.entries_m[count], crossings.exits_m[count] = entry_m, exit_m
            crossings.cosines[count], crossings.prisms[count] = cosine, m
            nearest_m, count = min(nearest_m, entry_m), count + 1
    return nearest_m, count


@compiled(borrowing=True)
def _clipped(
    line: RayLine, bodies: PrismBodies, body: int, prism: int
) -> tuple[float, float, float]:
    """Return entry and exit of a line through a footprint, and the cosine at the entry.

    The entry is inf where the line passes by or begins inside.
    """
    entry_m, exit_m, cosine = -np.inf, np.inf, 0.0
    for k in range(bodies.corner_counts[body, prism]):
        a, b = bodies.planes[body, prism, k, 0], bodies.planes[body, prism, k, 1]
        distance = bodies.planes[body, prism, k, 2] - a * line.x - b * line.y
        approach = a * line.direction_x + b * line.direction_y
        if approach < 0.0:
            if distance < entry_m * approach:
                entry_m, cosine = distance / approach, -approach
        elif approach > 0.0:
            if distance < exit_m * approach:
                exit_m = distance / approach
        elif distance < 0.0:
            return np.inf, np.inf, 0.0
        if entry_m >= exit_m:
            return np.inf, np.inf, 0.0
    if entry_m > 0.0:
        return entry_m, exit_m, cosine
    return np.inf, np.inf, 0.0


@compiled(borrowing=True)
def _nearest_echo(
    beam: Beam, bodies: PrismBodies, crossings: Crossings, count: int, behind: Echo
) -> Echo:
    """Return the echo of the nearest surface of the body, or of what is behind it."""
    distance_m, signal = behind.distance_m, behind.signal
    for i in range(count):
        surface_m, prism = crossings.entries_m[i], crossings.prisms[i]
        if surface_m >= distance_m:
            continue
        incidence = crossings.cosines[i] * beam.cosine
        height = beam.height_m + beam.slope * surface_m
        bottom, top = bodies.heights_m[prism, 0], bodies.heights_m[prism, 1]
        if height > top or height < bottom:
            # The ray passes above or below the side: it may meet the lid or the floor.
            edge = top if height > top else bottom
            surface_m = (edge - beam.height_m) / beam.slope if beam.slope != 0.0 else np.inf
            incidence = abs(beam.slope) * beam.cosine
            if not crossings.entries_m[i] <= surface_m < crossings.exits_m[i]:
                continue
        if surface_m < distance_m:
            distance_m, signal = surface_m, incidence * bodies.reflectivities[prism]
    return Echo(distance_m, signal)


@compiled(borrowing=True)
def _log_chance(observed_m: float, range_m: float, signal: float, receiver: Receiver) -> float:
    """Return the log-likelihood of a measured range, 0 for none, given the true echo."""
    far = receiver.farthest_m
    visible = range_m < far and signal * far**2 >= receiver.detection_limit * range_m**2
    if observed_m > 0.0:
        if not visible:
            return IMPOSSIBLE
        error = (observed_m - range_m) / receiver.range_sd_m
        return max(receiver.log_returned - 0.5 * error * error, IMPOSSIBLE)
    if not visible:
        return 0.0
    margin = (far - range_m) / receiver.range_sd_m
    if margin > CERTAIN_SDS:
        return receiver.log_lost
    beyond = 0.5 * math.erfc(margin / math.sqrt(2.0))
    chance = receiver.dropout + (1.0 - receiver.dropout) * beyond
    return max(math.log(chance), IMPOSSIBLE) if chance > 0.0 else IMPOSSIBLE
