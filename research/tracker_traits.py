"""Learns a detector's errors and scores, and how road users move: `roadscope/trackers/learned`.

    python -m research.tracker_traits pointrcnn.toml --kitti DIR [--sequences 0000,0002]
    python -m research.tracker_traits mine.toml --detector distance-l-shape
    python -m research.tracker_traits fused.toml --detector "fused?lidar=cluster-boxes"
        --scenarios street,town-crossing --rigs wide --seeds 4 --guess-existence

From a KITTI folder with detections and labels, otherwise from train seeds of simulated traffic.
The tracker `existence` reads the file: `existence?traits=mine.toml`.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from research.tracker_existence import (
    COAST_S,
    PERSISTENCE,
    SHARES,
    ClassTraits,
    persistence_on_kitti,
    persistence_on_traffic,
)
from research.tracker_samples import (
    CLASSES,
    GATES_M,
    LAGS_S,
    CollectedSamples,
    KittiSource,
    TrackedInput,
    TrafficSource,
    TraitSamples,
    of_class,
    recorded_pairings,
    recorded_samples,
    simulated_samples,
    tracker_input,
    traffic_episodes,
)
from roadscope import Tracks, Truth
from roadscope.benchmarks.metrics.matching import Pairing, match
from roadscope.benchmarks.metrics.tracking.state_accuracy import FrameRows, nees, state_errors
from roadscope.trackers import ExistenceTracker
from roadscope.trackers._traits import FOLDER, TRAITS

TOP_SPEED_M_S = {"car": 40.0, "cyclist": 20.0, "pedestrian": 10.0}
"""Not learned: a faster road user is possible though no training data have one."""
LEAST_CHANGE_SHARE = 0.015
"""Velocities change by at least this share of the top speed in a second: training data have few
hard brakings, and the visible part of a body changes. Chosen by hand."""
GROWTHS = np.arange(0.0, 0.1005, 0.001)
"""Per metre; the likeliest is taken."""
LEAST_SAMPLES = 30
"""A class with fewer is not learned."""
FLAT_DECILES = np.linspace(-46.0, 46.0, 11).round(1).tolist()
"""Deciles of log odds that make no score likely."""
LEAST_LASTING_S, MOST_LASTING_S = 0.3, 10.0
"""Bounds of the time in which errors decorrelate."""
MOST_LASTING = 0.9
"""Some part of an error is new in every tick."""
LEAST = 0.01
"""Of every standard deviation and share."""
TINY = 1e-9
"""In place of a standard deviation of 0."""
DECILES = np.linspace(0, 1, 11)
NEWTON_STEPS = 100
LONGEST_STEP = 0.25
"""Newton's method overshoots where most scores are near 0 or 1."""
PRIOR = 1.0
"""Weight of calibrated scores, as if each end of the curve had one more sample."""
FRAMES_ALIKE = 10
"""Successive frames are correlated: this many count as one."""
RANGE_UNIT_M = 30.0
FOLDS = 5
LEAST_GAIN = 0.1
"""Share by which range must lower the log loss on folds that it was not fitted to."""
FITTED = TRAITS[: TRAITS.index("top_speed_m_s")]
MOTION = TRAITS[TRAITS.index("accelerate_m_s2") : TRAITS.index("top_speed_m_s")]
PRIOR_OBJECTS = 5.0
"""Objects of all classes together that each class has in addition, for its surplus."""


def fitted(samples: TraitSamples, top_speed_m_s: float) -> dict[str, float]:
    """Return the traits of one class but its top speed."""
    growth, sigmas = spread(samples.errors, samples.ranges_m)
    calibration = calibrated(samples.judged)
    walks = np.sqrt((samples.changes**2 / samples.periods_s[:, None]).mean(axis=0))
    walks[:2] = np.maximum(walks[:2], LEAST_CHANGE_SHARE * top_speed_m_s)
    position = lasting(samples.pairs[:, [0, 1, 2, 4, 5]])
    heading = lasting(samples.pairs[:, [0, 3, 6]])
    values = [
        *calibration,
        *np.maximum(sigmas, LEAST),
        max(growth, 1e-3),
        *position,
        heading.share,
        *np.maximum(walks, LEAST),
        *_speeds(samples),
    ]
    return dict(zip(FITTED, (round(float(v), 4) for v in values), strict=True))


class LastingErrors(NamedTuple):
    """Share of the variance of errors that lasts, and in which time it decays to 1/e."""

    share: float
    time_s: float


def lasting(pairs: np.ndarray) -> LastingErrors:
    """Return which part of the errors lasts and how long.

    pairs: (E, 1 + 2 K) seconds between two detections, K errors of the one and of the other.
    The correlation of errors is share * exp(-lag / time); it is known at two lags.
    """
    correlations = []
    for lag in LAGS_S:
        first, second = np.split(pairs[pairs[:, 0] == lag, 1:], 2, axis=1)
        scale = np.sqrt((first**2).mean(axis=0) * (second**2).mean(axis=0)) if len(first) else 1.0
        scale = np.maximum(scale, TINY)
        correlations.append(float(((first * second) / scale).mean()) if len(first) else 0.0)
    short, long = np.clip(correlations, LEAST, 1 - LEAST)
    decay_s = np.diff(LAGS_S)[0] / np.log(max(short / long, 1.01))
    time_s = float(np.clip(decay_s, LEAST_LASTING_S, MOST_LASTING_S))
    return LastingErrors(float(min(short * np.exp(LAGS_S[0] / time_s), MOST_LASTING)), time_s)


def _speeds(samples: TraitSamples) -> tuple[float, float, float, float]:
    """Return speed_m_s, cruise_m_s, aside_m_s and front of `DetectorTraits`."""
    along, across = samples.velocities.T
    usual = max(float(np.sqrt((samples.velocities**2).sum(axis=1).mean())), 1.0)
    cruise, aside = max(float(along.mean()), LEAST), max(float(np.sqrt((across**2).mean())), 0.1)
    front = (samples.fronts.sum() + PRIOR) / (len(samples.fronts) + 2 * PRIOR)
    return usual, cruise, aside, float(front)


def spread(errors: np.ndarray, ranges_m: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the likeliest growth per metre and (4,) standard deviations of (N, 4) errors.

    At a range of r metres errors have a standard deviation of s * (1 + growth * r).
    """
    best = (-np.inf, 0.0, np.zeros(errors.shape[1]))
    for growth in GROWTHS:
        factor = 1 + growth * ranges_m
        sigmas = np.sqrt(((errors / factor[:, None]) ** 2).mean(axis=0))
        likelihood = (
            -np.log(np.maximum(sigmas, TINY)).sum() - errors.shape[1] * np.log(factor).mean()
        )
        if likelihood > best[0]:
            best = (likelihood, float(growth), sigmas)
    return best[1], best[2]


class RangedCalibration(NamedTuple):
    """Log odds of being right: slope * log odds of the score + offset + per_m * range."""

    slope: float
    offset: float
    per_m: float


def calibrated(judged: np.ndarray) -> RangedCalibration:
    """Return what the log odds of being right are (Platt 1999).

    judged: (J, 3) log odds of scores, ranges in metres, 1 for right and 0 for wrong. Range is left
    out where it does not help on folds that it was not fitted to.
    """
    design = np.column_stack([judged[:, 0], np.ones(len(judged)), judged[:, 1] / RANGE_UNIT_M])
    right = judged[:, 2]
    without_range = design[:, :2]
    limit = (1 - LEAST_GAIN) * _cross_validated_loss(without_range, right)
    uses_range = _cross_validated_loss(design, right) < limit
    weights = _logistic(design if uses_range else without_range, right)
    per_m = float(weights[2]) / RANGE_UNIT_M if uses_range else 0.0
    return RangedCalibration(max(float(weights[0]), 0.05), float(weights[1]), per_m)


def _cross_validated_loss(design: np.ndarray, right: np.ndarray) -> float:
    """Return the log loss on each fold, in order of time, with weights fitted to the others."""
    fold = np.arange(len(right)) * FOLDS // max(len(right), 1)
    loss = 0.0
    for k in range(FOLDS):
        log_odds = design[fold == k] @ _logistic(design[fold != k], right[fold != k])
        signed = np.where(right[fold == k] > 0, -log_odds, log_odds)
        loss += float(np.logaddexp(0, signed).sum())
    return loss


def _logistic(design: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return weights, by Newton's method, of columns whose first is the log odds of scores."""
    start = np.zeros(design.shape[1])
    start[0] = 1.0
    weights = start.copy()
    for _ in range(NEWTON_STEPS):
        chance = 1 / (1 + np.exp(-np.clip(design @ weights, -30, 30)))
        slope = design.T @ (right - chance) / FRAMES_ALIKE - PRIOR * (weights - start)
        curvature = (design * (chance * (1 - chance) / FRAMES_ALIKE)[:, None]).T @ design
        step = np.linalg.solve(curvature + PRIOR * np.eye(len(start)), slope)
        weights = weights + step * min(1.0, LONGEST_STEP / max(np.abs(step).max(), 1e-12))
    return weights


def source(collected: CollectedSamples, existence: ClassTraits | None = None) -> str:
    """Return the text of a file of `roadscope/trackers/learned`.

    A class with too few samples gets the detection errors of the class with most samples, guessed
    motion, and flat distributions of scores.
    existence: of each class the traits that `tracker_existence` learned; left out, guesses.
    """
    classes = collected.classes
    guessed = tomllib.loads((FOLDER / "unknown.toml").read_text("utf-8"))
    most = max(classes, key=lambda name: len(classes[name].errors))
    lines = [f'origin = "{collected.origin}"']
    for name, samples in classes.items():
        enough = min(len(samples.errors), len(samples.changes)) >= LEAST_SAMPLES
        used = name if enough else most
        section = {
            "scores": len(classes[used].log_odds),
            "log_odds_deciles": np.quantile(classes[used].log_odds, DECILES).round(2).tolist(),
            **fitted(classes[used], TOP_SPEED_M_S[used]),
            "top_speed_m_s": TOP_SPEED_M_S[name],
            **(existence[used] if existence else PERSISTENCE | SHARES),
        }
        remark = f"{len(samples.errors)} detections"
        if not enough:
            section |= {trait: guessed[name][trait] for trait in MOTION}
            section |= {"scores": 0, "log_odds_deciles": FLAT_DECILES}
            remark += f", too few: as {most}, moving as in unknown.toml"
        if all(section[t] in (guess, guessed[name][t]) for t, guess in PERSISTENCE.items()):
            remark += "; how belief changes is guessed"
        lines += ["", f"[{name}] # {remark}"]
        lines += [f"{trait} = {value}" for trait, value in section.items()]
    return "\n".join([*lines, ""])


def guessed_persistence(_: str) -> ClassTraits:
    """Return for each class the guesses of `unknown.toml` in place of learned traits.

    On validation seeds of street and town-crossing HOTA on fused detections was 0.67 with the
    guesses and 0.63 with what was learned.
    """
    known = tomllib.loads((FOLDER / "unknown.toml").read_text("utf-8"))
    traits = [trait for trait in (*PERSISTENCE, *SHARES) if trait != "surplus"]
    return {
        kind: {**{trait: known[kind][trait] for trait in traits}, "surplus": 1.0}
        for kind in TOP_SPEED_M_S
    }


# How much more tracks err than their filter says: errors that last as long as a track, boxes of
# cut-off bodies and errors of labels are in no model.


class NeesRatios(NamedTuple):
    """NEES of positions over its degrees of freedom, (K,), and of how many objects it is."""

    ratios: np.ndarray
    objects: int


def surplus_on_kitti(source: KittiSource, traits: str) -> dict[str, float]:
    """Return `DetectorTraits.surplus` of each class; `traits` is a file in which it is 1."""
    classes = {}
    for kind, category in CLASSES.items():
        parts = []
        for sequence in source.read(category):
            tracks = confirmed_tracks(
                TrackedInput(sequence.detections, sequence.world_from_ego), traits
            )
            pairings = recorded_pairings([each.centres for each in tracks], sequence)
            parts.append(_ratios(tracks, sequence.truths, pairings, GATES_M[kind]))
        classes[kind] = _together(parts)
    return shrunk_surplus(classes)


def surplus_on_traffic(source: TrafficSource, traits: str) -> dict[str, float]:
    """Return the same from train seeds of our traffic."""
    parts: dict[str, list[NeesRatios]] = {kind: [] for kind in CLASSES}
    for episode in traffic_episodes(source):
        for kind, collected in parts.items():
            own, rule = of_class(kind, episode)
            tracks = confirmed_tracks(tracker_input(own), traits)
            pairings = rule.pairings(tracks, own.truths, own.parked)
            collected.append(_ratios(tracks, own.truths, pairings, GATES_M[kind]))
    return shrunk_surplus({kind: _together(some) for kind, some in parts.items()})


def confirmed_tracks(tracker_inputs: TrackedInput, traits: str) -> list[Tracks]:
    """Return the confirmed tracks of `ExistenceTracker`."""
    tracker = ExistenceTracker(traits=traits, coast_known_s=COAST_S)
    history = [
        tracker.update(detections, pose)
        for detections, pose in zip(tracker_inputs.detections, tracker_inputs.poses, strict=True)
    ]
    return [tracks.sure for tracks in history]


def _ratios(
    tracks: Sequence[Tracks], truths: Sequence[Truth], pairings: Sequence[Pairing], gate_m: float
) -> NeesRatios:
    fates = [match(pairing, gate_m) for pairing in pairings]
    objects = {int(i) for t, fate in zip(truths, fates, strict=True) for i in t.ids[fate.truth]}
    errors = state_errors(tracks, truths, [FrameRows(fate.detected, fate.truth) for fate in fates])
    result = nees(errors)
    return NeesRatios(result.values / result.freedom, len(objects))


def _together(parts: Sequence[NeesRatios]) -> NeesRatios:
    ratios = np.concatenate([part.ratios for part in parts])
    return NeesRatios(ratios, sum(part.objects for part in parts))


def shrunk_surplus(classes: Mapping[str, NeesRatios]) -> dict[str, float]:
    """Return means drawn towards that of all classes, as with `PRIOR_OBJECTS` more objects each.

    At least 1: by how much filters overstate errors differs from one data set to another.
    """
    everything = float(np.concatenate([each.ratios for each in classes.values()]).mean())
    surplus = {}
    for kind, (ratios, objects) in classes.items():
        total = objects * float(ratios.mean()) if len(ratios) else 0.0
        count = (objects if len(ratios) else 0) + PRIOR_OBJECTS
        surplus[kind] = round(max((total + PRIOR_OBJECTS * everything) / count, 1.0), 2)
    return surplus


# The command


def learn(
    out: Path,
    collected: CollectedSamples,
    learned_existence: Callable[[str], ClassTraits],
    learned_surplus: Callable[[str], dict[str, float]],
) -> None:
    """Write a file of traits, in three steps: each step tracks with what is learned so far.

    learned_existence, learned_surplus: learn traits of each class with a file of traits.
    """
    out.write_text(source(collected), "utf-8")
    existence = learned_existence(str(out))
    out.write_text(source(collected, existence), "utf-8")
    surplus = learned_surplus(str(out))
    existence = {kind: {**each, "surplus": surplus[kind]} for kind, each in existence.items()}
    out.write_text(source(collected, existence), "utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m research.tracker_traits",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("out", type=Path, help="TOML file to write")
    parser.add_argument(
        "--kitti", type=Path, help="folder with label_02, det_NAME, ego_pose, calib"
    )
    parser.add_argument("--sequences", help="comma separated; all when left out")
    parser.add_argument("--detector", help="spec of a detector, or NAME of det_NAME")
    parser.add_argument(
        "--seeds", type=int, default=1, help="number of train seeds of our traffic, from 400 on"
    )
    parser.add_argument("--scenarios", help="of our traffic, comma separated")
    parser.add_argument("--rigs", help="comma separated")
    parser.add_argument(
        "--guess-existence",
        action="store_true",
        help="do not learn how belief in targets changes: take what unknown.toml guesses",
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> None:
    """Write a file of traits."""
    options = _parser().parse_args(arguments)
    if options.kitti is not None:
        names = options.sequences.split(",") if options.sequences else None
        kitti = KittiSource(options.kitti, names, options.detector)
        on_kitti = partial(persistence_on_kitti, kitti)
        existence = guessed_persistence if options.guess_existence else on_kitti
        learn(options.out, recorded_samples(kitti), existence, partial(surplus_on_kitti, kitti))
        return
    usual = TrafficSource()
    traffic = TrafficSource(
        options.detector or usual.detector,
        options.seeds,
        tuple(options.scenarios.split(",")) if options.scenarios else usual.scenarios,
        tuple(options.rigs.split(",")) if options.rigs else usual.rigs,
    )
    on_traffic = partial(persistence_on_traffic, traffic)
    existence = guessed_persistence if options.guess_existence else on_traffic
    learn(options.out, simulated_samples(traffic), existence, partial(surplus_on_traffic, traffic))


if __name__ == "__main__":
    main()
