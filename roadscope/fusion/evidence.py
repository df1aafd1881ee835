"""From scores to Dempster-Shafer evidence on classes and the whole frame (Li 2021, 5.2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.core import Detections, Family, ImageDetections, RecordError
from roadscope.core.category import families_of
from roadscope.fusion.weights import confusion, odds_model

# --------------------------------------------------------------------------------------------------
# From scores to evidence.

FAMILIES = tuple(Family)
"""The frame of discernment; masses have these columns and then ignorance."""
MOST = 0.98
"""Greatest mass that a score gives to the classes together, chosen by hand: some ignorance always
remains, so that masses from scores are never in full conflict."""

Confusion = Sequence[Sequence[float]] | np.ndarray


def masses_of(detections: Detections | ImageDetections, split: Confusion) -> np.ndarray:
    """Return (N, 4) masses: those of the detections if they have any, else from their scores.

    split: (3, 3), of the detections reported as one family (row) the share that is each (column).
    """
    if detections.masses is not None:
        return _checked_columns(detections.masses)
    return _split_masses(detections.scores, detections.categories, np.asarray(split))


def _split_masses(scores: np.ndarray, categories: np.ndarray, split: np.ndarray) -> np.ndarray:
    """Return (N, 4) masses: the scores, times `MOST`, shared out among families; then the rest."""
    belief = MOST * scores[:, None]
    return np.concatenate([belief * split[families_of(categories)], 1 - belief], axis=1)


def _checked_columns(masses: np.ndarray) -> np.ndarray:
    """Return a detector's masses; refuse those on another frame of discernment."""
    if masses.shape[1] != len(FAMILIES) + 1:
        raise RecordError(
            "fusion: expected masses on vehicle, cyclist, pedestrian and ignorance, got "
            f"{masses.shape[1]} columns"
        )
    return masses


def lidar_masses(lidar: Detections) -> np.ndarray:
    """Return (N, 4) masses of LiDAR detections."""
    return masses_of(lidar, confusion("lidar"))


def camera_masses(camera: ImageDetections) -> np.ndarray:
    """Return (N, 4) masses of camera detections, from their scores corrected for their height."""
    if camera.masses is not None:
        return _checked_columns(camera.masses)
    reliable = 1 / (1 + np.exp(-odds_model("camera_masses").odds(camera_features(camera))))
    return _split_masses(reliable, camera.categories, confusion("camera"))


def camera_features(camera: ImageDetections) -> np.ndarray:
    """Return (N, 4): log odds of score, log of height / 40 px, cyclist, pedestrian (0 or 1)."""
    heights = np.maximum(camera.boxes[:, 3] - camera.boxes[:, 1], 1.0)
    family = families_of(camera.categories)
    return np.column_stack(
        [log_odds(camera.scores), np.log(heights / 40.0), family == 1, family == 2]
    )


def log_odds(probabilities: np.ndarray) -> np.ndarray:
    """Return (N,) log odds, bounded to -5 to 5."""
    bounded = np.clip(probabilities, 0.0067, 0.9933)
    odds: np.ndarray = np.log(bounded / (1 - bounded))
    return odds


# --------------------------------------------------------------------------------------------------
# Dempster-Shafer evidence on single classes and on the whole frame (Li 2021, 5.2, eq. 5 and 6).

UNDECIDED = -1
DECIDED = 0.84
"""Least mass for a decision: halfway between 0.812, which Table 1 calls uncertain, and 0.865."""
CONFLICT_SLACK = 1e-12
"""Two rows of masses whose agreement 1 - k is no more than this exclude each other: what remains is
due to rounding. Chosen by hand."""


class FullConflictError(ValueError):
    """Two bodies of evidence exclude each other wholly; Dempster's rule has no answer."""


def combine(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the orthogonal sum (eq. 6) of (..., K + 1) masses, the last column for ignorance.

    Rows sum to 1. Raises `FullConflictError`, which names the row, where k is 1.
    """
    a, b = _of_one_frame(first, second)
    a, b = np.broadcast_arrays(a, b)
    s, t = a[..., -1:], b[..., -1:]
    joined = a * b + a * t + s * b
    joined[..., -1:] = s * t
    agreement = joined.sum(axis=-1, keepdims=True)
    if (agreement <= 0).any():
        row = np.argwhere(agreement[..., 0] <= 0)[0].tolist()
        where = f" of row {row}" if row else ""
        raise FullConflictError(
            f"full conflict between the masses{where}: no class has mass in both"
        )
    fused: np.ndarray = joined / agreement
    return fused


def combine_or_keep(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the orthogonal sums of (N, K + 1) masses; in full conflict the second row.

    Fusions use it for pairs: a detector that is wholly sure of a wrong class then spoils only that
    target instead of ending the run.
    """
    a, b = _of_one_frame(first, second)
    joined = b.copy()
    compatible = conflict(a, b) < 1.0 - CONFLICT_SLACK
    joined[compatible] = combine(a[compatible], b[compatible])
    return joined


def conflict(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the conflict k of eq. 6, (...), from 0 for none to 1 for full conflict."""
    a, b = (masses[..., :-1] for masses in _of_one_frame(first, second))
    result: np.ndarray = a.sum(axis=-1) * b.sum(axis=-1) - (a * b).sum(axis=-1)
    return result


def decide(masses: np.ndarray, least: float = DECIDED) -> np.ndarray:
    """Return the class (...) with the greatest mass, or `UNDECIDED` where that is below `least`."""
    classes = np.asarray(masses)[..., :-1]
    return np.where(classes.max(axis=-1) >= least, classes.argmax(axis=-1), UNDECIDED)


def check_masses(masses: np.ndarray) -> np.ndarray:
    """Return masses as floats; refuse negative ones and rows that do not sum to 1 (eq. 5)."""
    checked = np.asarray(masses, np.float64)
    if checked.ndim < 1 or checked.shape[-1] < 2:
        raise ValueError(f"masses: expected (..., K + 1) with K >= 1 classes, got {checked.shape}")
    if not (checked >= 0).all():
        raise ValueError(f"masses: expected values from 0 up, got {checked.min()}")
    wrong = np.abs(checked.sum(axis=-1) - 1) > 1e-6
    if wrong.any():
        raise ValueError(f"masses: expected rows that sum to 1, got {checked[wrong][0].tolist()}")
    return checked


def _of_one_frame(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both as floats; refuse masses on different numbers of classes."""
    a, b = check_masses(first), check_masses(second)
    if a.shape[-1] != b.shape[-1]:
        raise ValueError(
            f"masses: expected both on as many classes, got {a.shape[-1] - 1} and "
            f"{b.shape[-1] - 1}, each with ignorance behind them"
        )
    return a, b
