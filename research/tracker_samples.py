"""Samples for `tracker_traits` from training data: errors of detections, changes of motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from roadscope import Category, Detections, Episode, Family, Pose, Tracks, Truth
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.formats.kitti_frames import centres_from_bottoms
from roadscope.benchmarks.formats.kitti_labels import DETECTED_TYPES
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.matching import Pairing, centre_distances, match
from roadscope.benchmarks.metrics.tracking.matching import match_tracks
from roadscope.benchmarks.nodes.fusions import detection_node
from roadscope.benchmarks.recorded.rules import BOX_SIMILARITIES, apply_kitti_rules
from roadscope.benchmarks.records import EpisodeDetections
from roadscope.benchmarks.references import detection_source
from roadscope.core.pose import wrap_angle
from roadscope.formats import KittiFolder, KittiSequence, read_kitti_sequence
from roadscope.trackers import score_log_odds

CLASSES = {"car": Category.CAR, "cyclist": Category.CYCLIST, "pedestrian": Category.PEDESTRIAN}
GATES_M = {"car": 2.0, "cyclist": 1.0, "pedestrian": 1.0}
"""A detection that is farther from an object does not belong to it."""
FIRST_SEED = 400
DURATION_S = 6.0
LAGS_S = (0.2, 1.0)
"""Times between two detections of one object whose errors are compared."""
WINDOW_S = 1.0
"""Time over which changes of motion are taken: shorter ones are those of labels."""
KITTI_MEASURE = "iou_2d"
"""How the KITTI benchmark compares boxes."""


class KittiSource(NamedTuple):
    """Recorded training data: folder, sequences (None: all) and detector (None: the only one)."""

    folder: Path
    sequences: Sequence[str] | None = None
    detector: str | None = None

    def read(self, category: Category) -> Iterator[KittiSequence]:
        """Read one sequence after the other, with detections of one class."""
        files = KittiFolder.find(self.folder)
        for name in self.names():
            yield read_kitti_sequence(files, name, category, detector=self.detector)

    def names(self) -> list[str]:
        """Return the names of the sequences."""
        files = KittiFolder.find(self.folder)
        return list(self.sequences) if self.sequences is not None else files.sequences()

    def origin(self) -> str:
        """Say where what is learned comes from."""
        detector = KittiFolder.find(self.folder).choose_detector(self.detector)
        sequences = ", ".join(self.names())
        return f"KITTI tracking training sequences {sequences}, detections of {detector}"


class TrafficSource(NamedTuple):
    """Simulated training data: train seeds from 400 on, and a detector on them; all are names."""

    detector: str = "distance-l-shape"
    seeds: int = 1
    scenarios: tuple[str, ...] = ("motorway", "roundabout", "intersection", "two-way")
    rigs: tuple[str, ...] = ("lux", "hdl32e")

    def origin(self) -> str:
        """Say where what is learned comes from."""
        places = f"{', '.join(self.scenarios)}, rigs {', '.join(self.rigs)}"
        last = FIRST_SEED + self.seeds - 1
        return f"train seeds {FIRST_SEED} to {last} of {places}, detections of {self.detector}"


@lru_cache(maxsize=1)
def traffic_episodes(source: TrafficSource) -> tuple[EpisodeDetections, ...]:
    """Return a detector's detections on train seeds of our traffic."""
    detector = detection_source(source.detector)
    seeds = range(FIRST_SEED, FIRST_SEED + source.seeds)
    episodes = (
        Episode(scenario, seed, rig, DURATION_S)
        for scenario, rig, seed in product(source.scenarios, source.rigs, seeds)
    )
    nodes = (detection_node(detector, episode, Eligibility()) for episode in episodes)
    results = (node.compute(RunOptions()) for node in nodes)
    return tuple(each for each in results if isinstance(each, EpisodeDetections))


@dataclass(frozen=True, slots=True, eq=False)
class TraitSamples:
    """Of one class: N matched detections, M scores, J judged detections, L changes of motion.

    errors: (N, 4) along and across the true box, z (metres), heading (radians, up to half turns).
    ranges_m: (N,).
    pairs: (E, 7) seconds between two detections of one object, and errors along, across and of the
        heading of both.
    fronts: (N,) bool, whether front and rear are not confused.
    log_odds: (M,) of scores.
    judged: (J, 3) log odds of the score, range in metres, 1 for right and 0 for wrong.
    changes: (L, 4) of velocity along and across, heading, z. periods_s: (L,).
    velocities: (L, 2) m/s along and across the heading.
    """

    errors: np.ndarray
    ranges_m: np.ndarray
    pairs: np.ndarray
    fronts: np.ndarray
    log_odds: np.ndarray
    judged: np.ndarray
    changes: np.ndarray
    periods_s: np.ndarray
    velocities: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Put samples together."""
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))


class CollectedSamples(NamedTuple):
    """Samples of each class, and a sentence on where they come from."""

    classes: dict[str, TraitSamples]
    origin: str


def recorded_samples(source: KittiSource) -> CollectedSamples:
    """Collect samples from KITTI sequences."""
    classes = {
        kind: TraitSamples.joined([_of_sequence(each, kind) for each in source.read(category)])
        for kind, category in CLASSES.items()
    }
    return CollectedSamples(classes, source.origin())


def simulated_samples(source: TrafficSource) -> CollectedSamples:
    """Collect samples from train seeds of our traffic."""
    parts: dict[str, list[TraitSamples]] = {kind: [] for kind in CLASSES}
    for episode in traffic_episodes(source):
        for kind, collected in parts.items():
            own, rule = of_class(kind, episode)
            pairings = rule.pairings(own.detections, own.truths, own.parked)
            collected.append(episode_samples(own.detections, own.truths, pairings, kind))
    classes = {kind: TraitSamples.joined(some) for kind, some in parts.items()}
    return CollectedSamples(classes, source.origin())


def _of_sequence(sequence: KittiSequence, kind: str) -> TraitSamples:
    """Collect from one sequence; objects of another type are neither right nor wrong."""
    detections = [
        each.moved(pose, "world")
        for each, pose in zip(sequence.detections, sequence.world_from_ego, strict=True)
    ]
    pairings = recorded_pairings([each.centres for each in detections], sequence)
    collected = episode_samples(detections, sequence.truths, pairings, kind)
    return replace(collected, judged=judged_by_kitti(sequence))


def episode_samples(
    detections: Sequence[Detections],
    truths: Sequence[Truth],
    pairings: Sequence[Pairing],
    kind: str,
) -> TraitSamples:
    """Collect samples of one class from an episode; detections and truths in the world frame."""
    errors, ranges, fronts, odds, judged_parts = [np.empty((0, 4))], [], [], [], []
    owners, stamps = [np.empty(0)], [np.empty(0)]
    for detected, truth, pairing in zip(detections, truths, pairings, strict=True):
        fate = match(pairing, GATES_M[kind])
        errors.append(_errors(detected, truth, fate.detected, fate.truth))
        ego = truth.world_from_ego.translation[:2]
        turned = detected.yaws[fate.detected] - truth.yaws[fate.truth]
        owners.append(truth.ids[fate.truth])
        stamps.append(np.full(len(fate.truth), truth.stamp_s))
        fronts.append(np.cos(turned) > 0)
        ranges.append(np.hypot(*(truth.centres[fate.truth, :2] - ego).T))
        rows = np.concatenate([fate.detected, fate.false_alarms])
        odds.append(score_log_odds(detected.scores[rows]))
        ranges_m = np.hypot(*(detected.centres[rows, :2] - ego).T)
        right = np.arange(len(rows)) < len(fate.detected)
        judged_parts.append(np.column_stack([odds[-1], ranges_m, right]))
    changes = _changes(truths, CLASSES[kind].family)
    return TraitSamples(
        errors=np.concatenate(errors),
        ranges_m=np.concatenate(ranges),
        pairs=error_pairs(np.concatenate(owners), np.concatenate(stamps), np.concatenate(errors)),
        fronts=np.concatenate(fronts),
        log_odds=np.concatenate(odds),
        judged=np.concatenate(judged_parts),
        changes=changes[:, :4],
        periods_s=changes[:, 4],
        velocities=changes[:, 5:],
    )


def error_pairs(owners: np.ndarray, stamps: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Return `TraitSamples.pairs` of (N,) ids and stamps and (N, 4) errors, at each of `LAGS_S`."""
    pairs, compared = [np.empty((0, 7))], errors[:, [0, 1, 3]]
    for owner in np.unique(owners):
        own = np.flatnonzero(owners == owner)
        times = stamps[own]
        for lag in LAGS_S:
            later = np.searchsorted(times, times + lag - 1e-3)
            early = np.flatnonzero(later < len(own))
            late = later[early]
            near = np.abs(times[late] - times[early] - lag) < LAGS_S[0] / 2
            a, b = own[early[near]], own[late[near]]
            pairs.append(np.column_stack([np.full(len(a), lag), compared[a], compared[b]]))
    return np.concatenate(pairs)


def _errors(
    detected: Detections, truth: Truth, rows: np.ndarray, columns: np.ndarray
) -> np.ndarray:
    """Return (N, 4) errors of rows of detections against columns of the truth."""
    offsets = detected.centres[rows] - truth.centres[columns]
    yaws = truth.yaws[columns]
    cos, sin = np.cos(yaws), np.sin(yaws)
    turned = wrap_angle(2 * (detected.yaws[rows] - yaws)) / 2
    return np.column_stack(
        [
            cos * offsets[:, 0] + sin * offsets[:, 1],
            cos * offsets[:, 1] - sin * offsets[:, 0],
            offsets[:, 2],
            turned,
        ]
    )


def _changes(truths: Sequence[Truth], family: Family) -> np.ndarray:
    """Return (L, 7): changes as in `TraitSamples`, period, velocities likewise."""
    rows = [
        (int(i), t.stamp_s, *t.velocities[k], t.yaws[k], t.centres[k, 2])
        for t in truths
        for k, i in enumerate(t.ids)
        if Category(t.categories[k]).family is family
    ]
    table = np.array(sorted(rows)).reshape(-1, 6)
    changes = [np.empty((0, 7))]
    for number in np.unique(table[:, 0]):
        own = table[table[:, 0] == number]
        later = np.searchsorted(own[:, 1], own[:, 1] + WINDOW_S - 1e-6)
        early = np.flatnonzero(later < len(own))
        a, b = own[early], own[later[early]]
        cos, sin, gained = np.cos(a[:, 4]), np.sin(a[:, 4]), b[:, 2:4] - a[:, 2:4]
        changes.append(
            np.column_stack(
                [
                    cos * gained[:, 0] + sin * gained[:, 1],
                    cos * gained[:, 1] - sin * gained[:, 0],
                    wrap_angle(b[:, 4] - a[:, 4]),
                    b[:, 5] - a[:, 5],
                    b[:, 1] - a[:, 1],
                    cos * a[:, 2] + sin * a[:, 3],
                    cos * a[:, 3] - sin * a[:, 2],
                ]
            )
        )
    return np.concatenate(changes)


def recorded_pairings(centres: Sequence[np.ndarray], sequence: KittiSequence) -> list[Pairing]:
    """Pair (N, 3) centres of each frame, world frame, with objects; other classes' do not count."""
    pairings = []
    for own, truth, labels, pose in zip(
        centres, sequence.truths, sequence.label_rows, sequence.world_from_ego, strict=True
    ):
        other = labels.select(
            labels.has_3d_box & (labels.types != DETECTED_TYPES[sequence.category])
        )
        others = pose.apply(centres_from_bottoms(other.bottoms, other.sizes))
        objects = np.concatenate([truth.centres, others])
        eligible = np.arange(len(objects)) < len(truth)
        distances = centre_distances(own, objects)
        pairings.append(Pairing(distances, eligible, np.ones(len(own), bool)))
    return pairings


class OwnClass(NamedTuple):
    """An episode with detections of one class alone, and a rule by which only its objects count."""

    episode: EpisodeDetections
    rule: Eligibility


def of_class(kind: str, episode: EpisodeDetections) -> OwnClass:
    """Return the part of an episode that is about one class."""
    family = CLASSES[kind].family
    categories = np.array([category for category in Category if category.family is family])
    detections = tuple(d.select(np.isin(d.categories, categories)) for d in episode.detections)
    own = replace(episode, detections=detections)
    return OwnClass(own, Eligibility(families=(family.value,)))


class TrackedInput(NamedTuple):
    """What a tracker gets: detections in the ego frame, and the poses of the ego."""

    detections: Sequence[Detections]
    poses: Sequence[Pose]


def tracker_input(episode: EpisodeDetections) -> TrackedInput:
    """Return an episode as trackers get it."""
    poses = [truth.world_from_ego for truth in episode.truths]
    detections = [
        each.moved(pose.inverse(), "ego") if each.frame == "world" else each
        for each, pose in zip(episode.detections, poses, strict=True)
    ]
    return TrackedInput(detections, poses)


def right_by_kitti(
    tracks: Sequence[Tracks], sequence: KittiSequence
) -> dict[tuple[int, int], bool]:
    """Return for each (frame, id) that counts whether it is on an object, by KITTI's rules."""
    rows, kind = sequence.result_rows(tracks), DETECTED_TYPES[sequence.category]
    counted = apply_kitti_rules(sequence.label_rows, rows, kind, KITTI_MEASURE)
    right = np.zeros(len(counted.tracks), bool)
    right[match_tracks(counted, BOX_SIMILARITIES[KITTI_MEASURE].threshold).track_rows] = True
    frames = np.repeat(np.arange(len(counted)), counted.track_counts).tolist()
    keys = zip(frames, counted.track_ids.tolist(), strict=True)
    return dict(zip(keys, right.tolist(), strict=True))


def judged_by_kitti(sequence: KittiSequence) -> np.ndarray:
    """Return `TraitSamples.judged` of the detections of a sequence, by KITTI's rules."""
    as_tracks = [Tracks.of(each, np.arange(len(each))) for each in sequence.detections]
    known = right_by_kitti(as_tracks, sequence)
    parts = [np.empty((0, 3))]
    for t, detected in enumerate(sequence.detections):
        rows = [i for i in range(len(detected)) if (t, i) in known]
        ranges_m = np.hypot(detected.centres[rows, 0], detected.centres[rows, 1])
        right = np.array([known[t, i] for i in rows], float)
        parts.append(np.column_stack([score_log_odds(detected.scores[rows]), ranges_m, right]))
    return np.concatenate(parts)
