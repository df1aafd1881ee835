"""What `ExistenceTracker` believes of each target, and how detections change it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Category, Detections
from roadscope.trackers.existence_kernels import corrected, ellipses, looked_at, moved_on
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.learned import Learned
from roadscope.trackers.rows import Rows
from roadscope.trackers.tracklets import boxes_of

# Set by hand; the last is where scores of five digits end.
SIZE_MEMORY = 1.0
"""Detections at no range that a size rests on at most: boxes follow what is visible."""
HEADING_MEMORY = 0.9
"""What a vote for front and rear is still worth a tick later."""
SCORE_EDGE = 1e-4
"""Scores closer to 0 and 1 than this mean no more than this."""


def log_odds(scores: np.ndarray) -> np.ndarray:
    """Return (N,) log odds of scores in 0 to 1."""
    shares = np.clip(scores, SCORE_EDGE, 1 - SCORE_EDGE)
    found: np.ndarray = np.log(shares / (1 - shares))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Measured(Rows):
    """N detections and what they are worth.

    boxes: (N, 7) centre x y z, length width height, yaw.
    categories, scores: as in `Detections`.
    growths: (N,) factor of all standard deviations, 1 at no range.
    errors: (N, 2, 2) covariances of the places, of what is new in every tick.
    offsets: (N, 2, 2) likewise, of what lasts.
    turns: (N,) variances of the headings, of what is new in every tick.
    evidence: (N,) log odds that they are right, from their scores alone.
    """

    boxes: np.ndarray
    categories: np.ndarray
    scores: np.ndarray
    growths: np.ndarray
    errors: np.ndarray
    offsets: np.ndarray
    turns: np.ndarray
    evidence: np.ndarray

    @staticmethod
    def of(
        detections: Detections, eye: np.ndarray, traits: Learned, noise: float = 1.0
    ) -> Measured:
        """Weigh detections as seen from (2,) an eye, in their own frame.

        noise: factor of the covariances of places.
        """
        kinds, boxes = detections.categories, boxes_of(detections)
        ranges = np.hypot(boxes[:, 0] - eye[0], boxes[:, 1] - eye[1])
        growths = 1 + traits.growth_per_m[kinds] * ranges
        errors = noise * ellipses(
            boxes[:, 6], traits.along_m[kinds] * growths, traits.across_m[kinds] * growths
        )
        lasting = traits.lasting[kinds, None, None]
        evidence = traits.right(log_odds(detections.scores), kinds, ranges)
        turns = (1 - traits.yaw_lasting[kinds]) * (traits.yaw_rad[kinds] * growths) ** 2
        return Measured(
            boxes, kinds, detections.scores, growths, (1 - lasting) * errors, lasting * errors,
            turns, evidence,
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.boxes)


@dataclass(frozen=True, slots=True, eq=False)
class Targets(Rows):
    """N targets.

    ids: (N,) int64.
    beliefs: (N, 4) x, y, vx, vy and their covariances, of the place that detections point to.
    offsets: (N, 2, 2) covariances of how far that is from the true one.
    heights, yaws: (N, 2) mean and variance.
    fronts: (N,) sum of votes that front is front, positive.
    sizes: (N, 3) length width height; size_weights: (N,) what they rest on.
    votes: (N, 7) sum of scores for each category; categories: (N,) int8, what most of them say.
    existence: (N,) log odds that there is something, as scores say; assured: (N,) as the last
        detection left them.
    claims: (N,) evidence of the first detection; hits: (N,) detections so far.
    misses: (N,) ticks since the last detection; idle_s: (N,) seconds; away_s: (N,) seconds of
        these in which it should have been seen.
    """

    ids: np.ndarray
    beliefs: Gaussians
    offsets: np.ndarray
    heights: np.ndarray
    yaws: np.ndarray
    fronts: np.ndarray
    sizes: np.ndarray
    size_weights: np.ndarray
    votes: np.ndarray
    categories: np.ndarray
    existence: np.ndarray
    assured: np.ndarray
    claims: np.ndarray
    hits: np.ndarray
    misses: np.ndarray
    idle_s: np.ndarray
    away_s: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def boxes(self) -> np.ndarray:
        """(N, 7) centre x y z, length width height, yaw."""
        places = self.beliefs.means[:, :2]
        return np.column_stack([places, self.heights[:, 0], self.sizes, self.yaws[:, 0]])

    def told(self, traits: Learned) -> np.ndarray:
        """Return (N,) log odds that there is something, given who was seen but once."""
        found: np.ndarray = self.existence + np.where(
            self.hits == 1, traits.seen_once[self.categories], 0.0
        )
        return found

    @staticmethod
    def opened(ids: np.ndarray, new: Measured, velocities: Gaussians, traits: Learned) -> Targets:
        """Begin to follow N detections, with (N, 2) velocities expected of them."""
        n, kinds, boxes = len(new), new.categories, new.boxes
        covariances = np.zeros((n, 4, 4))
        covariances[:, :2, :2] = new.errors
        covariances[:, 2:, 2:] = velocities.covariances
        votes = np.zeros((n, len(Category)))
        votes[np.arange(n), kinds] = new.scores
        return Targets(
            ids, Gaussians(np.column_stack([boxes[:, :2], velocities.means]), covariances),
            new.offsets,
            np.column_stack([boxes[:, 2], (traits.height_m[kinds] * new.growths) ** 2]),
            np.column_stack([boxes[:, 6], new.turns]),
            new.scores, boxes[:, 3:6], new.growths**-2, votes, kinds, new.evidence,
            new.evidence, new.evidence, np.ones(n, np.int64),
            np.zeros(n, np.int64), np.zeros(n), np.zeros(n),
        )  # fmt: skip

    def wandering(self, traits: Learned) -> tuple[np.ndarray, np.ndarray]:
        """Return (N, 2, 2) covariances of how far velocities wander in a second, and places."""
        kinds = self.categories
        walks = ellipses(self.yaws[:, 0], traits.accelerate_m_s2[kinds], traits.swerve_m_s2[kinds])
        return walks, 2 * self.offsets / traits.lasting_s[kinds, None, None]

    def carried(self, dt: float, traits: Learned) -> Targets:
        """Move on by dt seconds, unseen as yet."""
        kinds, beliefs = self.categories, self.beliefs
        wander, drift = self.wandering(traits)
        means, covariances = moved_on(beliefs.means, beliefs.covariances, wander, drift, dt)
        heights, yaws = self.heights.copy(), self.yaws.copy()
        heights[:, 1] += (traits.climb_m_s**2 * dt)[kinds]
        yaws[:, 1] += (traits.turn_rad_s**2 * dt)[kinds]
        return replace(
            self, beliefs=Gaussians(means, covariances), heights=heights, yaws=yaws,
            misses=self.misses + 1, idle_s=self.idle_s + dt,
        )  # fmt: skip

    def seen(self, found: Measured, traits: Learned) -> tuple[Targets, np.ndarray]:
        """Take one detection in each; with (N,) squared Mahalanobis distances of their places."""
        means, covariances, distances = corrected(
            self.beliefs.means, self.beliefs.covariances, found.boxes[:, :2], found.errors
        )
        votes = self.votes.copy()
        votes[np.arange(len(self)), found.categories] += found.scores
        climbs = (traits.height_m[found.categories] * found.growths) ** 2
        heights, yaws, fronts, sizes, weights = looked_at(
            (self.heights, self.yaws, self.fronts, self.sizes, self.size_weights),
            (found.boxes, found.scores, found.growths**-2, climbs, found.turns),
            SIZE_MEMORY, HEADING_MEMORY,
        )  # fmt: skip
        none, never = np.zeros(len(self)), np.zeros(len(self), np.int64)
        after = Targets(
            self.ids, Gaussians(means, covariances), found.offsets, heights, yaws, fronts, sizes,
            weights, votes, votes.argmax(axis=1).astype(np.int8), self.existence, self.assured,
            self.claims, self.hits + 1, never, none, none,
        )  # fmt: skip
        return after, distances
