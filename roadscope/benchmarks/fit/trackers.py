"""Learns a detector's errors and scores, and how road users move: `roadscope/trackers/learned`.

    python -m roadscope.benchmarks.fit.trackers pointrcnn.toml --kitti DIR [--sequences 0000,0002]
    python -m roadscope.benchmarks.fit.trackers mine.toml --detector distance-l-shape
    python -m roadscope.benchmarks.fit.trackers fused.toml --detector "fused?lidar=cluster-boxes"
        --scenarios street,town-crossing --rigs wide --seeds 4 --guess-existence

With a KITTI folder from its detections and labels, otherwise from train seeds of our traffic.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from roadscope.benchmarks.fit.tracker_persistence import (
    PERSISTENCE,
    SHARES,
    recorded_persistence,
    sensed_persistence,
)
from roadscope.benchmarks.fit.tracker_samples import (
    LAGS_S,
    Drives,
    Samples,
    recorded_samples,
    sensed_samples,
)
from roadscope.benchmarks.fit.tracker_surplus import recorded_surplus, sensed_surplus
from roadscope.trackers._traits import FOLDER, TRAITS

TOP_SPEED_M_S = {"car": 40.0, "cyclist": 20.0, "pedestrian": 10.0}
"""Not learned: what a training set happens not to hold is not impossible."""
LEAST_WALK_S = 0.015
"""Velocities wander by at least this share of the top speed in a second: training sets hold few
hard brakings, and what is detected of a body wanders over it."""
GROWTHS = np.arange(0.0, 0.1005, 0.001)
"""Per metre; the likeliest is taken."""
LEAST_SAMPLES = 30
"""Fewer say nothing of a class."""
UNFORETOLD = np.linspace(-46.0, 46.0, 11).round(1).tolist()
"""Deciles of log odds that make no score likely."""
LASTING_S = (0.3, 10.0)
MOST_LASTING = 0.9
"""Something is new in every tick."""
LEAST = 0.01
"""Of every standard deviation."""
TINY = 1e-9
"""Where nothing errs."""
DECILES = np.linspace(0, 1, 11)
STEPS = 100
LONGEST_STEP = 0.25
"""Newton's method overshoots where most scores are near 0 or 1."""
PRIOR = 1.0
"""Weight of calibrated scores, as if each end of the curve had been seen once more."""
FRAMES_ALIKE = 10
"""Successive frames say much the same of a detector: so many count as one."""
RANGE_UNIT_M = 30.0
FOLDS = 5
LEAST_GAIN = 0.1
"""Share by which range must lower what scores leave open, where it was not fitted."""
FITTED = TRAITS[: TRAITS.index("top_speed_m_s")]
MOTION = TRAITS[TRAITS.index("accelerate_m_s2") : TRAITS.index("top_speed_m_s")]


def fitted(samples: Samples, top_speed_m_s: float) -> dict[str, float]:
    """Return the traits of one class but its top speed."""
    growth, sigmas = spread(samples.errors, samples.ranges_m)
    slope, offset, per_m = calibrated(samples.graded)
    walks = np.sqrt((samples.changes**2 / samples.periods_s[:, None]).mean(axis=0))
    walks[:2] = np.maximum(walks[:2], LEAST_WALK_S * top_speed_m_s)
    values = [
        slope, offset, per_m, *np.maximum(sigmas, LEAST), max(growth, 1e-3),
        *lasting(samples.echoes[:, [0, 1, 2, 4, 5]]), lasting(samples.echoes[:, [0, 3, 6]])[0],
        *np.maximum(walks, LEAST),
        *_speeds(samples),
    ]  # fmt: skip
    return dict(zip(FITTED, (round(float(v), 4) for v in values), strict=True))


def lasting(echoes: np.ndarray) -> tuple[float, float]:
    """Return share of the variance that lasts and how long, seconds.

    echoes: (E, 1 + 2 K) seconds between two detections, K errors of the one and of the other.
    The correlation of errors is share * exp(-lag / time); it is known at two lags.
    """
    likeness = []
    for lag in LAGS_S:
        first, second = np.split(echoes[echoes[:, 0] == lag, 1:], 2, axis=1)
        scale = np.sqrt((first**2).mean(axis=0) * (second**2).mean(axis=0)) if len(first) else 1.0
        scale = np.maximum(scale, TINY)
        likeness.append(float(((first * second) / scale).mean()) if len(first) else 0.0)
    short, long = np.clip(likeness, LEAST, 1 - LEAST)
    time_s = float(np.clip(np.diff(LAGS_S)[0] / np.log(max(short / long, 1.01)), *LASTING_S))
    return float(min(short * np.exp(LAGS_S[0] / time_s), MOST_LASTING)), time_s


def _speeds(samples: Samples) -> tuple[float, float, float, float]:
    """Return speed_m_s, cruise_m_s, aside_m_s and front of `Learned`."""
    along, across = samples.velocities.T
    usual = max(float(np.sqrt((samples.velocities**2).sum(axis=1).mean())), 1.0)
    cruise, aside = max(float(along.mean()), LEAST), max(float(np.sqrt((across**2).mean())), 0.1)
    told = (samples.fronts.sum() + PRIOR) / (len(samples.fronts) + 2 * PRIOR)
    return usual, cruise, aside, float(told)


def spread(errors: np.ndarray, ranges_m: np.ndarray) -> tuple[float, np.ndarray]:
    """Return growth per metre and (4,) standard deviations of (N, 4) errors, likeliest of all.

    Errors have a standard deviation of s * (1 + growth * range).
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


def calibrated(graded: np.ndarray) -> tuple[float, float, float]:
    """Return slope, offset and change per metre of the log odds of being right (Platt 1999).

    graded: (J, 3) log odds of scores, ranges in metres, 1 for right and 0 for wrong. Range is left
    out where it does not help with what it was not fitted to.
    """
    design = np.column_stack([graded[:, 0], np.ones(len(graded)), graded[:, 1] / RANGE_UNIT_M])
    right = graded[:, 2]
    ranged = _left_open(design, right) < (1 - LEAST_GAIN) * _left_open(design[:, :2], right)
    weights = _logistic(design if ranged else design[:, :2], right)
    per_m = float(weights[2]) / RANGE_UNIT_M if ranged else 0.0
    return max(float(weights[0]), 0.05), float(weights[1]), per_m


def _left_open(design: np.ndarray, right: np.ndarray) -> float:
    """Return the log loss on each fold, in order of time, of what the others say."""
    fold = np.arange(len(right)) * FOLDS // max(len(right), 1)
    loss = 0.0
    for k in range(FOLDS):
        told = design[fold == k] @ _logistic(design[fold != k], right[fold != k])
        loss += float(np.logaddexp(0, np.where(right[fold == k] > 0, -told, told)).sum())
    return loss


def _logistic(design: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return weights, by Newton's method, of columns whose first is the log odds of scores."""
    start = np.zeros(design.shape[1])
    start[0] = 1.0
    weights = start.copy()
    for _ in range(STEPS):
        chance = 1 / (1 + np.exp(-np.clip(design @ weights, -30, 30)))
        slope = design.T @ (right - chance) / FRAMES_ALIKE - PRIOR * (weights - start)
        spread = (design * (chance * (1 - chance) / FRAMES_ALIKE)[:, None]).T @ design
        step = np.linalg.solve(spread + PRIOR * np.eye(len(start)), slope)
        weights = weights + step * min(1.0, LONGEST_STEP / max(np.abs(step).max(), 1e-12))
    return weights


def source(
    classes: Mapping[str, Samples],
    origin: str,
    lasting: Mapping[str, Mapping[str, float]] | None = None,
) -> str:
    """Return the text of a file of `roadscope/trackers/learned`.

    A class with too few samples is taken to be detected as the one with most is, and to move as is
    guessed where nothing is known; its scores are hardly foretold.
    lasting: of each class what `tracker_persistence` learned; left out, what is guessed.
    """
    guessed = tomllib.loads((FOLDER / "unknown.toml").read_text("utf-8"))
    most = max(classes, key=lambda name: len(classes[name].errors))
    lines = [f'origin = "{origin}"']
    for name, samples in classes.items():
        enough = min(len(samples.errors), len(samples.changes)) >= LEAST_SAMPLES
        taken = name if enough else most
        section = {
            "scores": len(classes[taken].log_odds),
            "log_odds_deciles": np.quantile(classes[taken].log_odds, DECILES).round(2).tolist(),
            **fitted(classes[taken], TOP_SPEED_M_S[taken]),
            "top_speed_m_s": TOP_SPEED_M_S[name],
            **(lasting[taken] if lasting else PERSISTENCE | SHARES),
        }
        told = f"{len(samples.errors)} detections"
        if not enough:
            section |= {trait: guessed[name][trait] for trait in MOTION}
            section |= {"scores": 0, "log_odds_deciles": UNFORETOLD}
            told += f", too few: as {most}, moving as in unknown.toml"
        if all(section[t] in (guess, guessed[name][t]) for t, guess in PERSISTENCE.items()):
            told += "; how belief changes is guessed"
        lines += ["", f"[{name}] # {told}"]
        lines += [f"{trait} = {value}" for trait, value in section.items()]
    return "\n".join([*lines, ""])


def main(arguments: Sequence[str] | None = None) -> None:
    """Write a file of traits."""
    parser = argparse.ArgumentParser(prog="roadscope.benchmarks.fit.trackers")
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--kitti", type=Path, help="folder with label_02, det_NAME, ego_pose, calib"
    )
    parser.add_argument("--sequences", help="comma separated; all when left out")
    parser.add_argument("--detector", help="spec of a detector, or NAME of det_NAME")
    parser.add_argument(
        "--seeds", type=int, default=1, help="train seeds of our traffic, from 400 on"
    )
    parser.add_argument("--scenarios", help="of our traffic, comma separated")
    parser.add_argument("--rigs", help="comma separated")
    parser.add_argument(
        "--guess-existence", action="store_true",
        help="do not learn how belief in targets changes: take what unknown.toml guesses",
    )  # fmt: skip
    given = parser.parse_args(arguments)
    guess = given.guess_existence
    if given.kitti is not None:
        chosen: Sequence[str] | None = given.sequences.split(",") if given.sequences else None
        where = given.kitti, chosen, given.detector
        persisting = guessed_persistence if guess else partial(recorded_persistence, *where)
        learn(given.out, recorded_samples(*where), persisting, partial(recorded_surplus, *where))
        return
    usual = Drives()
    drives = Drives(
        given.detector or usual.detector, given.seeds,
        tuple(given.scenarios.split(",")) if given.scenarios else usual.scenarios,
        tuple(given.rigs.split(",")) if given.rigs else usual.rigs,
    )  # fmt: skip
    persisting = guessed_persistence if guess else partial(sensed_persistence, drives)
    learn(given.out, sensed_samples(drives), persisting, partial(sensed_surplus, drives))


def guessed_persistence(_: str) -> dict[str, dict[str, float]]:
    """Return of each class what `unknown.toml` says in place of what `tracker_persistence` learns.

    On validation seeds of street and town-crossing HOTA on fused detections was 0.67 with the
    guesses and 0.63 with what was learned.
    """
    known = tomllib.loads((FOLDER / "unknown.toml").read_text("utf-8"))
    traits = [trait for trait in (*PERSISTENCE, *SHARES) if trait != "surplus"]
    return {
        kind: {**{trait: known[kind][trait] for trait in traits}, "surplus": 1.0}
        for kind in TOP_SPEED_M_S
    }


def learn(
    out: Path,
    samples: tuple[dict[str, Samples], str],
    persisting: Callable[[str], dict[str, dict[str, float]]],
    surplus: Callable[[str], dict[str, float]],
) -> None:
    """Write a file of traits; what rests on following targets is learned with what is known so far.

    persisting, surplus: return what they learn of each class with a file of traits.
    """
    out.write_text(source(*samples), "utf-8")
    kept = persisting(str(out))
    out.write_text(source(*samples, kept), "utf-8")
    off = surplus(str(out))
    kept = {kind: {**traits, "surplus": off[kind]} for kind, traits in kept.items()}
    out.write_text(source(*samples, kept), "utf-8")


if __name__ == "__main__":
    main()
