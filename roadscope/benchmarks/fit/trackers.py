"""Learns a detector's errors and scores, and how road users move: `roadscope.trackers.learned`.

    python -m roadscope.benchmarks.fit.trackers pointrcnn.toml --kitti DIR [--sequences 0000,0002]
    python -m roadscope.benchmarks.fit.trackers mine.toml --detector distance-l-shape

With a KITTI folder from its detections and labels, otherwise from train seeds of our traffic.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from roadscope.benchmarks.fit.tracker_samples import Samples, recorded_samples, sensed_samples
from roadscope.trackers.learned import TRAITS

TOP_SPEED_M_S = {"car": 40.0, "cyclist": 20.0, "pedestrian": 10.0}
"""Not learned: what a training set happens not to hold is not impossible."""
LEAST_WALK_S = 0.03
"""Velocities wander by at least this share of the top speed in a second: training sets hold few
hard brakings, and what is detected of a body wanders over it."""
GROWTHS = np.arange(0.0, 0.1005, 0.001)
"""Per metre; the likeliest is taken."""
LEAST_SAMPLES = 30
"""Fewer say nothing of a class."""
LEAST = 0.01
"""Of every standard deviation."""
DECILES = np.linspace(0, 1, 11)
STEPS = 100
LONGEST_STEP = 0.25
"""Newton's method overshoots where most scores are near 0 or 1."""
PRIOR = 1.0
"""Weight of calibrated scores, as if each end of the curve had been seen once more."""


def fitted(samples: Samples, top_speed_m_s: float) -> dict[str, float]:
    """Return the traits of one class but its top speed."""
    growth, sigmas = spread(samples.errors, samples.ranges_m)
    slope, offset = calibrated(samples.log_odds, samples.right)
    walks = np.sqrt((samples.changes**2 / samples.periods_s[:, None]).mean(axis=0))
    walks[:2] = np.maximum(walks[:2], LEAST_WALK_S * top_speed_m_s)
    values = [
        slope, offset, *np.maximum(sigmas, LEAST), max(growth, 1e-3), *np.maximum(walks, LEAST),
        max(float(np.sqrt((samples.speeds_m_s**2).mean())), 1.0),
    ]  # fmt: skip
    return dict(zip(TRAITS[:-1], (round(float(v), 3) for v in values), strict=True))


def spread(errors: np.ndarray, ranges_m: np.ndarray) -> tuple[float, np.ndarray]:
    """Return growth per metre and (4,) standard deviations of (N, 4) errors, likeliest of all.

    Errors have a standard deviation of s * (1 + growth * range).
    """
    best = (-np.inf, 0.0, np.zeros(errors.shape[1]))
    for growth in GROWTHS:
        factor = 1 + growth * ranges_m
        sigmas = np.sqrt(((errors / factor[:, None]) ** 2).mean(axis=0))
        likelihood = -np.log(sigmas).sum() - errors.shape[1] * np.log(factor).mean()
        if likelihood > best[0]:
            best = (likelihood, float(growth), sigmas)
    return best[1], best[2]


def calibrated(log_odds: np.ndarray, right: np.ndarray) -> tuple[float, float]:
    """Return slope and offset of the log odds of being right (Platt 1999), by Newton's method."""
    design = np.column_stack([log_odds, np.ones(len(log_odds))])
    start = np.array([1.0, 0.0])
    weights = start.copy()
    for _ in range(STEPS):
        chance = 1 / (1 + np.exp(-np.clip(design @ weights, -30, 30)))
        slope = design.T @ (right - chance) - PRIOR * (weights - start)
        curvature = (design * (chance * (1 - chance))[:, None]).T @ design + PRIOR * np.eye(2)
        step = np.linalg.solve(curvature, slope)
        weights = weights + step * min(1.0, LONGEST_STEP / np.abs(step).max())
    return max(float(weights[0]), 0.05), float(weights[1])


def source(classes: Mapping[str, Samples], origin: str) -> str:
    """Return the text of a file of `roadscope.trackers.learned`.

    A class with too few samples takes the traits of the class with most.
    """
    most = max(classes, key=lambda name: len(classes[name].errors))
    lines = [f'origin = "{origin}"']
    for name, samples in classes.items():
        enough = min(len(samples.errors), len(samples.changes)) >= LEAST_SAMPLES
        taken = samples if enough else classes[most]
        traits = fitted(taken, TOP_SPEED_M_S[name])
        told = f"{len(samples.errors)} detections" if enough else f"as {most}: too few detections"
        lines += [
            "",
            f"[{name}] # {told}",
            f"log_odds_deciles = {np.quantile(taken.log_odds, DECILES).round(2).tolist()}",
            *(f"{trait} = {traits[trait]}" for trait in TRAITS[:-1]),
        ]
        lines.append(f"{TRAITS[-1]} = {TOP_SPEED_M_S[name]}")
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
    given = parser.parse_args(arguments)
    if given.kitti is not None:
        chosen: Iterable[str] | None = given.sequences.split(",") if given.sequences else None
        classes, origin = recorded_samples(given.kitti, chosen, given.detector)
    else:
        classes, origin = sensed_samples(given.detector or "distance-l-shape", given.seeds)
    given.out.write_text(source(classes, origin), "utf-8")


if __name__ == "__main__":
    main()
