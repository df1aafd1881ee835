"""Scores of result files that were made elsewhere, as rows of a board."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.benchmarks.boards.board import CONDITIONS
from roadscope.benchmarks.compare import check_comparable, read_run
from roadscope.benchmarks.episode import sensed, sensing_of
from roadscope.benchmarks.export_suite import (
    ExportedSequence,
    Manifest,
    SequenceView,
    digest_of,
    read_manifest,
)
from roadscope.benchmarks.formats.kitti import detections_of
from roadscope.benchmarks.formats.kitti_folder import KittiFolder
from roadscope.benchmarks.formats.kitti_objects import (
    TYPE_OF,
    KittiObjects,
    KittiType,
    read_labels,
)
from roadscope.benchmarks.formats.kitti_rules import SIMILARITIES, judged
from roadscope.benchmarks.formats.mot_rules import THRESHOLD, distractors_of, mot_judged
from roadscope.benchmarks.formats.motchallenge import by_frame, read_mot, read_mot_sequence
from roadscope.benchmarks.formats.table import FormatError, read_lines
from roadscope.benchmarks.formats.trajectories import TrajectoryFormat, read_trajectory
from roadscope.benchmarks.metrics import METRIC_VERSION
from roadscope.benchmarks.metrics.odometry import (
    Trajectories,
    by_distance,
    score_odometry,
    score_standing,
)
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracking import score_tracks
from roadscope.benchmarks.metrics.tracking.alphas import score_alphas
from roadscope.benchmarks.metrics.tracking.hota import hota
from roadscope.benchmarks.parked import parked_among
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.recorded.combined import SUFFIXES, alpha_parts
from roadscope.benchmarks.recorded.kitti_scores import sequence_scores
from roadscope.benchmarks.recorded.mot import MOT, MotRecording, mot_suite
from roadscope.benchmarks.recorded.recording import Recording, recordings_of
from roadscope.benchmarks.recorded.suite import KITTI
from roadscope.benchmarks.results import JobScores, Results, results_of
from roadscope.core import Category, Detections, Pose, Tracks, Truth

TRACKING, ODOMETRY = "tracking", "odometry"
OWN = "own detections"
"""What a submitted tracker is said to follow where nothing else is said."""
STATELESS = (
    "velocity_rmse_m_s",
    "nees_position",
    "nees_state",
    "nees_in_band",
    "inside_position",
    "inside_state",
)
"""Scores of velocities and covariances, of which result files say nothing."""
CATEGORY_OF = {
    KittiType.CAR: Category.CAR,
    KittiType.VAN: Category.VAN,
    KittiType.TRUCK: Category.TRUCK,
    KittiType.TRAM: Category.BUS,
    KittiType.MISC: Category.BUS,
    KittiType.PEDESTRIAN: Category.PEDESTRIAN,
    KittiType.PERSON: Category.PEDESTRIAN,
    KittiType.CYCLIST: Category.CYCLIST,
}
NEAR = 0.25
"""A pose is of a scan whose stamp it is this near to, in periods. Chosen by hand."""
AHEAD_M = 10.0
"""Nobody drives so far along an axis that points upwards and less along the others."""


class SubmitError(ValueError):
    """Results cannot be scored as given."""


@dataclass(frozen=True, slots=True)
class Submission:
    """Results made elsewhere, scored under the rules of a board.

    manifest: which suite, and the version of the metrics.
    """

    name: str
    manifest: Mapping[str, Any]
    episodes: tuple[JobScores, ...]

    def boards(self) -> list[str]:
        """Return the boards that it has results for."""
        return list(dict.fromkeys(e.board for e in self.episodes))

    def to_json(self) -> str:
        """Return text that `compare` reads."""
        scores = [episode.to_json() for episode in self.episodes]
        content = {"manifest": dict(self.manifest), "scores": scores}
        return json.dumps(content, indent=1, allow_nan=False) + "\n"

    def beside(self, results: Path | str) -> Results:
        """Return a suite's board with the submission as one more entry.

        results: a `leaderboard.json` of the same suite, or a folder that holds one; a file of
            another suite or version raises `CompareError`.
        """
        run, own = read_run(results), read_run(self)
        check_comparable(run, own)
        jobs = [job for job in run.jobs if job.board in self.boards()]
        return results_of([*jobs, *self.episodes], run.manifest)


def submit(
    folder: Path | str,
    *,
    name: str | None = None,
    suite: Path | str | None = None,
    inputs: str = OWN,
    progress: Progress = silent,
) -> Submission:
    """Score results on an exported suite: `tracking/SEQ.txt` and `odometry/SEQ.txt`.

    folder: where the results lie. suite: the exported folder; the same if left out.
    name: of the entry; the folder's if left out.
    inputs: whose detections were tracked, as the suite calls it.

    Tracks are KITTI results with 3-D boxes in the camera frame of `calib`. Poses are the LiDAR's, x
    ahead, 12 numbers a line as KITTI has them, a line for each scan, or TUM's with stamps. The
    truth is made again from the suite's seeds. A sequence without a file counts as failed; a
    malformed file raises `FormatError`.
    """
    place, exported = Path(folder), Path(folder if suite is None else suite)
    _check_folder(place)
    manifest = read_manifest(exported)
    boards = [board for board in (TRACKING, ODOMETRY) if (place / board).is_dir()]
    if not boards:
        raise SubmitError(f"{place}: expected tracking/SEQ.txt or odometry/SEQ.txt, got neither")
    for board in boards:
        _check_names(place / board, [s.name for s in manifest.sequences])
    episodes = []
    for number, sequence in enumerate(manifest.sequences):
        progress("sequences", number, len(manifest.sequences))
        episodes += _on_sequence(place, exported, manifest, sequence, boards, inputs)
    progress("sequences", len(manifest.sequences), len(manifest.sequences))
    about = {
        "suite": manifest.suite,
        "suite_version": manifest.suite_version,
        "metric_version": METRIC_VERSION,
    }
    return _submission(name or place.resolve().name, about, episodes)


def submit_kitti(folder: Path | str, kitti: Path | str, *, name: str | None = None) -> Submission:
    """Score KITTI tracking results, `SEQ.txt`, against a folder of KITTI tracking data.

    Scores are by boxes in the image; where all results have 3-D boxes, by these and by centres too.
    """
    place, files = Path(folder), KittiFolder.find(kitti)
    _check_folder(place)
    sequences = files.sequences()
    _check_names(place, sequences)
    labels = {sequence: read_labels(files.labels(sequence)) for sequence in sequences}
    results = {
        sequence: read_labels(place / f"{sequence}.txt", results=True)
        for sequence in sequences
        if (place / f"{sequence}.txt").is_file()
    }
    solid = all(bool(rows.solid.all()) for rows in results.values())
    kinds = [
        c for c, kind in TYPE_OF.items() if any((r.types == kind).any() for r in labels.values())
    ]
    episodes = []
    for category in kinds:
        for number, sequence in enumerate(sequences):
            about = Recording(str(files.root), sequence, category.name.lower(), "", number)
            given = results.get(sequence)
            scores = (
                {} if given is None else _kitti_scores(labels[sequence], given, category, solid)
            )
            episodes.append(_recorded(about, scores, given is None))
    return _submission(
        name or place.resolve().name, {"suite": KITTI, "metric_version": METRIC_VERSION}, episodes
    )


def submit_mot(folder: Path | str, mot: Path | str, *, name: str | None = None) -> Submission:
    """Score MOTChallenge results, `SEQ.txt`, against a folder of MOTChallenge data."""
    place = Path(folder)
    _check_folder(place)
    recordings = [r for r in recordings_of(mot_suite(mot)) if isinstance(r, MotRecording)]
    _check_names(place, [r.sequence for r in recordings])
    episodes = []
    for recording in recordings:
        path = place / f"{recording.sequence}.txt"
        scores = _mot_scores(recording, path) if path.is_file() else {}
        episodes.append(_recorded(recording, scores, not path.is_file()))
    return _submission(
        name or place.resolve().name, {"suite": MOT, "metric_version": METRIC_VERSION}, episodes
    )


def _submission(
    name: str, manifest: Mapping[str, Any], episodes: Sequence[JobScores]
) -> Submission:
    return Submission(name, manifest, tuple(replace(each, entry=name) for each in episodes))


def _check_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise SubmitError(f"no folder {folder}")


def _check_names(folder: Path, known: Sequence[str]) -> None:
    """Refuse a folder without any file of a sequence, and files of sequences that do not exist."""
    there = sorted(path.stem for path in folder.glob("*.txt"))
    wrong = [name for name in there if name not in known]
    if not there or wrong:
        got = f"{wrong[0]}.txt" if wrong else "none"
        shown = ", ".join(known[:5]) + (", ..." if len(known) > 5 else "")
        raise SubmitError(f"{folder}: expected SEQ.txt of sequences {shown}; got {got}")


def _missing(path: str) -> str:
    return f"no result file {path}"


def _recorded(about: Recording, scores: Mapping[str, Score], missing: bool) -> JobScores:
    reason = _missing(f"{about.sequence}.txt") if missing else None
    conditions = {"sequence": about.sequence}
    return JobScores(
        about.board,
        "",
        about.scenario,
        about.seed,
        about.condition,
        "",
        scores,
        reason,
        conditions=conditions,
    )


def _kitti_scores(
    labels: KittiObjects, results: KittiObjects, category: Category, solid: bool
) -> dict[str, Score]:
    count = 1 + max(int(rows.frames.max(initial=-1)) for rows in (labels, results))
    scores: dict[str, Score] = {}
    for similarity, suffix in SUFFIXES.items() if solid else [("iou_2d", "")]:
        counted = judged(
            labels.by_frame(count), results.by_frame(count), TYPE_OF[category], similarity
        )
        found = sequence_scores(counted, SIMILARITIES[similarity].threshold)
        scores |= {f"{metric}{suffix}": score for metric, score in found.items()}
        scores |= alpha_parts(hota(counted), suffix)
    return scores


def _mot_scores(recording: MotRecording, path: Path) -> dict[str, Score]:
    known = read_mot_sequence(Path(recording.folder) / recording.sequence)
    assert known.truth is not None
    count = len(known.truth)
    rows = read_mot(path, end=(count, f"the last of the sequence {recording.sequence}"))
    counted = mot_judged(known.truth, by_frame(rows, count), distractors_of(known.name))
    return sequence_scores(counted, THRESHOLD) | alpha_parts(hota(counted))


def _on_sequence(
    folder: Path,
    exported: Path,
    manifest: Manifest,
    sequence: ExportedSequence,
    boards: Sequence[str],
    inputs: str,
) -> list[JobScores]:
    """Score the results of one sequence on each board."""
    from roadscope.envs.sensors.rigs import rig

    episode = manifest.episode(sequence, exported)
    files = {board: folder / board / f"{sequence.name}.txt" for board in boards}
    if any(path.is_file() for path in files.values()):
        truths, carrier = _truth(manifest, sequence, exported), rig(episode.rig)
        view = SequenceView.of(carrier, sensing_of(episode).calibration)
        mount = carrier.lidar.ego_from_lidar
    found = []
    for board, path in files.items():
        scores: Mapping[str, Score] = {}
        if path.is_file() and board == TRACKING:
            tracks = read_tracks(path, view, truths)
            parked = parked_among(episode, truths)
            pairings = manifest.eligibility.pairings(tracks, truths, parked)
            every = score_tracks(tracks, truths, pairings).named()
            scores = {k: v for k, v in every.items() if k not in STATELESS}
            scores = {**scores, **score_alphas(tracks, truths, pairings)}
        elif path.is_file():
            scores = _odometry_scores(path, manifest, sequence, truths, mount)
        found.append(
            JobScores(
                board,
                "",
                sequence.scenario,
                sequence.seed,
                episode.condition,
                inputs if board == TRACKING else "",
                scores,
                None if path.is_file() else _missing(f"{board}/{path.name}"),
                conditions={by: of(episode) for by, of in CONDITIONS.items()},
            )
        )
    return found


def _truth(manifest: Manifest, sequence: ExportedSequence, exported: Path) -> list[Truth]:
    """Make the truth of a sequence again; other truth than was exported is refused."""
    if not sequence.digest:
        raise SubmitError(
            f"{exported}: sequence {sequence.name} is not written: export the suite to its end"
        )
    truths = [truth for _, truth in sensed(manifest.episode(sequence, exported))]
    if digest_of(truths) != sequence.digest:
        raise SubmitError(
            f"{exported}: sequence {sequence.name} has other traffic than this version of "
            f"roadscope makes; {manifest.roadscope} exported it: export the suite again"
        )
    return truths


def read_tracks(path: Path, view: SequenceView, truths: Sequence[Truth]) -> list[Tracks]:
    """Read KITTI results as tracks, world frame, one record a frame.

    Scores beyond 0 to 1 are mapped by the logistic function, all of them.
    """
    rows = read_labels(path, results=True)
    rows = rows.select(rows.types != KittiType.DONT_CARE)
    last = int(rows.frames.max(initial=-1))
    if last >= len(truths):
        raise FormatError(f"{path}: expected frames 0 to {len(truths) - 1}, got {last}")
    if not rows.solid.all():
        raise FormatError(f"{path}: expected 3-D boxes in the camera frame, got a row without")
    if (rows.ids < 0).any():
        raise FormatError(f"{path}: expected ids from 0 on, got {int(rows.ids.min())}")
    shares = bool(((rows.scores >= 0) & (rows.scores <= 1)).all())
    tracks = []
    for each, truth in zip(rows.by_frame(len(truths)), truths, strict=True):
        boxes = detections_of(each, Category.CAR, truth.stamp_s, shares)
        boxes = _with_categories(boxes, each)
        pose = view.turned(truth.world_from_ego)
        tracks.append(Tracks.of(boxes.moved(pose, "world"), each.ids))
    return tracks


def _with_categories(boxes: Detections, rows: KittiObjects) -> Detections:
    categories = [CATEGORY_OF[KittiType(kind)] for kind in rows.types]
    return replace(boxes, categories=np.array(categories, np.int8))


def _odometry_scores(
    path: Path,
    manifest: Manifest,
    sequence: ExportedSequence,
    truths: Sequence[Truth],
    ego_from_lidar: Pose,
) -> dict[str, Score]:
    """Return the scores of poses."""
    arrived = [k for k in range(len(truths)) if k not in sequence.lost]
    stamps_s = np.array([truths[k].stamp_s for k in range(len(truths))])
    poses = read_lidar_poses(path, stamps_s, arrived)
    true = [truths[k].world_from_ego @ ego_from_lidar for k in arrived]
    both = Trajectories(
        np.array([pose.matrix for pose in poses]), np.array([pose.matrix for pose in true])
    )
    return {
        **score_odometry(both, lengths_m=manifest.odometry_lengths_m).named(),
        **score_standing(both, stamps_s[arrived]).named(),
        **by_distance(both),
    }


def read_lidar_poses(path: Path, stamps_s: np.ndarray, arrived: Sequence[int]) -> list[Pose]:
    """Read the pose of the LiDAR at each scan that arrived, from a KITTI or TUM file.

    stamps_s: (N,) of all scans. A file in KITTI's format has a line for each of these, or for each
    that arrived.
    """
    form = _form_of(path)
    found = read_trajectory(path, form)
    if found.stamps_s is not None:
        poses = _at(path, found.poses, np.array(found.stamps_s), stamps_s[list(arrived)])
    elif len(found.poses) == len(stamps_s):
        poses = [found.poses[k] for k in arrived]
    elif len(found.poses) == len(arrived):
        poses = list(found.poses)
    else:
        raise FormatError(
            f"{path}: expected {len(stamps_s)} poses, one for each scan, got {len(found.poses)}"
        )
    x, y, z = np.abs((poses[0].inverse() @ poses[-1]).translation)
    if z > max(x, y, AHEAD_M):
        raise FormatError(
            f"{path}: expected poses of the LiDAR, x ahead; the z axis of these points ahead, as a "
            "camera's does"
        )
    return poses


def _form_of(path: Path) -> TrajectoryFormat:
    """Tell the format of poses by the numbers in a line."""
    for line in read_lines(path):
        if line.strip() and not line.startswith("#"):
            count = len(line.split())
            if count in (8, 12):
                return "tum" if count == 8 else "kitti"
            raise FormatError(
                f"{path}: expected 12 numbers a line (KITTI) or 8 (TUM: stamp tx ty tz qx qy qz "
                f"qw), got {count}"
            )
    raise FormatError(f"{path}: expected poses, got an empty file")


def _at(path: Path, poses: Sequence[Pose], given_s: np.ndarray, wanted_s: np.ndarray) -> list[Pose]:
    """Return the pose of each wanted stamp."""
    period_s = float(np.median(np.diff(wanted_s))) if len(wanted_s) > 1 else 0.1
    right = np.clip(np.searchsorted(given_s, wanted_s), 1, max(len(given_s) - 1, 1))
    nearest = np.minimum(right, len(given_s) - 1)
    left_nearer = np.abs(given_s[right - 1] - wanted_s) < np.abs(given_s[nearest] - wanted_s)
    nearest = np.where(left_nearer, right - 1, nearest)
    off = np.abs(given_s[nearest] - wanted_s)
    if (off > NEAR * period_s).any():
        missing = wanted_s[np.argmax(off > NEAR * period_s)]
        raise FormatError(f"{path}: expected a pose at each scan, got none at {missing:.3f} s")
    return [poses[k] for k in nearest.tolist()]
