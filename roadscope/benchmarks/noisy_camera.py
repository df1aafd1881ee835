"""Noise model of camera detections: truth with misses, clutter, wrong boxes and wrong classes.

It is named by a string, as plug-ins are: `noisy-camera?miss=0.1&clutter=1`. It belongs to the
benchmark; results that use it are labelled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType

import numpy as np

from roadscope.core import ImageDetections, Registry, Truth
from roadscope.core.category import CATEGORY_OF_FAMILY, families_of
from roadscope.envs.imaging.pinhole import Pinhole

HEIGHTS_M = np.array([1.5, 1.75, 1.7])
"""Heights of false detections, by family."""
LEAST_PX = 4.0
"""Objects with a shorter side in the image are never detected."""
LIT: Mapping[str, tuple[float, float, float, float, float]] = MappingProxyType(
    {"night": (0.99, 0.95, 0.87, 0.71, 0.56), "glare": (0.99, 0.98, 0.94, 0.86, 0.75)}
)
"""Detections in night and glare of severity 1 to 5, as a share of those by day: measured with the
shipped network on training seeds of a street and a town crossing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraNoise:
    """The sizes of the errors, which are drawn independently in every image.

    miss: share of large, unoccluded, well lit objects that are missed.
    half_px: height in pixels at which half of the objects are detected. steepness: of the log odds
        over the logarithm of the height.
    hidden: hidden share at which half of the large objects are detected.
    clutter: mean number of false detections an image.
    box: standard deviation of each edge as a share of the box, at least one pixel.
    confused: share of small objects with a wrong family; large ones have a tenth of it.
    gap: standard deviation of the noise that is added to the log odds of a score.
    """

    miss: float = 0.03
    half_px: float = 20.0
    steepness: float = 4.0
    hidden: float = 0.7
    clutter: float = 0.6
    box: float = 0.04
    confused: float = 0.15
    gap: float = 1.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value, is_share = (
                getattr(self, field.name),
                field.name in ("miss", "hidden", "confused"),
            )
            is_number = isinstance(value, int | float | np.integer | np.floating)
            if not (is_number and 0 <= value < (1 if is_share else np.inf)):
                possible = "at least 0 and below 1" if is_share else "0 or more"
                raise ValueError(f"{field.name} must be {possible}, got {value!r}")
        if not self.half_px:
            raise ValueError(f"half_px must be above 0, got {self.half_px!r}")


CAMERA_NOISES: Registry[CameraNoise] = Registry(
    "camera noise model",
    {"noisy-camera": "roadscope.benchmarks.noisy_camera:CameraNoise"},
    summaries={"noisy-camera": "True boxes in the image with misses, clutter and errors."},
)


class NoisyCamera:
    """Detections of one episode, image after image.

    Fog lowers contrast by Koschmieder's law; at night pedestrians and cyclists, which have no
    lamps, are detected only nearer.
    """

    def __init__(
        self,
        model: CameraNoise,
        seed: int,
        *,
        extinction_per_m: float = 0.0,
        night: bool = False,
        lit: float = 1.0,
    ) -> None:
        """Take the sizes of errors, a seed, and the light and the air of the episode.

        lit: factor by which darkness or glare lowers the probability of detection.
        """
        self._model, self._fog, self._night, self._lit = model, extinction_per_m, night, lit
        streams = np.random.SeedSequence([7_103, seed]).spawn(2)
        self._rng, self._clutter = (np.random.default_rng(stream) for stream in streams)

    def of(self, truth: Truth, pinhole: Pinhole) -> ImageDetections:
        """Return the detections of the next image."""
        width, height = pinhole.width, pinhole.height
        assert truth.image_boxes is not None
        rng, boxes = self._rng, truth.image_boxes
        sides = boxes[:, 2:] - boxes[:, :2]
        family = families_of(truth.categories)
        odds = self._odds(truth, sides, family)
        chance = self._lit * (1 - self._model.miss) / (1 + np.exp(-odds))
        draws = rng.random((len(truth), 3))
        noise = rng.standard_normal((len(truth), 5))
        detected = (draws[:, 0] < chance) & (sides.min(axis=1, initial=LEAST_PX) >= LEAST_PX)
        errors = np.maximum(self._model.box * np.tile(sides, 2), 1.0) * noise[:, :4]
        moved = _inside(boxes + errors, width, height)
        large = np.clip(sides[:, 1] / 80.0, 0.0, 1.0)
        swaps = draws[:, 1] < self._model.confused * (1 - 0.9 * large)
        families = np.where(swaps, _another(family, draws[:, 2]), family)
        scores = _probability(np.minimum(odds, 4.0) + self._model.gap * noise[:, 4])
        detected &= ((moved[:, 2:] - moved[:, :2]) > 1.0).all(axis=1)
        false, false_families, false_scores = self._false_boxes(pinhole)
        return ImageDetections(
            np.concatenate([moved[detected], false]),
            CATEGORY_OF_FAMILY[np.concatenate([families[detected], false_families])],
            np.concatenate([scores[detected], false_scores]),
            truth.stamp_s,
            size_px=(width, height),
        )

    def _odds(self, truth: Truth, sides: np.ndarray, family: np.ndarray) -> np.ndarray:
        """Return (N,) log odds of detection: the least of those by size, hidden share and contrast.

        sides: (N, 2) width and height of the boxes, pixels. family: (N,) 0 for vehicles.
        """
        model = self._model
        offsets = truth.centres - truth.world_from_ego.translation
        distances = np.linalg.norm(offsets, axis=1)
        contrast = np.exp(-self._fog * distances)
        if self._night:
            contrast = contrast * np.where(family == 0, 0.8, np.exp(-distances / 25.0))
        size = model.steepness * np.log(np.maximum(sides[:, 1], 1.0) / model.half_px)
        visibility = 10.0 * (model.hidden - truth.occluded_fraction)
        # Half of the objects are detected at a contrast of 5 % to the background.
        light = 2.0 * np.log(np.maximum(contrast, 1e-9) / 0.05)
        odds = np.minimum(np.minimum(size, visibility), light)
        return np.asarray(np.where(truth.visible_pixels > 0, odds, -30.0))

    def _false_boxes(self, pinhole: Pinhole) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return boxes (K, 4), pixels, families and scores (K,) of false detections."""
        rng = self._clutter
        count = int(rng.poisson(self._model.clutter))
        families = rng.choice(3, count, p=(0.4, 0.15, 0.45))
        # Posts, bins and bushes stand on the ground: 10 to 60 m away, the camera 1.4 m up.
        width, height, focal = pinhole.width, pinhole.height, pinhole.focal_px[0]
        depths = rng.uniform(10, 60, count)
        tall = focal * HEIGHTS_M[families] / depths * np.exp(0.15 * rng.standard_normal(count))
        wide = tall * np.choose(families, (1.4, 0.6, 0.4))
        bottoms = height / 2 + focal * 1.4 / depths + 3 * rng.standard_normal(count)
        middles = rng.uniform(0, width, count)
        boxes = np.column_stack([middles - wide / 2, bottoms - tall, middles + wide / 2, bottoms])
        scores = _probability(-1.0 + 1.2 * rng.standard_normal(count))
        return _inside(boxes, width, height), families, scores


def _another(family: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """Return another family; cyclists and pedestrians are mostly confused with each other."""
    first = np.array([2, 2, 1])[family]
    second = np.array([1, 0, 0])[family]
    return np.asarray(np.where(draws < 0.75, first, second))


def _inside(boxes: np.ndarray, width: int, height: int) -> np.ndarray:
    size = np.array([width, height, width, height], np.float64)
    clipped: np.ndarray = np.clip(boxes, 0.0, size)
    return clipped


def _probability(odds: np.ndarray) -> np.ndarray:
    result: np.ndarray = 1 / (1 + np.exp(-odds))
    return result
