"""What training data hold for `fit.trackers`: errors of detections, and changes of motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Self

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.fit.tracker_labels import graded_detections
from roadscope.benchmarks.formats.kitti_frames import centres_from_bottoms
from roadscope.benchmarks.formats.kitti_labels import DETECTED_TYPES
from roadscope.benchmarks.formats.kitti_sequence import (
    KittiFolder,
    KittiSequence,
    read_kitti_sequence,
)
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.matching import Pairing, centre_distances, match
from roadscope.benchmarks.nodes.fusions import detection_node
from roadscope.benchmarks.records import EpisodeDetections
from roadscope.benchmarks.references import detection_source
from roadscope.core import Category, Detections, Family, Pose, Truth
from roadscope.core.pose import wrap_angle
from roadscope.trackers import score_log_odds

CLASSES = {"car": Category.CAR, "cyclist": Category.CYCLIST, "pedestrian": Category.PEDESTRIAN}
GATES_M = {"car": 2.0, "cyclist": 1.0, "pedestrian": 1.0}
FIRST_SEED = 400
DURATION_S = 6.0
LAGS_S = (0.2, 1.0)
"""Between detections whose errors are compared."""
WINDOW_S = 1.0
"""Over which changes are taken: shorter ones are those of labels, not of motion."""


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Of one class: N matched detections, M scores, J detections judged, L changes of truth.

    errors: (N, 4) along, across the true box, z, heading up to half turns. ranges_m: (N,).
    echoes: (E, 7) seconds between two detections of one object, and errors along, across and of
        the heading of both.
    fronts: (N,) bool, front and rear not taken for each other.
    log_odds: (M,) of scores.
    graded: (J, 3) log odds of the score, range in metres, 1 for right and 0 for wrong.
    changes: (L, 4) of velocity along and across, heading, z. periods_s: (L,).
    velocities: (L, 2) m/s along and across the heading.
    """

    errors: np.ndarray
    ranges_m: np.ndarray
    echoes: np.ndarray
    fronts: np.ndarray
    log_odds: np.ndarray
    graded: np.ndarray
    changes: np.ndarray
    periods_s: np.ndarray
    velocities: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Put samples together."""
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))


def episode_samples(
    detections: Sequence[Detections], truths: Sequence[Truth], pairings: Sequence[Pairing],
    kind: str,
) -> Samples:  # fmt: skip
    """Collect what an episode says of a class, detections and truths in the world frame."""
    errors, ranges, fronts, odds, graded = [np.empty((0, 4))], [], [], [], []
    owners, stamps = [np.empty(0)], [np.empty(0)]
    for found, truth, pairing in zip(detections, truths, pairings, strict=True):
        fate = match(pairing, GATES_M[kind])
        errors.append(_errors(found, truth, fate.detected, fate.truth))
        eye = truth.world_from_ego.translation[:2]
        off = found.yaws[fate.detected] - truth.yaws[fate.truth]
        owners.append(truth.ids[fate.truth])
        stamps.append(np.full(len(fate.truth), truth.stamp_s))
        fronts.append(np.cos(off) > 0)
        ranges.append(np.hypot(*(truth.centres[fate.truth, :2] - eye).T))
        rows = np.concatenate([fate.detected, fate.false_alarms])
        odds.append(score_log_odds(found.scores[rows]))
        away = np.hypot(*(found.centres[rows, :2] - eye).T)
        right = np.arange(len(rows)) < len(fate.detected)
        graded.append(np.column_stack([odds[-1], away, right]))
    changes = _changes(truths, CLASSES[kind].family)
    return Samples(
        np.concatenate(errors), np.concatenate(ranges),
        echoes(*(np.concatenate(c) for c in (owners, stamps, errors))), np.concatenate(fronts),
        np.concatenate(odds), np.concatenate(graded),
        changes[:, :4], changes[:, 4], changes[:, 5:],
    )  # fmt: skip


def echoes(owners: np.ndarray, stamps: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Return `Samples.echoes` of (N,) ids and stamps and (N, 4) errors, at each of `LAGS_S`."""
    found, told = [np.empty((0, 7))], errors[:, [0, 1, 3]]
    for owner in np.unique(owners):
        own = np.flatnonzero(owners == owner)
        times = stamps[own]
        for lag in LAGS_S:
            later = np.searchsorted(times, times + lag - 1e-3)
            early = np.flatnonzero(later < len(own))
            late = later[early]
            near = np.abs(times[late] - times[early] - lag) < LAGS_S[0] / 2
            a, b = own[early[near]], own[late[near]]
            found.append(np.column_stack([np.full(len(a), lag), told[a], told[b]]))
    return np.concatenate(found)


def _errors(found: Detections, truth: Truth, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    off = found.centres[rows] - truth.centres[columns]
    yaws = truth.yaws[columns]
    c, s = np.cos(yaws), np.sin(yaws)
    turned = wrap_angle(2 * (found.yaws[rows] - yaws)) / 2
    return np.column_stack(
        [c * off[:, 0] + s * off[:, 1], c * off[:, 1] - s * off[:, 0], off[:, 2], turned]
    )


def _changes(truths: Sequence[Truth], family: Family) -> np.ndarray:
    """Return (L, 7): changes as in `Samples`, period, velocities likewise."""
    rows = [
        (int(i), t.stamp_s, *t.velocities[k], t.yaws[k], t.centres[k, 2])
        for t in truths for k, i in enumerate(t.ids) if Category(t.categories[k]).family is family
    ]  # fmt: skip
    table = np.array(sorted(rows)).reshape(-1, 6)
    changes = [np.empty((0, 7))]
    for number in np.unique(table[:, 0]):
        own = table[table[:, 0] == number]
        later = np.searchsorted(own[:, 1], own[:, 1] + WINDOW_S - 1e-6)
        early = np.flatnonzero(later < len(own))
        a, b = own[early], own[later[early]]
        c, s, dv = np.cos(a[:, 4]), np.sin(a[:, 4]), b[:, 2:4] - a[:, 2:4]
        changes.append(np.column_stack([
            c * dv[:, 0] + s * dv[:, 1], c * dv[:, 1] - s * dv[:, 0],
            wrap_angle(b[:, 4] - a[:, 4]), b[:, 5] - a[:, 5],
            b[:, 1] - a[:, 1], c * a[:, 2] + s * a[:, 3], c * a[:, 3] - s * a[:, 2],
        ]))  # fmt: skip
    return np.concatenate(changes)


def recorded_samples(
    folder: Path, sequences: Sequence[str] | None, detector: str | None
) -> tuple[dict[str, Samples], str]:
    """Collect from KITTI sequences, with a sentence on where they come from."""
    files = KittiFolder.find(folder)
    names = list(sequences) if sequences is not None else files.sequences()
    classes = {
        kind: Samples.joined([_of_sequence(files, name, kind, detector) for name in names])
        for kind in CLASSES
    }
    told = f"KITTI tracking training sequences {', '.join(names)}"
    return classes, f"{told}, detections of {files.choose_detector(detector)}"


def _of_sequence(files: KittiFolder, name: str, kind: str, detector: str | None) -> Samples:
    """Collect from one sequence; what is of another type is neither right nor wrong."""
    category = CLASSES[kind]
    sequence = read_kitti_sequence(files, name, category, detector=detector)
    poses = sequence.world_from_ego
    found = [d.moved(p, "world") for d, p in zip(sequence.detections, poses, strict=True)]
    pairings = recorded_pairings([d.centres for d in found], sequence)
    collected = episode_samples(found, sequence.truths, pairings, kind)
    return replace(collected, graded=graded_detections(sequence))


def of_class(
    kind: str, folder: Path, sequences: Sequence[str] | None, detector: str | None
) -> Iterator[KittiSequence]:
    """Read the sequences named, or all, one after the other, with detections of one class."""
    files = KittiFolder.find(folder)
    for name in sequences if sequences is not None else files.sequences():
        yield read_kitti_sequence(files, name, CLASSES[kind], detector=detector)


def recorded_pairings(found: Sequence[np.ndarray], sequence: KittiSequence) -> list[Pairing]:
    """Pair (N, 3) centres of each frame, world frame, with objects; other classes' do not count."""
    pairings = []
    for shown, truth, labels, pose in zip(
        found, sequence.truths, sequence.label_rows, sequence.world_from_ego, strict=True
    ):
        other = labels.select(
            labels.has_3d_box & (labels.types != DETECTED_TYPES[sequence.category])
        )
        others = pose.apply(centres_from_bottoms(other.bottoms, other.sizes))
        centres = np.concatenate([truth.centres, others])
        pairings.append(Pairing(
            centre_distances(shown, centres),
            np.arange(len(centres)) < len(truth), np.ones(len(shown), bool),
        ))  # fmt: skip
    return pairings


@dataclass(frozen=True, slots=True)
class Drives:
    """Train seeds of our traffic, from 400 on, and a detector on them; all are names."""

    detector: str = "distance-l-shape"
    seeds: int = 1
    scenarios: tuple[str, ...] = ("motorway", "roundabout", "intersection", "two-way")
    rigs: tuple[str, ...] = ("lux", "hdl32e")

    def told(self) -> str:
        """Say where what is learned comes from."""
        places = f"{', '.join(self.scenarios)}, rigs {', '.join(self.rigs)}"
        last = FIRST_SEED + self.seeds - 1
        return f"train seeds {FIRST_SEED} to {last} of {places}, detections of {self.detector}"


@lru_cache(maxsize=1)
def sensed_episodes(drives: Drives) -> tuple[EpisodeDetections, ...]:
    """Return a detector's detections on train seeds of our traffic."""
    source = detection_source(drives.detector)
    seeds = range(FIRST_SEED, FIRST_SEED + drives.seeds)
    episodes = (
        Episode(scenario, seed, rig, DURATION_S)
        for scenario, rig, seed in product(drives.scenarios, drives.rigs, seeds)
    )
    nodes = (detection_node(source, episode, Eligibility()) for episode in episodes)
    made = (node.compute(RunOptions()) for node in nodes)
    return tuple(each for each in made if isinstance(each, EpisodeDetections))


def of_family(kind: str, seen: EpisodeDetections) -> tuple[EpisodeDetections, Eligibility]:
    """Return an episode with detections of one class alone, and a rule by which others are none."""
    family = CLASSES[kind].family
    kinds = np.array([category for category in Category if category.family is family])
    found = tuple(d.select(np.isin(d.categories, kinds)) for d in seen.detections)
    return replace(seen, detections=found), Eligibility(families=(family.value,))


def in_ego(seen: EpisodeDetections) -> tuple[list[Detections], list[Pose]]:
    """Return an episode's detections as trackers are given them, and the ego's poses."""
    poses = [truth.world_from_ego for truth in seen.truths]
    found = [
        d.moved(p.inverse(), "ego") if d.frame == "world" else d
        for d, p in zip(seen.detections, poses, strict=True)
    ]
    return found, poses


def sensed_samples(drives: Drives) -> tuple[dict[str, Samples], str]:
    """Collect from train seeds of our traffic."""
    parts: dict[str, list[Samples]] = {kind: [] for kind in CLASSES}
    for seen in sensed_episodes(drives):
        for kind, collected in parts.items():
            own, rule = of_family(kind, seen)
            pairings = rule.pairings(own.detections, own.truths, own.parked)
            collected.append(episode_samples(own.detections, own.truths, pairings, kind))
    return {kind: Samples.joined(some) for kind, some in parts.items()}, drives.told()
