"""A tracked sequence reduced to what tracking metrics look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from roadscope.core.checks import RecordError, require, settle_arrays
from roadscope.core.record import Record

GATE_M = 2.0
"""Centres further apart cannot belong together, seen from above."""


def near(distances_m: np.ndarray, gate_m: float = GATE_M) -> np.ndarray:
    """Return how alike places are: 1 for no distance, 0.5 at the gate, 0 from twice that on."""
    alike: np.ndarray = distances_m / (2 * gate_m)
    np.subtract(1, alike, out=alike)
    np.maximum(alike, 0, out=alike)
    return alike


@dataclass(frozen=True, slots=True, eq=False)
class TrackedSequence(Record):
    """Objects and tracks of T frames and how alike they are; `TrackedSequence.of` takes frames.

    The rows of all frames are joined: P objects, Q tracks and R pairs. The pairs of a frame are
    its (objects, tracks) matrix, row by row.

    truth_counts, track_counts: (T,) int64, objects and tracks of each frame.
    truth_ids: (P,) int64, unique within a frame.
    track_ids: (Q,) int64, unique within a frame.
    similarities: (R,) float64, 0 for nothing in common to 1 for the same.
    scores: (Q,) float64, how sure the tracker was of each track.
    distances_m: (R,) float64, metres, or None where nobody asks for them.
    truths, tracks: (P,) and (Q,) int64, the ids numbered from 0 over the sequence; made here,
        as is all that follows.
    truth_starts, track_starts, pair_starts: (T + 1,) int64, where each frame begins.
    objects, followers: how many different objects and tracks there are.
    """

    truth_counts: np.ndarray
    track_counts: np.ndarray
    truth_ids: np.ndarray
    track_ids: np.ndarray
    similarities: np.ndarray
    scores: np.ndarray
    distances_m: np.ndarray | None = None
    truths: np.ndarray = field(init=False)
    tracks: np.ndarray = field(init=False)
    truth_starts: np.ndarray = field(init=False)
    track_starts: np.ndarray = field(init=False)
    pair_starts: np.ndarray = field(init=False)
    objects: int = field(init=False)
    followers: int = field(init=False)

    def __post_init__(self) -> None:
        settle_arrays(
            self, truth_counts=(np.int64, ("T",)), track_counts=(np.int64, ("T",)),
            truth_ids=(np.int64, ("P",)), track_ids=(np.int64, ("Q",)),
        )  # fmt: skip
        for kind in ("truth", "track"):
            self._number(kind)
        self._set("pair_starts", _starts(self.truth_counts * self.track_counts))
        self._settle("similarities", self.pair_starts, 0, 1)
        self._settle("scores", self.track_starts, -np.inf, np.inf)
        if self.distances_m is not None:
            self._settle("distances_m", self.pair_starts, 0, np.inf)

    @staticmethod
    def of(
        truth_ids: Sequence[np.ndarray],
        track_ids: Sequence[np.ndarray],
        similarities: Sequence[np.ndarray] | None = None,
        *,
        distances_m: Sequence[np.ndarray] | None = None,
        gate_m: float = GATE_M,
        scores: Sequence[np.ndarray] | None = None,
    ) -> TrackedSequence:
        """Join frames of (M,) object ids, (N,) track ids, (M, N) similarities and distances.

        Either can be left out; similarities are then those of `near`, by distances and gate.
        scores: frames of (N,) values; 1 where the tracker says nothing.
        """
        if similarities is None and distances_m is None:
            raise ValueError("a TrackedSequence needs similarities or distances_m, got neither")
        shapes = [(len(g), len(k)) for g, k in zip(truth_ids, track_ids, strict=True)]
        counts = np.array(shapes, np.int64).reshape(-1, 2)
        rows = [(n,) for _, n in shapes]
        apart = None if distances_m is None else _joined("distances_m", distances_m, shapes)
        if similarities is None:
            assert apart is not None
            alike = near(apart, gate_m)
        else:
            alike = _joined("similarities", similarities, shapes)
        return TrackedSequence(
            truth_counts=counts[:, 0],
            track_counts=counts[:, 1],
            truth_ids=_joined("truth_ids", truth_ids, [(m,) for m, _ in shapes], np.int64),
            track_ids=_joined("track_ids", track_ids, rows, np.int64),
            similarities=alike,
            scores=np.ones(counts[:, 1].sum())
            if scores is None
            else _joined("scores", scores, rows),
            distances_m=apart,
        )

    def __len__(self) -> int:
        return len(self.truth_counts)

    @property
    def starts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where the objects, the tracks and the pairs of each frame begin."""
        return self.truth_starts, self.track_starts, self.pair_starts

    def matrices(self, values: np.ndarray) -> list[np.ndarray]:
        """Return T views (M, N) of (R,) values."""
        ends, shapes = self.pair_starts.tolist(), self._shapes()
        return [values[ends[t] : ends[t + 1]].reshape(shape) for t, shape in enumerate(shapes)]

    def places(self, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the frames of (K,) pairs and their rows among all objects and all tracks."""
        frames = np.searchsorted(self.pair_starts, pairs, side="right") - 1
        within = pairs - self.pair_starts[frames]
        row, column = np.divmod(within, np.maximum(self.track_counts[frames], 1))
        return frames, self.truth_starts[frames] + row, self.track_starts[frames] + column

    def distances(self, what: str) -> np.ndarray:
        """Return the distances, or say who needs them."""
        if self.distances_m is None:
            raise ValueError(f"{what} is defined on distances: give TrackedSequence distances_m")
        return self.distances_m

    def _shapes(self) -> list[tuple[int, int]]:
        return list(zip(self.truth_counts.tolist(), self.track_counts.tolist(), strict=True))

    def _number(self, kind: str) -> None:
        """Give ids numbers from 0 and refuse one that a frame has twice."""
        ids, counts = getattr(self, f"{kind}_ids"), getattr(self, f"{kind}_counts")
        name = f"{kind}_counts"
        require(not (counts < 0).any(), self, name, "no negative counts", counts.min(initial=0))
        require(counts.sum() == len(ids), self, name, f"a sum of {len(ids)}", int(counts.sum()))
        known, numbers = np.unique(ids, return_inverse=True)
        frames = np.repeat(np.arange(len(counts)), counts)
        keys = np.sort(frames * max(len(known), 1) + numbers)
        twice = keys[1:][keys[1:] == keys[:-1]]
        if len(twice):
            frame, number = divmod(int(twice[0]), len(known))
            raise RecordError(
                f"TrackedSequence.{kind}_ids: expected unique ids in a frame, "
                f"got {known[number]} twice in frame {frame}"
            )
        self._set(f"{kind}s", numbers.astype(np.int64))
        self._set(f"{kind}_starts", _starts(counts))
        self._set("objects" if kind == "truth" else "followers", len(known))

    def _settle(self, name: str, starts: np.ndarray, least: float, most: float) -> None:
        """Convert to float64; refuse a wrong length and wrong values, naming the frame."""
        values = np.ascontiguousarray(getattr(self, name), np.float64)
        expected = f"shape ({starts[-1]},)"
        require(values.shape == (starts[-1],), self, name, expected, values.shape)
        self._set(name, values)
        low, high = values.min(initial=0), values.max(initial=0)
        if low >= least and high <= most and low > -np.inf and high < np.inf:
            return
        bad = np.flatnonzero(~(np.isfinite(values) & (values >= least) & (values <= most)))[0]
        frame = int(np.searchsorted(starts, bad, side="right")) - 1
        wanted = f"be in {least:g} to {most:g}" if np.isfinite(values[bad]) else "be finite"
        raise RecordError(
            f"TrackedSequence.{name}: must {wanted}, got {values[bad]:g} in frame {frame}"
        )

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)


def _starts(counts: np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _joined(
    name: str,
    frames: Sequence[np.ndarray],
    shapes: Sequence[tuple[int, ...]],
    dtype: type = np.float64,
) -> np.ndarray:
    """Join the frames; an empty one may be given as a list, whose type says nothing."""
    full = []
    for t, (frame, shape) in enumerate(zip(map(np.asarray, frames), shapes, strict=True)):
        if frame.shape != shape and (frame.size or 0 not in shape):
            what = "objects, tracks" if len(shape) == 2 else "rows"
            raise RecordError(
                f"TrackedSequence.{name}: expected {shape} ({what}) in frame {t}, got {frame.shape}"
            )
        if frame.size:
            full.append(frame.ravel())
    return np.concatenate(full) if full else np.empty(0, dtype)
