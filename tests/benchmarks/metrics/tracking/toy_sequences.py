"""Tracked sequences by hand and at random."""

from __future__ import annotations

from typing import Any

import numpy as np

from roadscope.metrics import TrackedSequence

GATE_M = 2.0


def sequence(*frames: tuple[list[int], list[int], Any], **options: Any) -> TrackedSequence:
    """Join frames of object ids, track ids and similarities (objects, tracks)."""
    truth_ids, track_ids, alike = zip(*frames, strict=True) if frames else ((), (), ())
    shaped = [
        np.reshape(np.asarray(s, float), (len(g), len(k)))
        for g, k, s in zip(truth_ids, track_ids, alike, strict=True)
    ]
    return TrackedSequence.of(truth_ids, track_ids, shaped, **options)


def wandering(
    seed: int, *, objects: int | None = None, frames: int | None = None
) -> TrackedSequence:
    """Objects and tracks that come, go, drift and swap at random, with false tracks."""
    rng = np.random.default_rng(seed)
    objects = int(rng.integers(1, 7)) if objects is None else objects
    places, names = rng.uniform(0, 4 * np.sqrt(objects), (objects, 2)), np.arange(objects)
    columns: list[list[np.ndarray]] = [[], [], [], [], []]
    for _ in range(int(rng.integers(1, 40)) if frames is None else frames):
        places = places + rng.normal(0, 0.4, places.shape)
        if rng.random() < 0.2:
            names = rng.permutation(objects + 2)[:objects]
        there, detected = rng.random(objects) < 0.8, rng.random(objects) < 0.8
        false = rng.uniform(0, 12, (int(rng.integers(0, 3)), 2))
        detected_places = np.concatenate(
            [places[detected] + rng.normal(0, 0.8, (detected.sum(), 2)), false]
        )
        ids = np.concatenate([names[detected], 100 + rng.permutation(5)[: len(false)]])
        distances_m = np.linalg.norm(places[there][:, None] - detected_places[None], axis=-1)
        order = rng.permutation(len(ids))
        frame = (
            np.flatnonzero(there),
            ids[order],
            np.maximum(0, 1 - distances_m / (2 * GATE_M))[:, order],
            distances_m[:, order],
            rng.uniform(0, 1, len(ids)) * 0.2 + (ids % 5) / 7,
        )
        for column, values in zip(columns, frame, strict=True):
            column.append(values)
    truth_ids, track_ids, alike, pair_distances_m, scores = columns
    return TrackedSequence.of(
        truth_ids, track_ids, alike, distances_m=pair_distances_m, scores=scores
    )
