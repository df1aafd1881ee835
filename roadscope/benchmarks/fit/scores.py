"""Fits the score model of the detectors anew: `roadscope.detectors.scoring` with other weights.

    from roadscope.benchmarks.fit import scores
    samples = scores.gather(scores.DETECTED_BY, scores.episodes())
    model = scores.fit(samples)
    text = scores.source(model, samples)  # what `detectors/scoring.py` holds

Only train seeds are used; `reliability` on validation seeds says what the scores are worth.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice, product

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.metrics.calibration import calibration_error, excess
from roadscope.benchmarks.metrics.detection import GATE_M
from roadscope.benchmarks.metrics.matching import match
from roadscope.benchmarks.parked import parked_among
from roadscope.benchmarks.suite_files import SPLITS
from roadscope.core import Detections, Pose, Truth
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record
from roadscope.detectors import DETECTORS
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.evidence import FEATURES, features
from roadscope.detectors.pipeline import ClusterDetector
from roadscope.detectors.scoring import Curve, ScoreModel

RIGS = ("lux", "vlp16", "hdl32e", "hdl64e")
SCENARIOS = (
    "motorway", "dense-motorway", "merge", "roundabout", "intersection", "racetrack", "two-way",
    "parking-lot",
)  # fmt: skip
WEATHERS = ("clear", "clear", "rain", "fog")
"""In turn, seed by seed."""
SEEDS = range(300, 312)
DURATION_S = 2.0
EVERY = 6
"""One scan of so many is looked at: those between show the same."""
DETECTED_BY = (
    "cluster?clustering=distance&shape=l-shape",
    "cluster?clustering=distance&shape=rectangle",
    "cluster?clustering=distance",
    "cluster?clustering=pag-range",
)
KNOTS = 7
RIDGE = 1.0
"""Penalty of the squared weights, as if each had been seen to be 0 once."""
STEPS = 60


@dataclass(frozen=True, slots=True, eq=False)
class Samples(Record):
    """Detections that count, and whether they are right.

    values: (N, F) features. right: (N,) bool. missed: eligible objects that none belongs to.
    """

    values: np.ndarray
    right: np.ndarray
    missed: int

    def __post_init__(self) -> None:
        settle_arrays(self, values=(np.float64, ("N", "F")), right=(np.bool_, ("N",)))


def episodes(seeds: Iterable[int] = SEEDS, rigs: Sequence[str] = RIGS) -> list[Episode]:
    """Return every scenario and rig with every seed, weathers in turn; train seeds only."""
    seeds = list(seeds)
    foreign = [seed for seed in seeds if seed not in SPLITS["train"]]
    if foreign:
        raise ValueError(f"scores are fitted on train seeds {SPLITS['train']}, got {foreign}")
    return [
        Episode(scenario, seed, rig, DURATION_S, WEATHERS[seed % len(WEATHERS)])
        for seed, scenario, rig in product(seeds, SCENARIOS, rigs)
    ]


def gather(detectors: Sequence[str], given: Iterable[Episode], every: int = EVERY) -> Samples:
    """Collect what detectors propose in episodes, and what becomes of it.

    detectors: specs of cluster detectors. Detections of objects that are not eligible, of parked
    cars and out of range are neither right nor wrong and left out, as on the boards.
    """
    plugins = [_cluster_detector(spec) for spec in detectors]
    values, right, missed = [np.empty((0, len(FEATURES)))], [np.empty(0, bool)], 0
    for episode in given:
        frames = list(sensed(episode))
        parked = parked_among(episode, [truth for _, truth in frames])
        for frame, truth in islice(frames, every // 2, None, every):
            assert frame.lidar is not None
            mount = frame.calibration.pose(frame.lidar.sensor)
            cloud = Cloud.of(frame.lidar, mount)
            for plugin in plugins:
                found, fates, misses = _judged(plugin, cloud, mount, truth, parked)
                counted = fates >= 0
                values.append(found[counted])
                right.append(fates[counted] > 0)
                missed += misses
    return Samples(np.concatenate(values), np.concatenate(right), missed)


def _cluster_detector(spec: str) -> ClusterDetector:
    plugin = DETECTORS.make(spec)
    if not isinstance(plugin, ClusterDetector):
        raise ValueError(f"{spec}: scores are fitted for cluster detectors")
    return plugin


def _judged(
    detector: ClusterDetector, cloud: Cloud, mount: Pose, truth: Truth, parked: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Return features of all proposals, 1 right, 0 wrong, -1 neither, and the number of misses."""
    vehicles, horizon = detector.propose(cloud, mount.yaw)
    found = features(vehicles, cloud, horizon, float(mount.translation[2]))
    count = len(vehicles)
    boxes = Detections(
        centres=np.array([(*v.centre, v.size[2] / 2) for v in vehicles]).reshape(-1, 3),
        sizes=np.array([v.size for v in vehicles]).reshape(-1, 3),
        yaws=np.array([v.yaw for v in vehicles]),
        categories=np.zeros(count, np.int8),
        scores=np.zeros(count),
        frame="ego",
        stamp_s=truth.stamp_s,
    )
    pairing = Eligibility().pairing(boxes.moved(truth.world_from_ego, "world"), truth, parked)
    fate = match(pairing, GATE_M)
    fates = np.full(count, -1)
    fates[fate.detected], fates[fate.false_alarms] = 1, 0
    return found, fates, len(fate.misses)


def fit(
    samples: Samples,
    names: Sequence[str] = FEATURES,
    *,
    knots: int = KNOTS,
    ridge: float = RIDGE,
) -> ScoreModel:
    """Fit curves by penalised maximum likelihood (Newton's method on the logistic loss).

    names: of the features. Knots lie at quantiles of each feature, so every weight rests on as
    many detections.
    """
    places = [_knots(column, knots) for column in samples.values.T]
    hats = [
        np.column_stack([np.interp(column, place, row) for row in np.eye(len(place))])
        for column, place in zip(samples.values.T, places, strict=True)
    ]
    design = np.column_stack([np.ones(len(samples.right)), *hats])
    weights = _logistic(design, samples.right, ridge)
    split = np.split(weights[1:], np.cumsum([len(place) for place in places])[:-1])
    curves: dict[str, Curve] = {
        name: (tuple(place.tolist()), tuple(np.round(part, 3).tolist()))
        for name, place, part in zip(names, places, split, strict=True)
    }
    return ScoreModel(round(float(weights[0]), 3), curves, tuple(names))


def _knots(column: np.ndarray, count: int) -> np.ndarray:
    places = np.unique(np.round(np.quantile(column, np.linspace(0.01, 0.99, count)), 3))
    if len(places) < 3:
        places = np.unique([column.min(), column.max()])
    return places if len(places) > 1 else np.array([places[0], places[0] + 1])


def _logistic(design: np.ndarray, right: np.ndarray, ridge: float) -> np.ndarray:
    """Return weights; the first column is the constant and not penalised."""
    weights = np.zeros(design.shape[1])
    penalty = np.diag(np.r_[1e-6, np.full(design.shape[1] - 1, ridge)])
    for _ in range(STEPS):
        chance = 1 / (1 + np.exp(-np.clip(design @ weights, -30, 30)))
        slope = design.T @ (right - chance) - penalty @ weights
        curvature = (design * (chance * (1 - chance) + 1e-6)[:, None]).T @ design + penalty
        step = np.linalg.solve(curvature, slope)
        weights = weights + step * min(1.0, 5.0 / np.abs(step).max())
        if np.abs(step).max() < 1e-6:
            break
    return weights


def reliability(model: ScoreModel, samples: Samples) -> tuple[float, float]:
    """Return the expected calibration error and the mean log loss on samples."""
    chance = model.probabilities(samples.values)
    error = calibration_error(excess(chance, samples.right)).value
    lost = -np.log(np.where(samples.right, chance, 1 - chance))
    return error, float(lost.mean())


def source(model: ScoreModel, samples: Samples, by: str = "scores", seeds: range = SEEDS) -> str:
    """Return the text of a module that holds the weights and says what they were fitted on.

    by: the module here that gathered the samples.
    """
    lines = [
        '"""Weights of the score model: constant, and for every feature its knots and log odds.',
        "",
        f"Fitted by `roadscope.benchmarks.fit.{by}` on train seeds",
        f"{seeds.start} to {seeds.stop - 1} of {len(SCENARIOS)} scenarios, rigs {', '.join(RIGS)},",
        "clear, rain and fog:",
        f"{len(samples.right)} detections, {int(samples.right.sum())} of them right.",
        '"""',
        "",
        f"CONSTANT = {model.constant}",
        "CURVES: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {",
    ]
    for name, (knots, weights) in model.curves.items():
        lines += [f'    "{name}": (', f"        {knots},", f"        {weights},", "    ),"]
    return "\n".join([*lines, "}  # fmt: skip", ""])
