"""How far matched boxes are from the true ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.matching import Match
from roadscope.core import Detections, Truth, wrap_angle


@dataclass(frozen=True, slots=True, eq=False)
class BoxErrors:
    """Errors of all K matched pairs of an episode.

    along, across: (K,) metres, of the centre, in the directions of the true length and width.
    heading_deg: (K,) degrees, -90 to 90: front and rear are not told apart.
    size: (K, 2) metres, of length and width.
    right_category: (K,) bool.
    """

    along: np.ndarray
    across: np.ndarray
    heading_deg: np.ndarray
    size: np.ndarray
    right_category: np.ndarray


def box_errors(
    detections: Sequence[Detections], truths: Sequence[Truth], matches: Sequence[Match]
) -> BoxErrors:
    """Compare what was matched, frame by frame."""
    frames = [_errors(*frame) for frame in zip(detections, truths, matches, strict=True)]
    return BoxErrors(*(np.concatenate(column) for column in zip(NOTHING, *frames, strict=True)))


def axis_error_deg(yaws: np.ndarray, truth_yaws: np.ndarray) -> np.ndarray:
    """Return the angle between length axes in degrees, -90 to 90, front and rear alike."""
    error: np.ndarray = np.degrees(wrap_angle(2 * (yaws - truth_yaws)) / 2)
    return error


NOTHING = (np.empty(0), np.empty(0), np.empty(0), np.empty((0, 2)), np.empty(0, bool))


def _errors(found: Detections, truth: Truth, match: Match) -> tuple[np.ndarray, ...]:
    rows, columns = match.detected, match.truth
    apart = found.centres[rows, :2] - truth.centres[columns, :2]
    c, s = np.cos(truth.yaws[columns]), np.sin(truth.yaws[columns])
    return (
        c * apart[:, 0] + s * apart[:, 1],
        c * apart[:, 1] - s * apart[:, 0],
        axis_error_deg(found.yaws[rows], truth.yaws[columns]),
        found.sizes[rows, :2] - truth.sizes[columns, :2],
        found.categories[rows] == truth.categories[columns],
    )
