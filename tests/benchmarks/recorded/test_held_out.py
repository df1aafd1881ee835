"""What was learned on one half of the recorded sequences leads on the other half."""

import os
from pathlib import Path

import numpy as np
import pytest

from research.tracker_traits import main as fit
from roadscope.benchmarks.formats import DETECTED_TYPES
from roadscope.benchmarks.recorded import apply_kitti_rules
from roadscope.core import Category
from roadscope.formats import KittiFolder, KittiSequence, read_kitti_sequence
from roadscope.metrics import TrackedSequence, hota
from roadscope.trackers import TRACKERS, is_offline

OURS = ("existence", "existence-offline")
OTHERS = [n for n in TRACKERS.installed() if n not in OURS and not n.startswith("stonesoup")]
"""Stone Soup's are compared by `roadscope leaderboard tracking --kitti`: they take long."""


@pytest.fixture(scope="module")
def folder() -> Path:
    kitti_folder = os.environ.get("ROADSCOPE_KITTI")
    if not kitti_folder:
        pytest.skip("ROADSCOPE_KITTI names no folder of KITTI tracking data")
    return Path(kitti_folder)


@pytest.fixture(scope="module")
def halves(folder, tmp_path_factory) -> list[tuple[Path, list[str]]]:
    """Traits learned on every other sequence, and the sequences that they were not learned on."""
    names = KittiFolder.find(folder).sequences()
    if len(names) < 2:
        pytest.skip("one sequence has no halves")
    tuned, even_and_odd = [], (names[::2], names[1::2])
    for taught, held_out in (even_and_odd, even_and_odd[::-1]):
        traits = tmp_path_factory.mktemp("traits") / f"{taught[0]}.toml"
        fit([str(traits), "--kitti", str(folder), "--sequences", ",".join(taught)])
        tuned.append((traits, held_out))
    return tuned


def track_sequence(spec: str, sequence: KittiSequence) -> TrackedSequence:
    """Run a tracker over a sequence, and its second pass if it has one; by image boxes."""
    tracker, poses = TRACKERS.make(spec), sequence.world_from_ego
    reported_tracks = [
        tracker.update(d, p) for d, p in zip(sequence.detections, poses, strict=True)
    ]
    if is_offline(type(tracker)):
        reported_tracks = tracker.rescored(reported_tracks)
    rows = sequence.result_rows([tracks.sure for tracks in reported_tracks])
    return apply_kitti_rules(sequence.label_rows, rows, DETECTED_TYPES[sequence.category])


def as_one(parts: list[TrackedSequence]) -> float:
    """HOTA of all sequences together: what it is made of is added up at each alpha."""
    curves = [hota(part) for part in parts]
    hits = sum(c.hits for c in curves)
    detection_accuracy = hits / sum(c.hits + c.misses + c.false_alarms for c in curves)
    alike = sum(c.ass_a * c.hits for c in curves) / np.maximum(hits, 1)
    return float(np.sqrt(detection_accuracy * alike).mean())


@pytest.mark.slow
@pytest.mark.parametrize("category", [Category.CAR, Category.PEDESTRIAN])
def test_existence_leads_on_sequences_that_it_was_not_taught(folder, halves, category):
    """Both ways, and all that was not taught as one. Cyclists are few: 9 in ten sequences."""
    scored: dict[str, list[TrackedSequence]] = {}
    for traits, held_out in halves:
        ours = {name: f"{name}?traits={traits}" for name in OURS}
        for name in held_out:
            sequence = read_kitti_sequence(folder, name, category)
            for entry, spec in ({other: other for other in OTHERS} | ours).items():
                scored.setdefault(entry, []).append(track_sequence(spec, sequence))
    figures = {entry: as_one(parts) for entry, parts in scored.items()}
    assert figures["existence"] > max(figures[other] for other in OTHERS), figures
    assert figures["existence-offline"] > figures["existence"], figures
