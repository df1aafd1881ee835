"""Fits what fusion knows of its sensors on train seeds: `roadscope/fusion/weights.toml`.

Run as `python -m roadscope.benchmarks.fit.fusion PATH`; the cameras are the imitation
`noisy-camera` and the shipped `network`, with as many moments each.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.metrics.average_precision import FALSE_ALARM, IGNORED
from roadscope.benchmarks.metrics.fusion import match_targets
from roadscope.benchmarks.noisy_camera import FAMILY
from roadscope.benchmarks.papers.li2021_scene import Moment, film
from roadscope.core import Detections, ImageDetections
from roadscope.detectors.camera import CAMERA_DETECTORS
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
from roadscope.fusion.evidence import camera_features, camera_masses, families_of, lidar_masses
from roadscope.fusion.overlap import ious

SEEDS = range(300, 312)
SCENARIOS, RIGS = ("street", "town-crossing"), ("li2021", "wide")
NOTHING, UNKNOWN = 3, -1
BESIDE_M = 0.4
JOINT = ("pair", "lidar_only", "camera_only")
ROUNDS = 3
"""After so many, another changes nothing that validation seeds show."""
RIDGE = 30.0


def moments_of(seeds: Sequence[int]) -> list[Moment]:
    """Sense all scenarios with all rigs; clear, and in turn night and fog."""
    found = []
    detector = CAMERA_DETECTORS.make("network")
    for seed, scenario, rig in product(seeds, SCENARIOS, RIGS):
        for dull in (False, True):
            fog, night = dull and seed % 2 == 1, dull and seed % 2 == 0
            episode = Episode(scenario, seed, rig, 10.0, "fog-3" if fog else "clear")
            found += film(replace(episode, light="night" if night else "day"), every=8)
            seen = replace(episode, faults=("night:2",)) if night else episode
            found += film(seen, every=8, detector=detector)
    return found


def fit(moments: Sequence[Moment]) -> dict[str, object]:
    """Fit one after the other: classes of clusters, the camera's reliability, all candidates."""
    table: dict[str, object] = {"lidar_classes": fit_classes(moments)}
    _use(table)
    detector = ClusterBoxes()
    lidar = [detector.detect(moment.scan) for moment in moments]
    odds, confusion = fit_alone(moments, lidar)
    table |= {"odds": odds, "confusion": confusion}
    _use(table)
    table["camera_ranking"] = fit_ranking(moments)
    _use(table)
    joint: dict[str, list[object]] = {}
    for _ in range(ROUNDS):
        joint = fit_joint(moments, lidar, joint)
    odds |= joint
    return table


def fit_classes(moments: Sequence[Moment]) -> dict[str, list[object]]:
    """Multinomial weights of vehicle, cyclist, pedestrian and nothing."""
    parts, labels = [], []
    detector = ClusterBoxes()
    for moment in moments:
        shapes, _ = detector.propose(moment.scan)
        assert moment.scan.lidar is not None
        mount = moment.scan.calibration.pose(moment.scan.lidar.sensor).translation[:2]
        parts.append(features(shapes, mount))
        labels.append(labels_of(shapes, moment))
    values, label = np.concatenate(parts), np.concatenate(labels)
    values, label = values[label != UNKNOWN], label[label != UNKNOWN]
    mean, spread = values.mean(axis=0), values.std(axis=0)
    terms = weights.second_order(np.clip((values - mean) / spread, -3, 3))
    found = multinomial(terms, label)
    return {
        "mean": rounded(mean), "spread": rounded(spread), "weights": rounded(found),
        "samples": np.bincount(label, minlength=4).tolist(),
    }  # fmt: skip


def labels_of(shapes: np.ndarray, moment: Moment) -> np.ndarray:
    """(N,) family of the road user in whose box a cluster lies, `NOTHING`, or `UNKNOWN`."""
    truth, targets = moment.truth, moment.targets
    label = np.full(len(shapes), NOTHING)
    parked = targets.centres[~targets.eligible & (targets.families == 0)]
    near = np.linalg.norm(shapes[:, None, :2] - parked[None, :, :2], axis=-1) < 2.8
    label[near.any(axis=1)] = UNKNOWN
    centres = truth.world_from_ego.inverse().apply(truth.centres)
    yaws = truth.yaws - truth.world_from_ego.yaw
    for k in range(len(truth)):
        cosine, sine = np.cos(yaws[k]), np.sin(yaws[k])
        off = shapes[:, :2] - centres[k, :2]
        local = np.abs(off @ np.array([[cosine, -sine], [sine, cosine]]))
        inside = (local <= truth.sizes[k, :2] / 2 + BESIDE_M).all(axis=1)
        label[inside] = FAMILY[truth.categories[k]]
    return label


def fit_alone(
    moments: Sequence[Moment], lidar: Sequence[Detections]
) -> tuple[dict[str, list[object]], dict[str, list[object]]]:
    """Weights of LiDAR alone and of the camera's masses, and who is taken for whom.

    A target of LiDAR alone is to be one that counts. The camera's masses tell whether somebody is
    there, a parked car or one that is hardly seen too.
    """
    features_of: dict[str, list[np.ndarray]] = {"lidar_alone": [], "camera_masses": []}
    right: dict[str, list[np.ndarray]] = {"lidar_alone": [], "camera_masses": []}
    counts = {"lidar": np.full((3, 3), 0.5), "camera": np.full((3, 3), 0.5)}
    for moment, points in zip(moments, lidar, strict=True):
        camera, real = moment.camera, moment.targets
        assert camera is not None
        views = Views.of(points, camera, moment.projection)
        overlap = ious(camera.boxes, real.image_boxes)
        apart = np.linalg.norm(points.centres[:, None, :2] - real.centres[None, :, :2], axis=-1)
        in_image, in_space = np.asarray(overlap >= 0.5), np.asarray(apart <= 2.0)
        sensors: tuple[tuple[str, np.ndarray, Detections | ImageDetections, np.ndarray], ...] = (
            ("camera", in_image, camera, camera_features(camera)),
            ("lidar", in_space, points, lidar_features(views)),
        )
        for name, near, found, values in sensors:
            hit = np.asarray(near[:, real.eligible]).max(axis=1, initial=False)
            excused = np.asarray(near[:, ~real.eligible]).max(axis=1, initial=False)
            if name == "camera":
                features_of["camera_masses"].append(values)
                right["camera_masses"].append(hit | excused)
            else:
                counted = (hit | ~excused) & views.in_image
                features_of["lidar_alone"].append(values[counted])
                right["lidar_alone"].append(hit[counted])
            best = np.where(real.eligible, near, False)
            rows = np.flatnonzero(hit)
            np.add.at(
                counts[name],
                (families_of(found.categories[rows]), real.families[best[rows].argmax(axis=1)]),
                1,
            )  # fmt: skip
    odds = {
        name: rounded(logistic(np.concatenate(features_of[name]), np.concatenate(right[name])))
        for name in features_of
    }
    shares = {n: rounded(c / c.sum(axis=1, keepdims=True)) for n, c in counts.items()}
    return odds, shares


def fit_ranking(moments: Sequence[Moment]) -> dict[str, list[object]]:
    """Weights of the chance that a box of a camera alone is a target's, and the first of it."""
    values, right = [], []
    for moment in moments:
        views = Views.of(None, moment.camera, moment.projection)
        candidates = Candidates.of(views, Agreement.of(views, moment.projection))
        fate = fates(moment, views, candidates, views.camera.scores)
        values.append(camera_alone_features(views.camera)[fate != IGNORED])
        right.append(fate[fate != IGNORED] != FALSE_ALARM)
    every = np.concatenate(values)
    mean, spread = every.mean(axis=0), every.std(axis=0)
    terms = weights.second_order(np.clip((every - mean) / spread, -3, 3))[:, 1:]
    found = logistic(terms, np.concatenate(right), ridge=RIDGE)
    return {
        "mean": rounded(mean), "spread": rounded(spread), "weights": rounded(found[:, None])
    }  # fmt: skip


def fit_joint(
    moments: Sequence[Moment], lidar: Sequence[Detections], models: dict[str, list[object]]
) -> dict[str, list[object]]:
    """Weights of pairs and of what one sensor alone found while both were there.

    Of two that stand for one target the surer counts, the other is a false alarm: who is surer is
    what `models` of the last round say, where there are any.
    """
    values: dict[str, list[np.ndarray]] = {name: [] for name in JOINT}
    right: dict[str, list[np.ndarray]] = {name: [] for name in JOINT}
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
            # Pairs first: what is left of a target that both found is a second box.
            scores = np.concatenate(
                [
                    np.full(len(candidates.rows), 0.9), 0.5 * points.scores[candidates.lidar_only],
                    0.5 * views.camera.scores[candidates.camera_only],
                ]
            )  # fmt: skip
        fate = fates(moment, views, candidates, scores)
        ends = np.cumsum([len(part) for part in parts])
        for name, part, end in zip(JOINT, parts, ends, strict=True):
            mine = fate[end - len(part) : end]
            values[name].append(part[mine != IGNORED])
            right[name].append(mine[mine != IGNORED] != FALSE_ALARM)
    return {
        name: rounded(
            logistic(np.concatenate(values[name]), np.concatenate(right[name]), ridge=RIDGE)
        )
        for name in JOINT
    }


def fates(
    moment: Moment, views: Views, candidates: Candidates, scores: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Return (K,) the number of each candidate's target, `FALSE_ALARM` or `IGNORED`."""
    rows, columns = candidates.lidar_rows, candidates.camera_rows
    masses = np.zeros((len(rows), 4))
    masses[rows >= 0] = lidar_masses(views.lidar)[rows[rows >= 0]]
    masses[columns >= 0] = camera_masses(views.camera)[columns[columns >= 0]]
    return match_targets([assemble(views, rows, columns, masses, scores)], [moment.targets]).targets


def logistic(values: np.ndarray, right: np.ndarray, *, ridge: float = 1.0) -> np.ndarray:
    """(1 + F,) weights of a logistic model, the first for the constant."""
    from scipy.optimize import minimize

    terms = np.column_stack([np.ones(len(values)), values])
    signs = np.where(right, 1.0, -1.0)

    def loss(w: np.ndarray) -> tuple[float, np.ndarray]:
        margin = signs * (terms @ w)
        slope = -signs / (1 + np.exp(np.clip(margin, -500, 500)))
        return float(
            np.logaddexp(0, -margin).sum() + ridge * w @ w / 2
        ), terms.T @ slope + ridge * w

    found: np.ndarray = minimize(loss, np.zeros(terms.shape[1]), jac=True).x
    return found


def multinomial(terms: np.ndarray, label: np.ndarray, *, ridge: float = 1.0) -> np.ndarray:
    """(T, 3) log odds of classes 0 to 2 against class 3."""
    from scipy.optimize import minimize

    truth = np.eye(4)[label]

    def loss(flat: np.ndarray) -> tuple[float, np.ndarray]:
        w = flat.reshape(-1, 3)
        odds = np.column_stack([terms @ w, np.zeros(len(terms))])
        odds -= odds.max(axis=1, keepdims=True)
        logs = odds - np.log(np.exp(odds).sum(axis=1, keepdims=True))
        slope = terms.T @ (np.exp(logs) - truth)[:, :3] + ridge * w
        return float(-(truth * logs).sum() + ridge * (w**2).sum() / 2), slope.ravel()

    start = np.zeros(terms.shape[1] * 3)
    found = minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 1000}).x
    weights_found: np.ndarray = found.reshape(-1, 3)
    return weights_found


def rounded(values: np.ndarray) -> list[object]:
    """Four digits after the point, as lists."""
    listed: list[object] = np.round(values, 4).tolist()
    return listed


def written(table: dict[str, object], origin: str) -> str:
    """Return the table as TOML."""
    lines = [f'origin = "{origin}"']
    for name, part in table.items():
        assert isinstance(part, dict)
        lines += ["", f"[{name}]", *(f"{key} = {value}" for key, value in part.items())]
    return "\n".join(lines) + "\n"


def _use(table: dict[str, object]) -> None:
    for cached in (
        weights.lidar_model, weights.odds_model, weights.confusion, weights.ranking_model,
    ):  # fmt: skip
        cached.cache_clear()
    weights.table = lambda: table  # type: ignore[assignment]


def main() -> None:
    """Fit and write."""
    moments = moments_of(SEEDS)
    origin = (
        f"benchmarks.fit.fusion on train seeds {SEEDS[0]} to {SEEDS[-1]} of street and "
        f"town-crossing, rigs li2021 and wide, clear, fog-3 and night; cameras: the imitation "
        f"noisy-camera and the shipped network; {len(moments)} moments"
    )
    Path(sys.argv[1]).write_text(written(fit(moments), origin), encoding="utf-8")


if __name__ == "__main__":
    main()
