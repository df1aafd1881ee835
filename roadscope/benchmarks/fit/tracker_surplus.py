"""Learns how much more tracks err than their filter says, for `fit.trackers`.

Errors that last as long as a track, boxes of cut-off bodies and errors of labels are in no model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from roadscope.benchmarks.fit.tracker_samples import (
    CLASSES,
    GATES_M,
    Drives,
    in_ego,
    of_class,
    of_family,
    recorded_pairings,
    sensed_episodes,
)
from roadscope.benchmarks.metrics.matching import Pairing, match
from roadscope.benchmarks.metrics.tracking.state_errors import FrameRows, nees, state_errors
from roadscope.core import Detections, Pose, Tracks, Truth
from roadscope.trackers import ExistenceTracker

OBJECTS = 5.0
"""Of all classes together, that a class begins with."""

Errors = tuple[np.ndarray, int]
"""NEES of places over its degrees of freedom, (K,), and of how many objects."""


def recorded_surplus(
    folder: Path, sequences: Sequence[str] | None, detector: str | None, traits: str
) -> dict[str, float]:
    """Return `DetectorTraits.surplus` of each class, followed with a file in which it is 1."""
    found = {}
    for kind in CLASSES:
        parts = []
        for s in of_class(kind, folder, sequences, detector):
            tracks = followed(s.detections, s.world_from_ego, traits)
            pairings = recorded_pairings([t.centres for t in tracks], s)
            parts.append(_errors(tracks, s.truths, pairings, GATES_M[kind]))
        found[kind] = _together(parts)
    return shrunk(found)


def sensed_surplus(drives: Drives, traits: str) -> dict[str, float]:
    """Likewise from train seeds of our traffic."""
    parts: dict[str, list[Errors]] = {kind: [] for kind in CLASSES}
    for seen in sensed_episodes(drives):
        for kind, collected in parts.items():
            own, rule = of_family(kind, seen)
            tracks = followed(*in_ego(own), traits)
            pairings = rule.pairings(tracks, own.truths, own.parked)
            collected.append(_errors(tracks, own.truths, pairings, GATES_M[kind]))
    return shrunk({kind: _together(some) for kind, some in parts.items()})


def followed(detections: Sequence[Detections], poses: Sequence[Pose], traits: str) -> list[Tracks]:
    """Return the tracks that `ExistenceTracker` is sure of."""
    tracker = ExistenceTracker(traits=traits)
    told = [tracker.update(found, pose) for found, pose in zip(detections, poses, strict=True)]
    return [tracks.sure for tracks in told]


def _errors(
    tracks: Sequence[Tracks], truths: Sequence[Truth], pairings: Sequence[Pairing], gate_m: float
) -> Errors:
    fates = [match(pairing, gate_m) for pairing in pairings]
    objects = {int(i) for t, fate in zip(truths, fates, strict=True) for i in t.ids[fate.truth]}
    errors = state_errors(tracks, truths, [FrameRows(fate.detected, fate.truth) for fate in fates])
    found = nees(errors)
    return found.values / found.freedom, len(objects)


def _together(parts: Sequence[Errors]) -> Errors:
    return np.concatenate([values for values, _ in parts]), sum(count for _, count in parts)


def shrunk(classes: Mapping[str, Errors]) -> dict[str, float]:
    """Return means drawn towards that of all classes, as if each had `OBJECTS` more objects.

    At least 1: how much too large an error is said to be differs from one data set to another.
    """
    everything = float(np.concatenate([values for values, _ in classes.values()]).mean())
    told = {}
    for kind, (values, objects) in classes.items():
        total = objects * float(values.mean()) if len(values) else 0.0
        mean = (total + OBJECTS * everything) / ((objects if len(values) else 0) + OBJECTS)
        told[kind] = round(max(mean, 1.0), 2)
    return told
