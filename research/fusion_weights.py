"""Fits the models of fusion on train seeds: `roadscope/fusion/weights.toml`.

    python -m research.fusion_weights OUT.toml

Half of the images are detected by the imitation of a camera (`noisy-camera`), half by the shipped
`network`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roadscope import CAMERA_DETECTORS, Detections, Episode, ImageDetections
from roadscope.benchmarks.metrics.fusion import match_targets
from roadscope.benchmarks.metrics.ranked_precision import FALSE_ALARM, IGNORED
from roadscope.benchmarks.papers.li2021_pairs import SensorPair, sense_pairs
from roadscope.core.category import families_of
from roadscope.fusion import weights
from roadscope.fusion.assembly import Views, assemble
from roadscope.fusion.candidates import (
    Agreement,
    Candidates,
    camera_alone_features,
    candidate_features,
    lidar_features,
)
from roadscope.fusion.cluster_boxes import ClusterBoxes, features
from roadscope.fusion.evidence import camera_features, camera_masses, lidar_masses
from roadscope.fusion.overlap import ious

SEEDS = range(300, 312)
SCENARIOS, RIGS = ("street", "town-crossing"), ("li2021", "wide")
DURATION_S = 10.0
SCAN_STRIDE = 8
"""One scan of this many is used."""
NOTHING, UNKNOWN = 3, -1
"""Labels of clusters that are no road user, and of those that nobody can label."""
BESIDE_M = 0.4
"""A cluster's centre may lie this far outside of a road user's box. Chosen by hand."""
PARKED_M = 2.8
"""Clusters nearer to a parked car are left out. Chosen by hand."""
JOINT = ("pair", "lidar_only", "camera_only")
ROUNDS = 3
"""Further rounds change nothing that validation seeds show."""
RIDGE = 30.0

Table = dict[str, list[object]]
"""One section of the file: lists of numbers by name."""


def sensed_moments(seeds: Sequence[int]) -> list[SensorPair]:
    """Sense all scenarios with all rigs: clear days, and by turns night and fog."""
    moments: list[SensorPair] = []
    network = CAMERA_DETECTORS.make("network")
    for seed, scenario, rig in product(seeds, SCENARIOS, RIGS):
        for hard in (False, True):
            fog, night = hard and seed % 2 == 1, hard and seed % 2 == 0
            episode = Episode(scenario, seed, rig, DURATION_S, "fog-3" if fog else "clear")
            by_imitation = replace(episode, light="night" if night else "day")
            by_network = replace(episode, faults=("night:2",)) if night else episode
            moments += sense_pairs(by_imitation, every=SCAN_STRIDE)
            moments += sense_pairs(by_network, every=SCAN_STRIDE, detector=network)
    return moments


def fitted_weights(moments: Sequence[SensorPair]) -> dict[str, object]:
    """Fit one after the other: classes of clusters, the camera's reliability, all candidates."""
    table: dict[str, object] = {"lidar_classes": fitted_classes(moments)}
    _use(table)
    detector = ClusterBoxes()
    lidar = [detector.detect(moment.scan) for moment in moments]
    alone = fitted_alone(moments, lidar)
    table |= {"odds": alone.odds, "confusion": alone.confusion}
    _use(table)
    table["camera_ranking"] = fitted_ranking(moments)
    _use(table)
    joint: Table = {}
    for _ in range(ROUNDS):
        joint = fitted_joint(moments, lidar, joint)
    table["odds"] = alone.odds | joint
    return table


def fitted_classes(moments: Sequence[SensorPair]) -> Table:
    """Return multinomial weights of vehicle, cyclist, pedestrian and nothing."""
    parts, labels = [], []
    detector = ClusterBoxes()
    for moment in moments:
        shapes, _ = detector.propose(moment.scan)
        assert moment.scan.lidar is not None
        mount = moment.scan.calibration.pose(moment.scan.lidar.sensor).translation[:2]
        parts.append(features(shapes, mount))
        labels.append(labels_of(shapes, moment))
    values, label = np.concatenate(parts), np.concatenate(labels)
    standard = Standardised.of(values[label != UNKNOWN])
    label = label[label != UNKNOWN]
    return {
        **standard.table(),
        "weights": rounded(multinomial_weights(standard.terms, label)),
        "samples": np.bincount(label, minlength=4).tolist(),
    }


@dataclass(frozen=True, slots=True)
class Standardised:
    """Features for a `SecondOrderModel`: mean and spread (F,), terms of second order (N, T)."""

    mean: np.ndarray
    spread: np.ndarray
    terms: np.ndarray

    @classmethod
    def of(cls, values: np.ndarray) -> Standardised:
        """Standardise (N, F) features."""
        mean, spread = values.mean(axis=0), values.std(axis=0)
        terms = weights.second_order(np.clip((values - mean) / spread, -3, 3))
        return cls(mean, spread, terms)

    def table(self) -> Table:
        """Return what the model needs beside its weights."""
        return {"mean": rounded(self.mean), "spread": rounded(self.spread)}


def labels_of(shapes: np.ndarray, moment: SensorPair) -> np.ndarray:
    """Return the (N,) family of the road user in whose box a cluster lies, `NOTHING` or `UNKNOWN`.

    shapes: (N, ...) boxes of clusters, x and y first, ego frame.
    """
    truth, targets = moment.truth, moment.targets
    label = np.full(len(shapes), NOTHING)
    parked = targets.centres[~targets.eligible & (targets.families == 0)]
    near = np.linalg.norm(shapes[:, None, :2] - parked[None, :, :2], axis=-1) < PARKED_M
    label[near.any(axis=1)] = UNKNOWN
    centres = truth.world_from_ego.inverse().apply(truth.centres)
    yaws = truth.yaws - truth.world_from_ego.yaw
    for k in range(len(truth)):
        cosine, sine = np.cos(yaws[k]), np.sin(yaws[k])
        offsets = shapes[:, :2] - centres[k, :2]
        local = np.abs(offsets @ np.array([[cosine, -sine], [sine, cosine]]))
        inside = (local <= truth.sizes[k, :2] / 2 + BESIDE_M).all(axis=1)
        label[inside] = families_of(truth.categories[k])
    return label


class AloneWeights(NamedTuple):
    """Weights of each sensor alone.

    odds: weights of `lidar_alone` and `camera_masses`. confusion: by sensor, (3, 3) shares.
    """

    odds: Table
    confusion: Table


class SensorView(NamedTuple):
    """Detections of one sensor, which true targets are near each (N, M), and features (N, F)."""

    detections: Detections | ImageDetections
    near: np.ndarray
    features: np.ndarray


def fitted_alone(moments: Sequence[SensorPair], lidar: Sequence[Detections]) -> AloneWeights:
    """Fit weights of LiDAR alone and of the camera's masses, and which family is taken for which.

    A LiDAR detection is right if its target is eligible. A camera detection is right if any road
    user is there, also a parked car or one that is hardly visible.
    """
    samples = {"lidar_alone": RightSamples([], []), "camera_masses": RightSamples([], [])}
    counts = {"lidar": np.full((3, 3), 0.5), "camera": np.full((3, 3), 0.5)}
    for moment, points in zip(moments, lidar, strict=True):
        camera, real = moment.camera, moment.targets
        assert camera is not None
        views = Views.of(points, camera, moment.projection)
        overlaps = ious(camera.boxes, real.image_boxes)
        offsets = points.centres[:, None, :2] - real.centres[None, :, :2]
        distances = np.linalg.norm(offsets, axis=-1)
        sensors = {
            "camera": SensorView(camera, np.asarray(overlaps >= 0.5), camera_features(camera)),
            "lidar": SensorView(points, np.asarray(distances <= 2.0), lidar_features(views)),
        }
        for name, (detections, near, values) in sensors.items():
            hit = np.asarray(near[:, real.eligible]).max(axis=1, initial=False)
            excused = np.asarray(near[:, ~real.eligible]).max(axis=1, initial=False)
            if name == "camera":
                samples["camera_masses"].add(values, hit | excused)
            else:
                counted = (hit | ~excused) & views.in_image
                samples["lidar_alone"].add(values[counted], hit[counted])
            best = np.where(real.eligible, near, False)
            rows = np.flatnonzero(hit)
            reported = families_of(detections.categories[rows])
            true = real.families[best[rows].argmax(axis=1)]
            np.add.at(counts[name], (reported, true), 1)
    return AloneWeights(
        {name: rounded(each.logistic()) for name, each in samples.items()},
        {n: rounded(c / c.sum(axis=1, keepdims=True)) for n, c in counts.items()},
    )


@dataclass(frozen=True, slots=True)
class RightSamples:
    """Parts of (N, F) features and of (N,) bool, which of them are right."""

    features: list[np.ndarray]
    right: list[np.ndarray]

    def add(self, features: np.ndarray, right: np.ndarray) -> None:
        """Add one moment."""
        self.features.append(features)
        self.right.append(right)

    def logistic(self, ridge: float = 1.0) -> np.ndarray:
        """Return the weights of a logistic model of all."""
        return logistic_weights(
            np.concatenate(self.features), np.concatenate(self.right), ridge=ridge
        )


def fitted_ranking(moments: Sequence[SensorPair]) -> Table:
    """Fit the probability that a box of the camera shows a target that no surer box shows."""
    samples = RightSamples([], [])
    for moment in moments:
        views = Views.of(None, moment.camera, moment.projection)
        candidates = Candidates.of(views, Agreement.of(views, moment.projection))
        fate = fates(moment, views, candidates, views.camera.scores)
        values = camera_alone_features(views.camera)
        samples.add(values[fate != IGNORED], fate[fate != IGNORED] != FALSE_ALARM)
    standard = Standardised.of(np.concatenate(samples.features))
    right = np.concatenate(samples.right)
    fitted = logistic_weights(standard.terms[:, 1:], right, ridge=RIDGE)
    return {**standard.table(), "weights": rounded(fitted[:, None])}


def fitted_joint(
    moments: Sequence[SensorPair], lidar: Sequence[Detections], models: Table
) -> Table:
    """Fit weights of pairs and of what one sensor alone detected where both look.

    Of two candidates for one target the one with the higher score counts, the other is a false
    alarm. models: those of the last round, which give the scores; empty in the first round.
    """
    samples = {name: RightSamples([], []) for name in JOINT}
    for moment, points in zip(moments, lidar, strict=True):
        views = Views.of(points, moment.camera, moment.projection)
        agreement = Agreement.of(views, moment.projection)
        candidates = Candidates.of(views, agreement)
        parts = candidate_features(views, agreement, moment.projection, candidates)
        if models:
            odds = [
                weights.OddsModel(np.array(models[name])).odds(part)
                for name, part in zip(JOINT, parts, strict=True)
            ]
            scores = 1 / (1 + np.exp(-np.concatenate(odds)))
        else:
            # Pairs first: a target that both detected needs no second box.
            scores = np.concatenate(
                [
                    np.full(len(candidates.rows), 0.9),
                    0.5 * points.scores[candidates.lidar_only],
                    0.5 * views.camera.scores[candidates.camera_only],
                ]
            )
        fate = fates(moment, views, candidates, scores)
        ends = np.cumsum([len(part) for part in parts])
        for name, part, end in zip(JOINT, parts, ends, strict=True):
            own = fate[end - len(part) : end]
            samples[name].add(part[own != IGNORED], own[own != IGNORED] != FALSE_ALARM)
    return {name: rounded(samples[name].logistic(RIDGE)) for name in JOINT}


def fates(
    moment: SensorPair, views: Views, candidates: Candidates, scores: np.ndarray
) -> np.ndarray:
    """Return (K,) the number of each candidate's target, `FALSE_ALARM` or `IGNORED`."""
    rows, columns = candidates.lidar_rows, candidates.camera_rows
    masses = np.zeros((len(rows), 4))
    masses[rows >= 0] = lidar_masses(views.lidar)[rows[rows >= 0]]
    masses[columns >= 0] = camera_masses(views.camera)[columns[columns >= 0]]
    return match_targets([assemble(views, rows, columns, masses, scores)], [moment.targets]).targets


def logistic_weights(values: np.ndarray, right: np.ndarray, *, ridge: float = 1.0) -> np.ndarray:
    """Return the (1 + F,) weights of a logistic model, the first for the constant."""
    from scipy.optimize import minimize

    terms = np.column_stack([np.ones(len(values)), values])
    signs = np.where(right, 1.0, -1.0)

    def loss_and_slope(w: np.ndarray) -> tuple[float, np.ndarray]:
        margin = signs * (terms @ w)
        slope = -signs / (1 + np.exp(np.clip(margin, -500, 500)))
        loss = float(np.logaddexp(0, -margin).sum() + ridge * w @ w / 2)
        return loss, terms.T @ slope + ridge * w

    fitted: np.ndarray = minimize(loss_and_slope, np.zeros(terms.shape[1]), jac=True).x
    return fitted


def multinomial_weights(terms: np.ndarray, label: np.ndarray, *, ridge: float = 1.0) -> np.ndarray:
    """Return the (T, 3) weights of the log odds of classes 0 to 2 against class 3.

    terms: (N, T). label: (N,) classes 0 to 3.
    """
    from scipy.optimize import minimize

    truth = np.eye(4)[label]

    def loss_and_slope(flat: np.ndarray) -> tuple[float, np.ndarray]:
        w = flat.reshape(-1, 3)
        odds = np.column_stack([terms @ w, np.zeros(len(terms))])
        odds -= odds.max(axis=1, keepdims=True)
        logs = odds - np.log(np.exp(odds).sum(axis=1, keepdims=True))
        slope = terms.T @ (np.exp(logs) - truth)[:, :3] + ridge * w
        return float(-(truth * logs).sum() + ridge * (w**2).sum() / 2), slope.ravel()

    start = np.zeros(terms.shape[1] * 3)
    options = {"maxiter": 1000}
    flat = minimize(loss_and_slope, start, jac=True, method="L-BFGS-B", options=options).x
    fitted: np.ndarray = flat.reshape(-1, 3)
    return fitted


def rounded(values: np.ndarray) -> list[object]:
    """Return values with four digits after the point, as lists."""
    listed: list[object] = np.round(values, 4).tolist()
    return listed


def source(table: dict[str, object], origin: str) -> str:
    """Return the table as TOML."""
    lines = [f'origin = "{origin}"']
    for name, part in table.items():
        assert isinstance(part, dict)
        lines += ["", f"[{name}]", *(f"{key} = {value}" for key, value in part.items())]
    return "\n".join(lines) + "\n"


def _use(table: dict[str, object]) -> None:
    """Have the fusion in this process read its weights from `table`, as far as they are fitted."""
    for cached in (
        weights.lidar_model,
        weights.odds_model,
        weights.confusion,
        weights.ranking_model,
    ):
        cached.cache_clear()
    weights.table = lambda: table  # type: ignore[assignment]


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit and write."""
    parser = argparse.ArgumentParser(
        prog="python -m research.fusion_weights",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("out", type=Path, help="TOML file to write")
    options = parser.parse_args(arguments)
    moments = sensed_moments(SEEDS)
    origin = (
        f"research.fusion_weights on train seeds {SEEDS[0]} to {SEEDS[-1]} of street and "
        f"town-crossing, rigs li2021 and wide, clear, fog-3 and night; cameras: the imitation "
        f"noisy-camera and the shipped network; {len(moments)} moments"
    )
    options.out.write_text(source(fitted_weights(moments), origin), encoding="utf-8")


if __name__ == "__main__":
    main()
