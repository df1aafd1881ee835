"""Fits the curves by which detectors compute the scores of vehicles from what they measure.

    python -m research.detector_scores clusters OUT.py
    python -m research.detector_scores moving OUT.py

`clusters`: constant and curves of `roadscope/detectors/scoring.py`, for detectors of clusters.
`moving`: those of `roadscope/detectors/long_range_scores.py`, for detectors of moving vehicles.

Only train seeds are used; how good the scores are is tested on validation seeds. `clusters` takes
about five minutes on one core, `moving` one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roadscope import DETECTORS, Detections, Episode, Pose, Truth
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import sensed
from roadscope.benchmarks.metrics.detection import GATE_M
from roadscope.benchmarks.metrics.matching import match
from roadscope.benchmarks.parked import parked_among
from roadscope.benchmarks.suite import SPLITS
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.evidence import FEATURES, features
from roadscope.detectors.long_range import LongRangeDetector, detections
from roadscope.detectors.long_range_scores import MOVING_FEATURES
from roadscope.detectors.pipeline import ClusterDetector
from roadscope.detectors.scoring import Curve, ScoreModel
from roadscope.metrics import calibration_error

RIGS = ("lux", "vlp16", "hdl32e", "hdl64e")
SCENARIOS = (
    "motorway",
    "dense-motorway",
    "merge",
    "roundabout",
    "intersection",
    "racetrack",
    "two-way",
    "parking-lot",
)
WEATHERS = ("clear", "clear", "rain", "fog")
"""By turns, seed by seed."""
DURATION_S = 2.0
CLUSTER_STRIDE, MOVING_STRIDE = 6, 2
"""One scan of this many is used: those between show the same."""
CLUSTER_DETECTORS = (
    "cluster?clustering=distance&shape=l-shape",
    "cluster?clustering=distance&shape=rectangle",
    "cluster?clustering=distance",
    "cluster?clustering=pag-range",
)
MOVING_DETECTOR = "long-range"
MOVING_ELIGIBILITY = Eligibility(range_m=(0.0, 80.0), min_returns=5)
"""The rule of the boards for LiDARs that see all around."""
RIDGE = 1.0
"""Penalty of the squared weights, as if each had been measured to be 0 once."""
NEWTON_STEPS = 60


@dataclass(frozen=True, slots=True)
class ScoreStudy:
    """What is fitted.

    features: names of what is measured of a vehicle. knots: of each curve, at most.
    seeds: train seeds of the episodes.
    """

    name: str
    features: Sequence[str]
    knots: int
    seeds: range


CLUSTERS = ScoreStudy("clusters", FEATURES, 7, range(300, 312))
MOVING = ScoreStudy("moving", MOVING_FEATURES, 5, range(300, 306))


@dataclass(frozen=True, slots=True, eq=False)
class ScoreSamples:
    """Detections that count, and whether they are right.

    values: (N, F) features. right: (N,) bool. missed: number of eligible objects not detected.
    """

    values: np.ndarray
    right: np.ndarray
    missed: int


class JudgedProposals(NamedTuple):
    """The proposals of one scan, and which of them are right.

    features: (P, F). fates: (P,) 1 right, 0 wrong, -1 neither. missed: objects not detected.
    """

    features: np.ndarray
    fates: np.ndarray
    missed: int


def cluster_episodes(
    seeds: Iterable[int] = CLUSTERS.seeds, rigs: Sequence[str] = RIGS
) -> list[Episode]:
    """Return every scenario and rig with every seed, weathers by turns; train seeds only."""
    seeds = list(seeds)
    foreign = [seed for seed in seeds if seed not in SPLITS["train"]]
    if foreign:
        raise ValueError(f"scores are fitted on train seeds {SPLITS['train']}, got {foreign}")
    return [
        Episode(scenario, seed, rig, DURATION_S, WEATHERS[seed % len(WEATHERS)])
        for seed, scenario, rig in product(seeds, SCENARIOS, rigs)
    ]


def moving_episodes(seeds: Iterable[int] = MOVING.seeds) -> list[Episode]:
    """Return the episodes of `cluster_episodes` with two of the four rigs each, by turns."""
    return [
        episode
        for episode in cluster_episodes(seeds)
        if (RIGS.index(episode.rig) + SCENARIOS.index(episode.scenario) + episode.seed // 4) % 2
    ]


def cluster_samples(
    specs: Sequence[str], episodes: Iterable[Episode], stride: int = CLUSTER_STRIDE
) -> ScoreSamples:
    """Collect what detectors of clusters propose in episodes, and whether it is right.

    specs: of the detectors. Detections of objects that are not eligible, of parked cars and out of
    range are neither right nor wrong, as on the boards; they are left out.
    """
    detectors = [_cluster_detector(spec) for spec in specs]
    values, right, missed = [np.empty((0, len(FEATURES)))], [np.empty(0, bool)], 0
    for proposals in _judged_scans(detectors, episodes, stride):
        counted = proposals.fates >= 0
        values.append(proposals.features[counted])
        right.append(proposals.fates[counted] > 0)
        missed += proposals.missed
    return ScoreSamples(np.concatenate(values), np.concatenate(right), missed)


def _judged_scans(
    detectors: Sequence[ClusterDetector], episodes: Iterable[Episode], stride: int
) -> Iterator[JudgedProposals]:
    for episode in episodes:
        frames = list(sensed(episode))
        parked = parked_among(episode, [truth for _, truth in frames])
        for frame, truth in islice(frames, stride // 2, None, stride):
            assert frame.lidar is not None
            mount = frame.calibration.pose(frame.lidar.sensor)
            cloud = Cloud.of(frame.lidar, mount)
            for detector in detectors:
                yield _judged(detector, cloud, mount, truth=truth, parked=parked)


def _cluster_detector(spec: str) -> ClusterDetector:
    detector = DETECTORS.make(spec)
    if not isinstance(detector, ClusterDetector):
        raise ValueError(f"{spec}: scores are fitted for cluster detectors")
    return detector


def _judged(
    detector: ClusterDetector, cloud: Cloud, mount: Pose, *, truth: Truth, parked: np.ndarray
) -> JudgedProposals:
    """Return what a detector proposes in a scan, and which of it is right."""
    vehicles, horizon = detector.propose(cloud, mount.yaw)
    measured = features(vehicles, cloud, horizon, float(mount.translation[2]))
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
    return JudgedProposals(measured, fates, len(fate.misses))


def moving_samples(spec: str, episodes: Iterable[Episode]) -> ScoreSamples:
    """Collect what a detector of moving vehicles proposes in episodes, and whether it is right."""
    values, right, missed = [np.empty((0, len(MOVING_FEATURES)))], [np.empty(0, bool)], 0
    for episode in episodes:
        detector, frames = _moving_detector(spec), list(sensed(episode))
        parked = parked_among(episode, [truth for _, truth in frames])
        for number, (frame, truth) in enumerate(frames):
            vehicles, stamp_s = detector.propose(frame)
            if number % MOVING_STRIDE or not vehicles:
                continue
            boxes = detections(vehicles, np.zeros(len(vehicles)), stamp_s)
            moved = boxes.moved(truth.world_from_ego, "world")
            fate = match(MOVING_ELIGIBILITY.pairing(moved, truth, parked), GATE_M)
            measured = np.array([vehicle.features for vehicle in vehicles])
            values += [measured[fate.detected], measured[fate.false_alarms]]
            right.append(np.repeat([True, False], [len(fate.detected), len(fate.false_alarms)]))
            missed += len(fate.misses)
    return ScoreSamples(np.concatenate(values), np.concatenate(right), missed)


def _moving_detector(spec: str) -> LongRangeDetector:
    detector = DETECTORS.make(spec)
    if not isinstance(detector, LongRangeDetector):
        raise ValueError(f"{spec}: these scores are for detectors of moving vehicles")
    detector.reset()
    return detector


def fitted_scores(samples: ScoreSamples, study: ScoreStudy) -> ScoreModel:
    """Return the curves with the greatest penalised likelihood (Newton's method).

    Knots lie at quantiles of each feature, so that each weight rests on as many detections.
    """
    columns = samples.values.T
    knots = [_knots(column, study.knots) for column in columns]
    hats = [
        np.column_stack([np.interp(column, places, row) for row in np.eye(len(places))])
        for column, places in zip(columns, knots, strict=True)
    ]
    design = np.column_stack([np.ones(len(samples.right)), *hats])
    weights = _logistic_weights(design, samples.right)
    parts = np.split(weights[1:], np.cumsum([len(places) for places in knots])[:-1])
    curves: dict[str, Curve] = {
        name: (tuple(places.tolist()), tuple(np.round(part, 3).tolist()))
        for name, places, part in zip(study.features, knots, parts, strict=True)
    }
    return ScoreModel(round(float(weights[0]), 3), curves, tuple(study.features))


def _knots(column: np.ndarray, count: int) -> np.ndarray:
    places = np.unique(np.round(np.quantile(column, np.linspace(0.01, 0.99, count)), 3))
    if len(places) < 3:
        places = np.unique([column.min(), column.max()])
    return places if len(places) > 1 else np.array([places[0], places[0] + 1])


def _logistic_weights(design: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return weights; the first column is the constant and not penalised."""
    weights = np.zeros(design.shape[1])
    penalty = np.diag(np.r_[1e-6, np.full(design.shape[1] - 1, RIDGE)])
    for _ in range(NEWTON_STEPS):
        chance = 1 / (1 + np.exp(-np.clip(design @ weights, -30, 30)))
        slope = design.T @ (right - chance) - penalty @ weights
        curvature = (design * (chance * (1 - chance) + 1e-6)[:, None]).T @ design + penalty
        step = np.linalg.solve(curvature, slope)
        weights = weights + step * min(1.0, 5.0 / np.abs(step).max())
        if np.abs(step).max() < 1e-6:
            break
    return weights


class Reliability(NamedTuple):
    """Expected calibration error and mean log loss."""

    calibration_error: float
    log_loss: float


def reliability(model: ScoreModel, samples: ScoreSamples) -> Reliability:
    """Return how far a model's scores can be trusted on samples."""
    chance = model.probabilities(samples.values)
    losses = -np.log(np.where(samples.right, chance, 1 - chance))
    return Reliability(float(calibration_error(chance, samples.right).value), float(losses.mean()))


def source(model: ScoreModel, samples: ScoreSamples, study: ScoreStudy) -> str:
    """Return the text of a module that holds the curves and says what they were fitted on."""
    lines = [
        '"""Weights of the score model: constant, and for every feature its knots and log odds.',
        "",
        f"Fitted by `research.detector_scores {study.name}` on train seeds",
        f"{study.seeds.start} to {study.seeds.stop - 1} of {len(SCENARIOS)} scenarios, "
        f"rigs {', '.join(RIGS)},",
        "clear, rain and fog:",
        f"{len(samples.right)} detections, {int(samples.right.sum())} of them right.",
        '"""',
        "",
        f"CONSTANT = {model.constant}",
        "CURVES: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {",
    ]
    for name, (knots, weights) in model.curves.items():
        lines += [f'    "{name}": (', f"        {knots},", f"        {weights},", "    ),"]
    return "\n".join([*lines, "}", ""])


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit and write a module."""
    parser = argparse.ArgumentParser(
        prog="python -m research.detector_scores",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("what", choices=(CLUSTERS.name, MOVING.name))
    parser.add_argument("out", type=Path, help="module to write")
    options = parser.parse_args(arguments)
    if options.what == CLUSTERS.name:
        study, samples = CLUSTERS, cluster_samples(CLUSTER_DETECTORS, cluster_episodes())
    else:
        study, samples = MOVING, moving_samples(MOVING_DETECTOR, moving_episodes())
    model = fitted_scores(samples, study)
    options.out.write_text(source(model, samples, study), encoding="utf-8")
    error, loss = reliability(model, samples)
    print(
        f"{len(samples.right)} detections; on them calibration error {error:.3f}, loss {loss:.3f}"
    )


if __name__ == "__main__":
    main()
