"""CLEAR, IDF1 and HOTA beside TrackEval's, wherever that is installed."""

import numpy as np
import pytest

from roadscope.benchmarks.metrics.clear import clear_counts
from roadscope.benchmarks.metrics.hota import hota
from roadscope.benchmarks.metrics.identity import idf1
from roadscope.benchmarks.metrics.tracked import TrackedFrame

trackeval_metrics = pytest.importorskip("trackeval.metrics")

GATE_M = 2.0


def episode(seed: int) -> list[TrackedFrame]:
    """Objects and tracks that come, go, drift and swap at random."""
    rng = np.random.default_rng(seed)
    objects, frames = int(rng.integers(1, 7)), []
    places = rng.uniform(0, 12, (objects, 2))
    names = np.arange(objects)
    for _ in range(int(rng.integers(1, 40))):
        places = places + rng.normal(0, 0.4, places.shape)
        if rng.random() < 0.2:
            names = rng.permutation(objects + 2)[:objects]
        there, seen = rng.random(objects) < 0.8, rng.random(objects) < 0.8
        # TrackEval leaves frames without any object or track out of its memory of the frame before.
        there[0] = seen[0] = True
        found = places[seen] + rng.normal(0, 0.8, (seen.sum(), 2))
        apart = np.linalg.norm(found[:, None] - places[None, there], axis=-1)
        frames.append(TrackedFrame(np.flatnonzero(there), names[seen], apart, np.zeros_like(apart)))
    return frames


def as_trackeval(frames: list[TrackedFrame]) -> dict:
    truth_ids = np.unique(np.concatenate([f.truth_ids for f in frames]))
    track_ids = np.unique(np.concatenate([f.track_ids for f in frames]))
    return {
        "num_timesteps": len(frames),
        "gt_ids": [np.searchsorted(truth_ids, f.truth_ids) for f in frames],
        "tracker_ids": [np.searchsorted(track_ids, f.track_ids) for f in frames],
        "similarity_scores": [np.maximum(0, 1 - f.distances.T / (2 * GATE_M)) for f in frames],
        "num_gt_dets": sum(len(f.truth_ids) for f in frames),
        "num_tracker_dets": sum(len(f.track_ids) for f in frames),
        "num_gt_ids": len(truth_ids),
        "num_tracker_ids": len(track_ids),
    }


@pytest.mark.parametrize("seed", range(30))
def test_the_same_figures(seed) -> None:
    frames = episode(seed)
    data = as_trackeval(frames)
    quiet = {"PRINT_CONFIG": False}
    clear = trackeval_metrics.CLEAR(quiet).eval_sequence(data)
    counts = clear_counts(frames, GATE_M)
    assert counts.matches == clear["CLR_TP"]
    assert counts.misses == clear["CLR_FN"]
    assert counts.false_alarms == clear["CLR_FP"]
    assert counts.id_switches == clear["IDSW"]
    assert counts.fragmentations == clear["Frag"]
    assert counts.mostly_tracked == clear["MT"]
    assert counts.mostly_lost == clear["ML"]
    similarity = 1 - counts.distance_m / max(counts.matches, 1) / (2 * GATE_M)
    assert counts.matches == 0 or similarity == pytest.approx(clear["MOTP"])
    identity = trackeval_metrics.Identity(quiet).eval_sequence(data)
    assert idf1(frames, GATE_M).value == pytest.approx(identity["IDF1"])
    theirs, ours = trackeval_metrics.HOTA().eval_sequence(data), hota(frames, GATE_M)
    for name, score in (
        ("HOTA", ours.hota), ("DetA", ours.det_a), ("AssA", ours.ass_a), ("LocA", ours.loc_a)
    ):  # fmt: skip
        assert score.value == pytest.approx(np.mean(theirs[name])), name
