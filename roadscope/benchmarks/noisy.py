"""Noise model of detections: the truth with errors of known size, as input of trackers.

Like the oracle it is no plug-in and belongs to the benchmark. It is named by a string, as plug-ins
are: `noisy?miss=0.2&clutter=2&position_m=0.3`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.fingerprints import fingerprint
from roadscope.core import Category, Detections, Registry, Truth, wrap_angle

CLUTTER_SIZE_M = (4.5, 1.8, 1.5)
LEAST_SIZE_M = 0.2


class _ScoredBoxes(NamedTuple):
    """Columns of N boxes, as in `Detections`."""

    centres: np.ndarray
    sizes: np.ndarray
    yaws: np.ndarray
    categories: np.ndarray
    scores: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseModel:
    """The sizes of the errors, which are drawn independently in every frame.

    Only misses depend on earlier frames: by `miss_run`, and by `occlusion`.

    miss: share of an eligible object's frames in which it is not detected, 0 to below 1.
    miss_run: mean number of frames from the first miss to the next detection, by a two-state
        Markov chain (Gilbert 1960); None: 1 / (1 - miss), for independent misses.
    occlusion: this times the hidden share of an object is the probability that it is missed for
        occlusion. An object that is missed at one share is also missed at every greater share.
    clutter: mean number of false detections a frame, Poisson, uniform over the range band, with
        a car's size and any yaw.
    position_m: standard deviation in x and in y.
    size_m: standard deviation of length, width and height, which stay above 0.2 m.
    yaw_deg: standard deviation of the yaw.
    flip: share of detections whose front and rear are exchanged.
    score_gap: distance between the mean log odds of objects and of clutter, in standard
        deviations. An object's score is higher than that of clutter with the probability
        Phi(score_gap / sqrt 2). Where there are as many objects as clutter, scores are calibrated
        probabilities. 0: all scores are 0.5.
    """

    miss: float = 0.1
    miss_run: float | None = None
    occlusion: float = 0.0
    clutter: float = 1.0
    position_m: float = 0.2
    size_m: float = 0.1
    yaw_deg: float = 3.0
    flip: float = 0.02
    score_gap: float = 2.0

    def __post_init__(self) -> None:
        for name in ("clutter", "position_m", "size_m", "yaw_deg", "score_gap"):
            self._check(name, "0 or more", 0.0, math.inf)
        for name in ("occlusion", "flip"):
            self._check(name, "in 0 to 1", 0.0, 1.0)
        self._check("miss", "0 or more and below 1", 0.0, math.nextafter(1.0, 0.0))
        if self.miss_run is not None:
            least = max(1.0, self.miss / (1 - self.miss))
            self._check(
                "miss_run", f"none or at least {least:g} with miss={self.miss:g}", least, math.inf
            )

    def _check(self, name: str, wanted: str, low: float, high: float) -> None:
        value = getattr(self, name)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (number and low <= value <= high and math.isfinite(value)):
            raise ValueError(f"{name} must be {wanted}, got {value!r}")

    @property
    def miss_after_miss(self) -> float:
        """Probability that a miss is followed by a miss."""
        return self.miss if self.miss_run is None else 1 - 1 / self.miss_run

    @property
    def miss_after_hit(self) -> float:
        """Probability that a detection is followed by a miss; makes `miss` the share of misses."""
        return (1 - self.miss_after_miss) * self.miss / (1 - self.miss)


NOISES: Registry[NoiseModel] = Registry(
    "noise model",
    {
        "noisy": "roadscope.benchmarks.noisy:NoiseModel",
        "noisy-misses": "roadscope.benchmarks.noisy:NoiseModel"
        "?miss=0.3&miss_run=4&occlusion=1.0&clutter=0.5",
        "noisy-clutter": "roadscope.benchmarks.noisy:NoiseModel"
        "?clutter=8&position_m=0.4&yaw_deg=8&flip=0.1&score_gap=1.5",
    },
    summaries={
        "noisy": "True boxes with errors: miss, clutter, position_m, yaw.",
        "noisy-misses": "True boxes, 3 of 10 missed in runs, hidden ones more.",
        "noisy-clutter": "True boxes, rough, and 8 false ones in a frame.",
    },
)


class NoisyDetections:
    """Detections of one episode, frame after frame.

    Every kind of error has a random generator of its own, which draws for all objects in every
    frame: changing one option leaves all other errors the same.
    """

    def __init__(self, model: NoiseModel, episode: Episode, eligibility: Eligibility) -> None:
        name = int(fingerprint(["noisy", episode.scenario]), 16)
        streams = np.random.SeedSequence([name, episode.seed]).spawn(5)
        self._model, self._eligibility = model, eligibility
        rngs = [np.random.default_rng(stream) for stream in streams]
        self._misses, self._occlusion, self._boxes, self._scores, self._clutter = rngs
        self._missed: dict[int, bool] = {}
        self._hidden_limits: dict[int, float] = {}

    def of(self, truth: Truth) -> Detections:
        """Return the detections of the next frame, world frame."""
        missed = self._missed_at_random(truth) | self._is_hidden(truth)
        boxes = self._with_errors(truth)
        detected = np.flatnonzero(self._eligibility.of(truth) & ~missed)
        false_boxes = self._false_boxes(truth)
        joined = _ScoredBoxes(
            *(np.concatenate([a[detected], b]) for a, b in zip(boxes, false_boxes, strict=True))
        )
        return Detections(*joined, "world", truth.stamp_s)

    def _missed_at_random(self, truth: Truth) -> np.ndarray:
        """Return (N,) bool, misses of the Markov chain, which begins in its stationary state."""
        model, missed = self._model, []
        for identity, draw in zip(truth.ids.tolist(), self._misses.random(len(truth)), strict=True):
            before = self._missed.get(identity)
            chance = (
                model.miss
                if before is None
                else model.miss_after_miss
                if before
                else model.miss_after_hit
            )
            self._missed[identity] = bool(draw < chance)
            missed.append(self._missed[identity])
        return np.array(missed, np.bool_)

    def _is_hidden(self, truth: Truth) -> np.ndarray:
        """Return (N,) bool, which objects are missed because too much of them is hidden.

        Each object has a random limit of its own, which stays the same over the episode.
        """
        for identity in truth.ids.tolist():
            if identity not in self._hidden_limits:
                self._hidden_limits[identity] = float(self._occlusion.random())
        limits = np.array([self._hidden_limits[identity] for identity in truth.ids.tolist()])
        hidden: np.ndarray = self._model.occlusion * truth.occluded_fraction > limits
        return hidden

    def _with_errors(self, truth: Truth) -> _ScoredBoxes:
        """Return the boxes of all objects with their errors."""
        count, model = len(truth), self._model
        normal, turned = self._boxes.standard_normal((count, 6)), self._boxes.random(count)
        shift = np.pad(model.position_m * normal[:, :2], ((0, 0), (0, 1)))
        sizes = np.maximum(truth.sizes + model.size_m * normal[:, 2:5], LEAST_SIZE_M)
        flips = np.pi * (turned < model.flip)
        yaws = wrap_angle(truth.yaws + np.radians(model.yaw_deg) * normal[:, 5] + flips)
        scores = self._score(self._scores.standard_normal(count), +0.5)
        return _ScoredBoxes(truth.centres + shift, sizes, yaws, truth.categories, scores)

    def _false_boxes(self, truth: Truth) -> _ScoredBoxes:
        """Return the boxes of the clutter."""
        rng, model = self._clutter, self._model
        count = int(rng.poisson(model.clutter))
        near, far = self._eligibility.range_m
        radii = np.sqrt(rng.uniform(near**2, far**2, count))
        angles, yaws = rng.uniform(-np.pi, np.pi, (2, count))
        normal = rng.standard_normal((count, 4))
        sizes = np.maximum(CLUTTER_SIZE_M + model.size_m * normal[:, :3], LEAST_SIZE_M)
        across = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        ego = truth.world_from_ego.translation
        centres = np.column_stack([ego[:2] + across, ego[2] + sizes[:, 2] / 2])
        categories = np.full(count, _first_category(self._eligibility), np.int8)
        scores = self._score(normal[:, 3], -0.5)
        return _ScoredBoxes(centres, sizes, yaws, categories, scores)

    def _score(self, normal: np.ndarray, side: float) -> np.ndarray:
        """Return scores made from (N,) draws of the standard normal distribution.

        side: +0.5 for objects, -0.5 for clutter: the means of the log odds lie on either side of 0.
        """
        gap = self._model.score_gap
        scores: np.ndarray = 1 / (1 + np.exp(-gap * (normal + side * gap)))
        return scores


def _first_category(eligibility: Eligibility) -> int:
    """Return the first category whose family is eligible."""
    return next(c.value for c in Category if c.family.value in eligibility.families)
