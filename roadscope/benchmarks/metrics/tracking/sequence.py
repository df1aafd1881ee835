"""A tracked sequence, the input of all tracking metrics, and similarities of boxes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from roadscope.benchmarks.metrics.matching import centre_distances
from roadscope.core import Detections, Tracks, Truth
from roadscope.core.checks import RecordError, require, settle_arrays
from roadscope.core.record import Record

GATE_M = 2.0
"""A track matches an object up to this distance of centres, seen from above."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackedSequence(Record):
    """Objects and tracks of T frames and their similarities; `TrackedSequence.of` takes frames.

    The rows of all frames are joined: P objects, Q tracks and R pairs. The pairs of a frame are
    its (objects, tracks) matrix, row by row.

    truth_counts, track_counts: (T,) int64, objects and tracks of each frame.
    truth_ids: (P,) int64, unique within a frame.
    track_ids: (Q,) int64, unique within a frame.
    similarities: (R,) float64, from 0 (nothing in common) to 1 (the same).
    scores: (Q,) float64, the tracker's confidence in each track.
    distances_m: (R,) float64, metres, or None if no metric needs them.

    Computed from these:

    truths, tracks: (P,) and (Q,) int64, the ids numbered from 0 over the sequence.
    truth_starts, track_starts, pair_starts: (T + 1,) int64, where each frame begins.
    distinct_objects, distinct_tracks: number of different ids.
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
    distinct_objects: int = field(init=False)
    distinct_tracks: int = field(init=False)

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            truth_counts=(np.int64, ("T",)),
            track_counts=(np.int64, ("T",)),
            truth_ids=(np.int64, ("P",)),
            track_ids=(np.int64, ("Q",)),
        )
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
        """Join T frames of (M,) object ids and (N,) track ids.

        similarities, distances_m: frames of (M, N) values, 0 to 1 and metres; either can be left
            out. Similarities are then those of `similarity_by_distance`, with the gate.
        scores: frames of (N,) values; None: 1 for all.
        """
        if similarities is None and distances_m is None:
            raise ValueError("a TrackedSequence needs similarities or distances_m, got neither")
        shapes = [(len(g), len(k)) for g, k in zip(truth_ids, track_ids, strict=True)]
        counts = np.array(shapes, np.int64).reshape(-1, 2)
        truth_shapes, track_shapes = [(m,) for m, _ in shapes], [(n,) for _, n in shapes]
        joined_m = None if distances_m is None else _joined("distances_m", distances_m, shapes)
        if similarities is not None:
            joined = _joined("similarities", similarities, shapes)
        else:
            assert joined_m is not None
            joined = similarity_by_distance(joined_m, gate_m)
        return TrackedSequence(
            truth_counts=counts[:, 0],
            track_counts=counts[:, 1],
            truth_ids=_joined("truth_ids", truth_ids, truth_shapes, np.int64),
            track_ids=_joined("track_ids", track_ids, track_shapes, np.int64),
            similarities=joined,
            scores=np.ones(counts[:, 1].sum())
            if scores is None
            else _joined("scores", scores, track_shapes),
            distances_m=joined_m,
        )

    def __len__(self) -> int:
        return len(self.truth_counts)

    @property
    def starts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`truth_starts`, `track_starts` and `pair_starts`."""
        return self.truth_starts, self.track_starts, self.pair_starts

    def matrices(self, values: np.ndarray) -> list[np.ndarray]:
        """Return (R,) values as T views (M, N), one for each frame."""
        shapes = zip(self.truth_counts.tolist(), self.track_counts.tolist(), strict=True)
        starts = self.pair_starts.tolist()
        return [values[starts[t] : starts[t + 1]].reshape(shape) for t, shape in enumerate(shapes)]

    def places(self, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the frames of (K,) pairs and their rows among all objects and all tracks."""
        frames = np.searchsorted(self.pair_starts, pairs, side="right") - 1
        within = pairs - self.pair_starts[frames]
        row, column = np.divmod(within, np.maximum(self.track_counts[frames], 1))
        return frames, self.truth_starts[frames] + row, self.track_starts[frames] + column

    def distances(self, metric: str) -> np.ndarray:
        """Return the distances; without them, raise an error that names the metric."""
        if self.distances_m is None:
            raise ValueError(f"{metric} is defined on distances: give TrackedSequence distances_m")
        return self.distances_m

    def _number(self, kind: str) -> None:
        """Set numbers of ids from 0; an id that a frame has twice raises an error."""
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
        self._set("distinct_objects" if kind == "truth" else "distinct_tracks", len(known))

    def _settle(self, name: str, starts: np.ndarray, least: float, most: float) -> None:
        """Convert to float64; a wrong length or value raises an error that names the frame."""
        values = np.ascontiguousarray(getattr(self, name), np.float64)
        expected = f"shape ({starts[-1]},)"
        require(values.shape == (starts[-1],), self, name, expected, values.shape)
        self._set(name, values)
        low, high = values.min(initial=0), values.max(initial=0)
        if low >= least and high <= most and low > -np.inf and high < np.inf:
            return
        bad = np.flatnonzero(~(np.isfinite(values) & (values >= least) & (values <= most)))[0]
        frame = int(np.searchsorted(starts, bad, side="right")) - 1
        rule = f"be in {least:g} to {most:g}" if np.isfinite(values[bad]) else "be finite"
        raise RecordError(
            f"TrackedSequence.{name}: must {rule}, got {values[bad]:g} in frame {frame}"
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
    """Join the frames, without empty ones: these may be lists, whose type is arbitrary."""
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


# --------------------------------------------------------------------------------------------------
# Similarities of objects and tracks.

Boxes = Detections | Tracks | Truth
Similarity = Callable[[Boxes, Boxes], np.ndarray]
"""Takes the M objects and the N tracks of a frame, returns (M, N) in 0 to 1."""


def similarity_by_distance(distances_m: np.ndarray, gate_m: float = GATE_M) -> np.ndarray:
    """Return max(0, 1 - d / (2 gate)): 1 for no distance, 0.5 at the gate, 0 from twice that."""
    similarity: np.ndarray = distances_m / (2 * gate_m)
    np.subtract(1, similarity, out=similarity)
    np.maximum(similarity, 0, out=similarity)
    return similarity


def by_centres(truth: Boxes, tracks: Boxes, gate_m: float = GATE_M) -> np.ndarray:
    """Return `similarity_by_distance` of centres, seen from above."""
    return similarity_by_distance(centre_distances(truth.centres, tracks.centres), gate_m)


def by_area(truth: Boxes, tracks: Boxes) -> np.ndarray:
    """Return intersection over union seen from above."""
    from roadscope.core.box_overlap import box_overlaps

    truth_boxes, track_boxes = (
        np.column_stack([boxes.centres[:, :2], boxes.sizes[:, :2], boxes.yaws])
        for boxes in (truth, tracks)
    )
    return box_overlaps(truth_boxes, track_boxes)


def by_volume(truth: Boxes, tracks: Boxes) -> np.ndarray:
    """Return intersection over union in space."""
    from roadscope.core.box_overlap import box_overlaps_3d

    truth_boxes, track_boxes = (
        np.column_stack([boxes.centres, boxes.sizes, boxes.yaws]) for boxes in (truth, tracks)
    )
    return box_overlaps_3d(truth_boxes, track_boxes)


SIMILARITIES: Mapping[str, Similarity] = {
    "centre": by_centres,
    "iou_bev": by_area,
    "iou_3d": by_volume,
}


def tracked_sequence(
    tracks: Sequence[Tracks],
    truths: Sequence[Truth],
    similarity: Similarity | str = "centre",
    *,
    gate_m: float = GATE_M,
) -> TrackedSequence:
    """Return tracks and objects of T frames as a sequence, with similarities and distances.

    tracks, truths: both in the same coordinate frame.
    similarity: a name of `SIMILARITIES` (`centre`, `iou_bev`, `iou_3d`) or a function of the M
        objects and N tracks of a frame that returns (M, N) in 0 to 1. gate_m: for `centre`.
    """
    similarity_of = similarity_named(similarity, gate_m)
    frames = list(zip(tracks, truths, strict=True))
    return TrackedSequence.of(
        [truth.ids for _, truth in frames],
        [tracked.ids for tracked, _ in frames],
        [similarity_of(truth, tracked) for tracked, truth in frames],
        distances_m=[centre_distances(truth.centres, tracked.centres) for tracked, truth in frames],
        scores=[tracked.scores for tracked, _ in frames],
    )


def similarity_named(similarity: Similarity | str, gate_m: float = GATE_M) -> Similarity:
    """Return the function of a name of `SIMILARITIES`; an unknown name raises `ValueError`."""
    if callable(similarity):
        return similarity
    if similarity not in SIMILARITIES:
        raise ValueError(f"no similarity '{similarity}'; known: {', '.join(SIMILARITIES)}")
    return (
        partial(by_centres, gate_m=gate_m) if similarity == "centre" else SIMILARITIES[similarity]
    )
