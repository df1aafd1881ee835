"""Measurements and targets of `ExistenceTracker`, and how detections and time change targets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from roadscope.core import Category, Detections
from roadscope.core.jit import compiled
from roadscope.core.tables import ArrayTable
from roadscope.trackers._gating import FAMILIES, boxes_of
from roadscope.trackers._kalman import Gaussians
from roadscope.trackers._traits import DetectorTraits, score_log_odds

# Chosen by hand.
SIZE_MEMORY = 1.0
"""Greatest weight of all earlier detections in the estimate of a size; a detection at range 0 has
the weight 1. It is small because sizes of boxes depend on what is visible."""
HEADING_MEMORY = 0.9
"""Factor of the weight of earlier votes for front or rear with every detection."""


@dataclass(frozen=True, slots=True, eq=False)
class Measurements(ArrayTable):
    """N detections with their errors and their evidence.

    boxes: (N, 7) centre x y z, length width height, yaw.
    categories, scores: as in `Detections`; scores are probabilities where they were learned.
    growths: (N,) factor of all standard deviations, 1 at range 0.
    errors: (N, 2, 2) m2, covariances of the part of position errors that is independent in every
        tick. offsets: (N, 2, 2) m2, of the part that is correlated over time.
    heading_variances: (N,) rad2, of the part of heading errors that is independent in every tick.
    evidence: (N,) log odds that detections are right, from their scores alone.
    """

    boxes: np.ndarray
    categories: np.ndarray
    scores: np.ndarray
    growths: np.ndarray
    errors: np.ndarray
    offsets: np.ndarray
    heading_variances: np.ndarray
    evidence: np.ndarray

    @staticmethod
    def of(
        detections: Detections,
        origin: np.ndarray,
        traits: DetectorTraits,
        noise: float = 1.0,
        probabilities: np.ndarray | None = None,
    ) -> Measurements:
        """Return the measurements of detections.

        origin: (2,) position of the sensor, in the frame of the detections.
        noise: factor of the covariances of positions.
        probabilities: (N,) that detections are right; None to compute them from traits and scores.
        """
        categories, boxes = detections.categories, boxes_of(detections)
        ranges_m = np.hypot(boxes[:, 0] - origin[0], boxes[:, 1] - origin[1])
        growths = 1 + traits.growth_per_m[categories] * ranges_m
        errors = noise * oriented_covariances(
            np.ascontiguousarray(boxes[:, 6]),
            traits.along_m[categories] * growths,
            traits.across_m[categories] * growths,
        )
        lasting = traits.lasting[categories, None, None]
        if probabilities is None:
            scores, odds = detections.scores, score_log_odds(detections.scores)
            evidence = traits.detection_log_odds(odds, categories, ranges_m)
        else:
            scores, evidence = probabilities, score_log_odds(probabilities)
        return Measurements(
            boxes=boxes,
            categories=categories,
            scores=scores,
            growths=growths,
            errors=(1 - lasting) * errors,
            offsets=lasting * errors,
            heading_variances=(1 - traits.yaw_lasting[categories])
            * (traits.yaw_rad[categories] * growths) ** 2,
            evidence=evidence,
        )

    def __len__(self) -> int:
        return len(self.boxes)


class MotionNoise(NamedTuple):
    """How fast the variances of N targets at constant velocity grow, (N, 2, 2) covariances.

    walks: m2/s3, of what velocities gain in one second.
    drifts: m2/s, of what positions gain in one second beyond that.
    """

    walks: np.ndarray
    drifts: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class BernoulliTargets(ArrayTable):
    """N targets, each with a probability of existence.

    ids: (N,) int64.
    beliefs: (N, 4) x, y, vx, vy and covariances. Detected positions scatter around this position,
        which differs from the true one by a slowly changing offset.
    offsets: (N, 2, 2) m2, covariances of this offset.
    heights, yaws: (N, 2) mean and variance of z of the centre, and of the heading.
    fronts: (N,) sum of votes that the heading is not half a turn off, positive.
    travels: (N, 2) unit vectors, the directions of travel, 0 where targets never moved.
    sizes: (N, 3) length width height, metres; size_weights: (N,) see `SIZE_MEMORY`.
    votes: (N, 7) sum of scores of each category; categories: (N,) int8, that of most votes.
    existence: (N,) log odds of existence now; detected_existence: (N,) after the last detection.
    first_evidence: (N,) log odds of the first detection alone; hits: (N,) detections so far.
    streaks_s: (N,) seconds from the first detection after the last miss to the last detection.
    misses: (N,) ticks since the last detection; idle_s: (N,) seconds since the last detection;
        away_s: (N,) the part of them in which the target was not hidden by others.
    """

    ids: np.ndarray
    beliefs: Gaussians
    offsets: np.ndarray
    heights: np.ndarray
    yaws: np.ndarray
    fronts: np.ndarray
    travels: np.ndarray
    sizes: np.ndarray
    size_weights: np.ndarray
    votes: np.ndarray
    categories: np.ndarray
    existence: np.ndarray
    detected_existence: np.ndarray
    first_evidence: np.ndarray
    hits: np.ndarray
    streaks_s: np.ndarray
    misses: np.ndarray
    idle_s: np.ndarray
    away_s: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def boxes(self) -> np.ndarray:
        """(N, 7) centre x y z, length width height, yaw."""
        positions = self.beliefs.means[:, :2]
        return np.column_stack([positions, self.heights[:, 0], self.sizes, self.yaws[:, 0]])

    def log_odds(self, traits: DetectorTraits) -> np.ndarray:
        """Return (N,) log odds of existence, corrected for targets that were detected once."""
        odds: np.ndarray = self.existence + np.where(
            self.hits == 1, traits.seen_once[self.categories], 0.0
        )
        return odds

    @staticmethod
    def started(
        ids: np.ndarray, new: Measurements, velocities: Gaussians, traits: DetectorTraits
    ) -> BernoulliTargets:
        """Return a target for each of N detections; velocities: (N, 2) expected ones, m/s."""
        n, categories, boxes = len(new), new.categories, new.boxes
        covariances = np.zeros((n, 4, 4))
        covariances[:, :2, :2] = new.errors
        covariances[:, 2:, 2:] = velocities.covariances
        votes = np.zeros((n, len(Category)))
        votes[np.arange(n), categories] = new.scores
        height_variances = (traits.height_m[categories] * new.growths) ** 2
        return BernoulliTargets(
            ids=ids,
            beliefs=Gaussians(np.column_stack([boxes[:, :2], velocities.means]), covariances),
            offsets=new.offsets,
            heights=np.column_stack([boxes[:, 2], height_variances]),
            yaws=np.column_stack([boxes[:, 6], new.heading_variances]),
            fronts=new.scores,
            travels=np.zeros((n, 2)),
            sizes=boxes[:, 3:6],
            size_weights=new.growths**-2,
            votes=votes,
            categories=categories,
            existence=new.evidence,
            detected_existence=new.evidence,
            first_evidence=new.evidence,
            hits=np.ones(n, np.int64),
            streaks_s=np.zeros(n),
            misses=np.zeros(n, np.int64),
            idle_s=np.zeros(n),
            away_s=np.zeros(n),
        )

    def motion_noise(self, traits: DetectorTraits) -> MotionNoise:
        """Return how fast variances grow, by category and heading."""
        categories = self.categories
        walks = oriented_covariances(
            np.ascontiguousarray(self.yaws[:, 0]),
            traits.accelerate_m_s2[categories],
            traits.swerve_m_s2[categories],
        )
        return MotionNoise(walks, 2 * self.offsets / traits.lasting_s[categories, None, None])

    def predicted(self, dt: float, traits: DetectorTraits) -> BernoulliTargets:
        """Return targets after dt seconds, before the detections of the tick."""
        categories, beliefs = self.categories, self.beliefs
        means, covariances = predicted_states(
            beliefs.means, beliefs.covariances, *self.motion_noise(traits), dt
        )
        heights, yaws = self.heights.copy(), self.yaws.copy()
        heights[:, 1] += (traits.climb_m_s**2 * dt)[categories]
        yaws[:, 1] += (traits.turn_rad_s**2 * dt)[categories]
        return replace(
            self,
            beliefs=Gaussians(means, covariances),
            heights=heights,
            yaws=yaws,
            misses=self.misses + 1,
            idle_s=self.idle_s + dt,
        )

    def corrected(
        self, own: Measurements, traits: DetectorTraits
    ) -> tuple[BernoulliTargets, np.ndarray]:
        """Return targets after one detection each, and (N,) squared Mahalanobis distances."""
        means, covariances, distances = corrected_states(
            self.beliefs.means,
            self.beliefs.covariances,
            np.ascontiguousarray(own.boxes[:, :2]),
            own.errors,
        )
        votes = self.votes.copy()
        votes[np.arange(len(self)), own.categories] += own.scores
        height_variances = (traits.height_m[own.categories] * own.growths) ** 2
        before = BoxEstimates(self.heights, self.yaws, self.fronts, self.sizes, self.size_weights)
        detected = DetectedBoxes(
            own.boxes, own.scores, own.growths**-2, height_variances, own.heading_variances
        )
        after = corrected_boxes(before, detected, SIZE_MEMORY, HEADING_MEMORY)
        zeros = np.zeros(len(self))
        targets = replace(
            self,
            beliefs=Gaussians(means, covariances),
            offsets=own.offsets,
            heights=after.heights,
            yaws=after.yaws,
            fronts=after.fronts,
            sizes=after.sizes,
            size_weights=after.size_weights,
            votes=votes,
            categories=votes.argmax(axis=1).astype(np.int8),
            hits=self.hits + 1,
            streaks_s=np.where(self.misses == 1, self.streaks_s + self.idle_s, 0.0),
            misses=np.zeros(len(self), np.int64),
            idle_s=zeros,
            away_s=zeros,
        )
        return targets, distances


@compiled()
def oriented_covariances(yaws: np.ndarray, along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Return (N, 2, 2) covariances with (N,) standard deviations along and across headings."""
    covariances = np.empty((len(yaws), 2, 2))
    for i in range(len(yaws)):
        c, s = np.cos(yaws[i]), np.sin(yaws[i])
        a, b = along[i] ** 2, across[i] ** 2
        covariances[i, 0, 0] = c * c * a + s * s * b
        covariances[i, 1, 1] = s * s * a + c * c * b
        covariances[i, 0, 1] = covariances[i, 1, 0] = c * s * (a - b)
    return covariances


@compiled()
def predicted_states(
    means: np.ndarray, covariances: np.ndarray, walks: np.ndarray, drifts: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 4) states x, y, vx, vy and covariances after dt seconds at constant velocity.

    walks, drifts: see `MotionNoise`.
    """
    after, spread = means.copy(), np.empty_like(covariances)
    for i in range(len(means)):
        P = covariances[i]
        for a in range(2):
            after[i, a] += dt * means[i, 2 + a]
            for b in range(2):
                q = walks[i, a, b]
                crossed = P[a, 2 + b] + dt * P[2 + a, 2 + b]
                position = P[a, b] + dt * P[2 + a, b] + dt * crossed
                spread[i, a, b] = position + q * dt**3 / 3 + drifts[i, a, b] * dt
                spread[i, a, 2 + b] = spread[i, 2 + b, a] = crossed + q * dt**2 / 2
                spread[i, 2 + a, 2 + b] = P[2 + a, 2 + b] + q * dt
    return after, spread


@compiled()
def corrected_states(
    means: np.ndarray, covariances: np.ndarray, positions: np.ndarray, errors: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return states, covariances and (N,) squared Mahalanobis distances of the innovations.

    positions: (N, 2) measured, with (N, 2, 2) covariances of their errors.
    """
    after, spread, distances = means.copy(), np.empty_like(covariances), np.empty(len(means))
    gain = np.empty((4, 2))
    for i in range(len(means)):
        P = covariances[i]
        a, c = P[0, 0] + errors[i, 0, 0], P[1, 1] + errors[i, 1, 1]
        b = P[0, 1] + errors[i, 0, 1]
        determinant = a * c - b * b
        x, y = positions[i, 0] - means[i, 0], positions[i, 1] - means[i, 1]
        distances[i] = (c * x * x - 2 * b * x * y + a * y * y) / determinant
        for k in range(4):
            gain[k, 0] = (P[k, 0] * c - P[k, 1] * b) / determinant
            gain[k, 1] = (P[k, 1] * a - P[k, 0] * b) / determinant
            after[i, k] += gain[k, 0] * x + gain[k, 1] * y
        for k in range(4):
            for j in range(k + 1):
                change = gain[k, 0] * (a * gain[j, 0] + b * gain[j, 1])
                change += gain[k, 1] * (b * gain[j, 0] + c * gain[j, 1])
                spread[i, k, j] = spread[i, j, k] = P[k, j] - change
    return after, spread, distances


class BoxEstimates(NamedTuple):
    """Heights, headings and sizes of N targets, see `BernoulliTargets`."""

    heights: np.ndarray
    yaws: np.ndarray
    fronts: np.ndarray
    sizes: np.ndarray
    size_weights: np.ndarray


class DetectedBoxes(NamedTuple):
    """One detection of each of N targets.

    boxes: (N, 7). scores, size_weights: (N,).
    height_variances, yaw_variances: (N,) of the errors.
    """

    boxes: np.ndarray
    scores: np.ndarray
    size_weights: np.ndarray
    height_variances: np.ndarray
    yaw_variances: np.ndarray


@compiled()
def corrected_boxes(
    before: BoxEstimates, detected: DetectedBoxes, size_memory: float, heading_memory: float
) -> BoxEstimates:
    """Return heights, headings and sizes after one detection of each target.

    A detection shows the axis of a body well, but not which end is the front. So a scalar Kalman
    filter estimates the heading modulo half a turn, and votes decide between both ends.

    size_memory, heading_memory: see `SIZE_MEMORY` and `HEADING_MEMORY`.
    """
    heights, yaws, fronts = before.heights.copy(), before.yaws.copy(), before.fronts.copy()
    sizes, size_weights = before.sizes.copy(), before.size_weights.copy()
    for i in range(len(fronts)):
        gain = heights[i, 1] / (heights[i, 1] + detected.height_variances[i])
        heights[i, 0] += gain * (detected.boxes[i, 2] - heights[i, 0])
        heights[i, 1] *= 1 - gain
        residual = _wrapped(detected.boxes[i, 6] - yaws[i, 0])
        vote = detected.scores[i]
        if abs(residual) > np.pi / 2:
            residual, vote = _wrapped(residual + np.pi), -vote
        gain = yaws[i, 1] / (yaws[i, 1] + detected.yaw_variances[i])
        yaws[i, 0] += gain * residual
        yaws[i, 1] *= 1 - gain
        front = heading_memory * fronts[i] + vote
        yaws[i, 0] = _wrapped(yaws[i, 0] + (np.pi if front < 0 else 0.0))
        fronts[i] = abs(front)
        weight = detected.size_weights[i]
        size_weights[i] = min(size_weights[i], size_memory) + weight
        for k in range(3):
            sizes[i, k] += weight / size_weights[i] * (detected.boxes[i, 3 + k] - sizes[i, k])
    return BoxEstimates(heights, yaws, fronts, sizes, size_weights)


@compiled()
def _wrapped(angle: float) -> float:
    """Return an angle, radians, plus the whole turns that bring it into -pi to pi."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


@compiled()
def hidden_shares(
    boxes: np.ndarray, wanted: np.ndarray, solid: np.ndarray, origin: np.ndarray
) -> np.ndarray:
    """Return (N,) the share of each target's width that nearer solid targets hide from the sensor.

    boxes: (N, 7) as in `BernoulliTargets`. wanted: (N,) bool, whose share is computed; others have
    0. solid: (N,) bool, which targets probably exist. origin: (2,) metres, the sensor.
    """
    n = len(boxes)
    bearings, half_widths, ranges_m = np.empty(n), np.empty(n), np.empty(n)
    shares = np.zeros(n)
    for i in range(n):
        if wanted[i] or solid[i]:
            dx, dy = boxes[i, 0] - origin[0], boxes[i, 1] - origin[1]
            bearings[i], ranges_m[i] = np.arctan2(dy, dx), max(np.hypot(dx, dy), 1e-3)
            turn = boxes[i, 6] - bearings[i]
            width = boxes[i, 3] * abs(np.sin(turn)) + boxes[i, 4] * abs(np.cos(turn))
            half_widths[i] = np.arctan2(width / 2, ranges_m[i])
    for i in range(n):
        if not wanted[i]:
            continue
        for j in range(n):
            if not solid[j] or ranges_m[j] >= ranges_m[i]:
                continue
            difference = abs(bearings[j] - bearings[i])
            difference = min(difference, 2 * np.pi - difference)
            half, other = half_widths[i], half_widths[j]
            if difference >= half + other:
                continue
            covered = min(half, difference + other) - max(-half, difference - other)
            shares[i] += covered / (2 * half)
    return np.minimum(shares, 1.0)


# What is expected of the velocity of a new target. Chosen by hand: lanes are 3 to 4 m wide, and
# drivers keep within a few m/s of each other over the distance in which they can react to each
# other; the last two are round figures.
AHEAD_M, ASIDE_M = 40.0, 3.0
"""Standard deviations, along and across the heading, of the distance of a neighbour that moves
alike."""
ALIKE_M_S, ALIKE_SHARE = 2.0, 0.2
"""Standard deviation between the velocities of road users that move alike. For the velocity of a
neighbour across the heading it is the first plus this share of the speed along it."""
USUAL_WEIGHT = 0.2
"""Weight of the usual speed of a category, relative to that of a neighbour at distance 0."""
KNOWN_M_S = 2.0
"""Neighbours are targets whose velocity has a smaller standard deviation along each axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Neighbours(ArrayTable):
    """Road users whose motion is known.

    positions, velocities: (N, 2) metres and m/s. families: (N,) numbers of `Family`.
    """

    positions: np.ndarray
    velocities: np.ndarray
    families: np.ndarray

    @staticmethod
    def of(
        targets: BernoulliTargets, origin: np.ndarray, ego_velocity: np.ndarray | None
    ) -> Neighbours:
        """Return the targets whose velocity is known, and the ego at the origin (2,).

        ego_velocity: (2,) m/s in the frame of the targets; without it the ego is left out.
        """
        means, covariances = targets.beliefs.means, targets.beliefs.covariances
        variances = np.maximum(covariances[:, 2, 2], covariances[:, 3, 3])
        neighbours = Neighbours(means[:, :2], means[:, 2:], FAMILIES[targets.categories])
        neighbours = neighbours.select((variances < KNOWN_M_S**2) & (targets.existence > 0))
        if ego_velocity is None:
            return neighbours
        ego = FAMILIES[[Category.CAR]]
        return neighbours.joined(Neighbours(origin[None], ego_velocity[None], ego))


def expected_velocities(
    new: Measurements, neighbours: Neighbours, traits: DetectorTraits
) -> Gaussians:
    """Return (N, 2) means and (N, 2, 2) covariances of the velocities of new targets.

    A new target moves along its heading or, where the detector confused front and rear, against
    it. Its speed is a mixture of the usual one and of those of neighbours, which have more weight
    in the same lane. Mean and variance of the mixture are returned.
    """
    categories, yaws = new.categories, np.ascontiguousarray(new.boxes[:, 6])
    headings = np.column_stack([np.cos(yaws), np.sin(yaws)])
    front = traits.front[categories]
    weight, weighted_speed, weighted_square = _neighbour_speeds(
        new.boxes,
        FAMILIES[categories],
        front,
        np.ascontiguousarray(neighbours.positions),
        np.ascontiguousarray(neighbours.velocities),
        neighbours.families,
    ).T
    usual, total = (2 * front - 1) * traits.cruise_m_s[categories], USUAL_WEIGHT + weight
    mean = (USUAL_WEIGHT * usual + weighted_speed) / total
    # The root mean square of the usual speed is that of the traits, whatever its mean.
    variance = USUAL_WEIGHT * (traits.speed_m_s[categories] ** 2 + mean**2 - 2 * usual * mean)
    variance += weight * (ALIKE_M_S**2 + mean**2) + weighted_square - 2 * mean * weighted_speed
    along = np.sqrt(variance / total)
    skew = np.minimum(traits.yaw_rad[categories] * new.growths, 1.0)
    across = np.hypot(traits.aside_m_s[categories], skew * np.hypot(mean, along))
    return Gaussians(mean[:, None] * headings, oriented_covariances(yaws, along, across))


@compiled()
def _neighbour_speeds(
    boxes: np.ndarray,
    families: np.ndarray,
    front: np.ndarray,
    positions: np.ndarray,
    velocities: np.ndarray,
    neighbour_families: np.ndarray,
) -> np.ndarray:
    """Return (N, 3) sums over neighbours: of weights, weights * speeds and weights * speeds^2.

    Speeds are those along the headings of the N new targets.

    boxes, families, front: (N, 7), (N,), (N,) of the new targets.
    positions, velocities, neighbour_families: (M, 2), (M, 2), (M,).
    """
    sums = np.zeros((len(boxes), 3))
    for i in range(len(boxes)):
        c, s = np.cos(boxes[i, 6]), np.sin(boxes[i, 6])
        for j in range(len(positions)):
            if families[i] != neighbour_families[j]:
                continue
            dx, dy = positions[j, 0] - boxes[i, 0], positions[j, 1] - boxes[i, 1]
            speed = c * velocities[j, 0] + s * velocities[j, 1]
            across = c * velocities[j, 1] - s * velocities[j, 0]
            across /= ALIKE_M_S + ALIKE_SHARE * abs(speed)
            ahead, aside = (c * dx + s * dy) / AHEAD_M, (c * dy - s * dx) / ASIDE_M
            weight = np.exp(-0.5 * (ahead**2 + aside**2 + across**2))
            weight *= front[i] if speed > 0 else 1 - front[i]
            sums[i, 0] += weight
            sums[i, 1] += weight * speed
            sums[i, 2] += weight * speed**2
    return sums
