"""The same figures as TrackEval's on real cars: labels against linked detections."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import pytest
from test_trackeval_parity import check

from roadscope.benchmarks.metrics import centre_distances, image_overlaps
from roadscope.benchmarks.metrics.tracking import SIMILARITIES
from roadscope.core import Detections, Tracks
from roadscope.formats import KittiFolder, KittiSequence, read_kitti_sequence
from roadscope.metrics import TrackedSequence, clear, tracked_sequence

LINK_M = 2.0


def linked(detections: list[Detections]) -> Iterator[np.ndarray]:
    """Give every detection the id of the nearest one of the frame before, first come first."""
    fresh, ids, before = 0, np.empty(0, int), np.empty((0, 3))
    for frame_detections in detections:
        distances_m = centre_distances(frame_detections.centres, before)
        own = np.full(len(frame_detections), -1)
        for flat in np.argsort(distances_m, axis=None):
            i, j = np.unravel_index(flat, distances_m.shape)
            if distances_m[i, j] > LINK_M:
                break
            if own[i] < 0 and ids[j] not in own:
                own[i] = ids[j]
        new = own < 0
        own[new] = fresh + np.arange(new.sum())
        fresh, ids, before = fresh + int(new.sum()), own, frame_detections.centres
        yield own


def in_the_image(real: KittiSequence, ids: list[np.ndarray]) -> TrackedSequence:
    labels = [
        rows.select(np.isin(rows.ids, truth.ids))
        for rows, truth in zip(real.label_rows, real.truths, strict=True)
    ]
    pairs = zip(labels, real.detection_rows, strict=True)
    alike = [image_overlaps(a.boxes, b.boxes) for a, b in pairs]
    return TrackedSequence.of([rows.ids for rows in labels], ids, alike)


@lru_cache(maxsize=4)
def recordings(count: int | None) -> list[KittiSequence]:
    folder = os.environ.get("ROADSCOPE_KITTI")
    if folder is None:
        pytest.skip("ROADSCOPE_KITTI names no folder of KITTI tracking data")
    return [
        read_kitti_sequence(folder, name) for name in KittiFolder.find(folder).sequences()[:count]
    ]


@pytest.mark.parametrize("count", [2, pytest.param(None, marks=pytest.mark.slow)])
@pytest.mark.parametrize("similarity", [*SIMILARITIES, "image"])
def test_real_sequences(similarity, count) -> None:
    good = 0
    for real in recordings(count):
        detections = [
            d.moved(pose, "world")
            for d, pose in zip(real.detections, real.world_from_ego, strict=True)
        ]
        ids = list(linked(detections))
        if similarity == "image":
            s = in_the_image(real, ids)
        else:
            s = tracked_sequence(list(map(Tracks.of, detections, ids)), real.truths, similarity)
        check(s)
        check(s, 0.25)
        good += clear(s, 0.25).recall > 0.5
    assert good
