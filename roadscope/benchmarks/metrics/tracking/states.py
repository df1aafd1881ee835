"""Errors of what tracks say of their objects' state, and whether they know how large these are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.core import Tracks, Truth, wrap_angle
from roadscope.core.record import Record

REVERSED_RAD = np.pi / 2


@dataclass(frozen=True, slots=True, eq=False)
class StateErrors(Record):
    """Track less object for K matched pairs.

    positions: (K, 2) metres, x and y of the centre.
    velocities: (K, 2) m/s.
    headings: (K,) radians, -pi to pi; front and rear are told apart.
    covariances: (K, 4, 4) of x, y and their velocities, as the tracks have them.
    """

    positions: np.ndarray
    velocities: np.ndarray
    headings: np.ndarray
    covariances: np.ndarray

    def __len__(self) -> int:
        return len(self.headings)

    @property
    def reversed(self) -> np.ndarray:
        """(K,) bool, headings that are off by more than a right angle."""
        back: np.ndarray = np.abs(self.headings) > REVERSED_RAD
        return back


def state_errors(
    tracks: Sequence[Tracks],
    truths: Sequence[Truth],
    pairs: Sequence[tuple[np.ndarray, np.ndarray]],
) -> StateErrors:
    """Compare records of T frames; pairs: of each frame the rows of tracks and of objects."""
    frames = [_errors(*frame) for frame in zip(tracks, truths, pairs, strict=True)]
    none = (np.empty((0, 2)), np.empty((0, 2)), np.empty(0), np.empty((0, 4, 4)))
    return StateErrors(*(np.concatenate(column) for column in zip(none, *frames, strict=True)))


def _errors(
    tracks: Tracks, truth: Truth, pairs: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rows, columns = pairs
    return (
        tracks.centres[rows, :2] - truth.centres[columns, :2],
        tracks.velocities[rows] - truth.velocities[columns],
        wrap_angle(tracks.yaws[rows] - truth.yaws[columns]),
        tracks.covariances[rows],
    )
