"""Scores result files of other programs, as rows of a board."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from roadscope.benchmarks.boards.board import CONDITIONS
from roadscope.benchmarks.boards.camera import CameraBoard, image_scores
from roadscope.benchmarks.boards.detection import DetectionBoard, detection_parts, detection_scores
from roadscope.benchmarks.boards.fusion import FusionBoard
from roadscope.benchmarks.boards.odometry import OdometryBoard
from roadscope.benchmarks.boards.tracking import TrackingBoard
from roadscope.benchmarks.compare import check_comparable, read_run
from roadscope.benchmarks.episode import Episode, sensed, sensing_of
from roadscope.benchmarks.formats.kitti_frames import detections_from_rows
from roadscope.benchmarks.formats.kitti_labels import (
    DETECTED_TYPES,
    KittiObjects,
    KittiType,
    read_kitti_labels,
    read_kitti_object_results,
)
from roadscope.benchmarks.formats.kitti_sequence import KittiFolder
from roadscope.benchmarks.formats.table import FormatError, visible
from roadscope.benchmarks.formats.tracking_rows import logistic
from roadscope.benchmarks.formats.trajectories import read_any_trajectory
from roadscope.benchmarks.metrics import METRIC_VERSION
from roadscope.benchmarks.metrics.odometry import by_distance, score_odometry, score_standing
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracking import score_each_alpha
from roadscope.benchmarks.metrics.trajectory_errors import Trajectories
from roadscope.benchmarks.nodes.images import ImageNode
from roadscope.benchmarks.parked import parked_among
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.recorded.combined import SUFFIXES
from roadscope.benchmarks.recorded.kitti_drive import CATEGORIES
from roadscope.benchmarks.recorded.mot import MOT, MotRecording, mot_suite, score_mot_results
from roadscope.benchmarks.recorded.recording import Recording, recordings_of
from roadscope.benchmarks.recorded.scores import kitti_result_scores
from roadscope.benchmarks.recorded.suite import KITTI
from roadscope.benchmarks.records import EpisodeDetections, EpisodeImageDetections
from roadscope.benchmarks.references import image_source
from roadscope.benchmarks.results import JobScores, Results, results_of
from roadscope.benchmarks.results.rows import JobName
from roadscope.benchmarks.suite_exports import (
    ExportedSequence,
    Manifest,
    SequenceView,
    read_manifest,
    truth_digest,
)
from roadscope.core import Category, Detections, ImageDetections, Pose, Tracks, Truth
from roadscope.core.spec import ORACLE

NO_FUSIONS = (
    "results of fusions cannot be scored: KITTI's rows do not say which sensor detected an object"
)
OWN = "own detections"
"""Shown as the input of a submitted tracker, unless the user names a detector."""
NOT_IN_FILES = (
    "velocity_rmse_m_s",
    "nees_position",
    "nees_state",
    "nees_in_band",
    "inside_position",
    "inside_state",
)
"""Scores of velocities and covariances, which result files do not have."""
CATEGORY_OF = {**CATEGORIES, KittiType.TRAM: Category.BUS, KittiType.MISC: Category.BUS}
AHEAD_M = 10.0
"""An axis along which a drive goes farther than this points ahead, not up. Chosen by hand."""
MOST_STAMP_GAP = 0.25
"""Greatest difference between the stamps of a pose and of its scan, in periods of the LiDAR. Chosen
by hand."""


class SubmitError(ValueError):
    """Results cannot be scored."""


@dataclass(frozen=True, slots=True)
class Submission:
    """Results of another program, scored by the rules of a board.

    manifest: the suite and the version of the metrics.
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

        results: a `leaderboard.json` of the same suite, or a folder that holds one; `CompareError`
            for a file of another suite or version. All entries are compared on the episodes of
            the submission; a warning says how many it lacks.
        """
        run, own = read_run(results), read_run(self)
        check_comparable(run, own)
        if self.name in run.entries():
            raise SubmitError(f"{run.label} has an entry {self.name} already; choose another name")
        boards = self.boards()
        jobs = [job for job in run.jobs if job.board in boards]
        own_episodes = {_episode_name(job) for job in self.episodes}
        shared = [job for job in jobs if _episode_name(job) in own_episodes]
        if left_out := {_episode_name(job) for job in jobs} - own_episodes:
            warnings.warn(
                f"{self.name} has no results of {len(left_out)} episodes of {run.label}: all "
                "entries are compared on the others",
                stacklevel=2,
            )
        return results_of([*shared, *self.episodes], run.manifest)


def _episode_name(job: JobScores) -> JobName:
    """Return the name of a job's episode, without the source of its detections."""
    return job.name._replace(inputs="")


def submit(
    folder: Path | str,
    *,
    name: str | None = None,
    suite: Path | str | None = None,
    inputs: str = OWN,
    progress: Progress | None = None,
) -> Submission:
    """Score results on an exported suite: of detectors, camera detectors, trackers and odometries.

    folder: of the results. suite: the exported folder; `folder` if left out.
    name: of the entry; that of the folder if left out.
    inputs: the detector whose detections were tracked, by its name in the suite.
    progress: called with the stage, sequences done and sequences in all.

    `detection/SEQ/FRAME.txt` are KITTI object results, a file for each scan, named like its
    `velodyne` file. `tracking/SEQ.txt` are KITTI tracking results. Boxes are 3-D, in the camera
    frame of `calib`. `odometry/SEQ.txt` are poses of the LiDAR, x ahead, 12 numbers a line as KITTI
    has them, a line for each scan, or TUM's with stamps. `camera/SEQ/FRAME.txt` are KITTI object
    results with boxes in the image, a file for each image in `camera_images`. The truth is made
    again from the suite's seeds. A sequence without a file counts as failed; a malformed file
    raises `FormatError`.

    Results of fusions cannot be scored. The fusion board matches what the camera detected in the
    image and the rest in space, but a row of KITTI's does not say which sensor detected the object,
    nor a distance without a 3-D box; and fusions get detections in images, which are not exported.
    """
    place, exported = Path(folder), Path(folder if suite is None else suite)
    report = progress or silent
    _check_folder(place)
    manifest = read_manifest(exported)
    if (place / FusionBoard.name).is_dir():
        raise SubmitError(f"{place / FusionBoard.name}: {NO_FUSIONS}")
    boards = [board for board in RESULT_KINDS if (place / board.name).is_dir()]
    if not boards:
        wanted = " or ".join(f"{board.name}/SEQ{board.ending}" for board in RESULT_KINDS)
        raise SubmitError(f"{place}: expected {wanted}, got none of them")
    if (place / CameraBoard.name).is_dir():
        _check_images(manifest, exported)
    for board in boards:
        _check_names(place / board.name, [s.name for s in manifest.sequences], board.ending)
    episodes = []
    for number, sequence in enumerate(manifest.sequences):
        report("sequences", number, len(manifest.sequences))
        files = {b: place / b.name / f"{sequence.name}{b.ending}" for b in boards}
        submitted = any(path.exists() for path in files.values())
        true = _true_sequence(manifest, sequence, exported) if submitted else None
        episode = manifest.episode(sequence, exported)
        for board, path in files.items():
            scores = board.score(path, true) if true is not None and path.exists() else None
            job = _job_scores(
                board.name,
                episode,
                scores,
                file=path.relative_to(place),
                conditions={by: of(episode) for by, of in CONDITIONS.items()},
            )
            episodes.append(replace(job, inputs=inputs if board.gets_detections else ""))
    report("sequences", len(manifest.sequences), len(manifest.sequences))
    about = {"suite": manifest.suite, "suite_version": manifest.suite_version}
    return _submission(name, place, about, episodes)


def submit_kitti(folder: Path | str, kitti: Path | str, *, name: str | None = None) -> Submission:
    """Score KITTI tracking results, `SEQ.txt`, against a folder of KITTI tracking data.

    Scores are by boxes in the image; where all results have 3-D boxes, by these and by centres too.
    """
    place, files = Path(folder), KittiFolder.find(kitti)
    _check_folder(place)
    sequences = files.sequences()
    _check_names(place, sequences)
    labels = {sequence: read_kitti_labels(files.labels(sequence)) for sequence in sequences}
    results = {
        sequence: read_kitti_labels(place / f"{sequence}.txt", results=True)
        for sequence in sequences
        if (place / f"{sequence}.txt").is_file()
    }
    all_in_space = all(bool(rows.has_3d_box.all()) for rows in results.values())
    similarities = list(SUFFIXES) if all_in_space else ["iou_2d"]
    categories = [
        category
        for category, kind in DETECTED_TYPES.items()
        if any((rows.types == kind).any() for rows in labels.values())
    ]
    episodes = []
    for category in categories:
        for number, sequence in enumerate(sequences):
            about = Recording(str(files.root), sequence, category.name.lower(), "", number)
            scores = None
            if sequence in results:
                rows = results[sequence]
                scores = kitti_result_scores(labels[sequence], rows, category, similarities)
            episodes.append(_of_recording(about, scores))
    return _submission(name, place, {"suite": KITTI}, episodes)


def submit_mot(folder: Path | str, mot: Path | str, *, name: str | None = None) -> Submission:
    """Score MOTChallenge results, `SEQ.txt`, against a folder of MOTChallenge data."""
    place = Path(folder)
    _check_folder(place)
    recordings = [r for r in recordings_of(mot_suite(mot)) if isinstance(r, MotRecording)]
    _check_names(place, [r.sequence for r in recordings])
    episodes = []
    for recording in recordings:
        path, scores = place / f"{recording.sequence}.txt", None
        if path.is_file():
            scores = score_mot_results(Path(recording.folder) / recording.sequence, path)
        episodes.append(_of_recording(recording, scores))
    return _submission(name, place, {"suite": MOT}, episodes)


def _submission(
    name: str | None, folder: Path, suite: Mapping[str, Any], episodes: Sequence[JobScores]
) -> Submission:
    entry = name or folder.resolve().name
    manifest = {**suite, "metric_version": METRIC_VERSION}
    return Submission(entry, manifest, tuple(replace(each, entry=entry) for each in episodes))


def _check_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise SubmitError(f"no folder {folder}")


def _check_names(folder: Path, sequences: Sequence[str], ending: str = ".txt") -> None:
    """Raise `SubmitError` for a folder without results, or with results of unknown sequences."""
    results = [path.name.removesuffix(ending) for path in visible(folder, f"*{ending}")]
    wrong = [name for name in results if name not in sequences]
    if not results or wrong:
        got = f"{wrong[0]}{ending}" if wrong else "none"
        names = [f"{name}{ending}" for name in sequences]
        shown = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
        raise SubmitError(f"{folder}: expected results {shown}; got {got}")


def _check_images(manifest: Manifest, exported: Path) -> None:
    """Raise `SubmitError` for a suite that was exported without images of the camera board."""
    from roadscope.envs.sensors.rigs import rig as rig_of

    if manifest.camera_every_s:
        return
    rig = rig_of(manifest.episode(manifest.sequences[0], exported).rig)
    reason = f"its rig, {rig.name}, has no camera"
    if rig.camera is not None:
        reason = f"roadscope {manifest.roadscope} exported it: export the suite again"
    raise SubmitError(f"{exported}: no images of the camera board; {reason}")


def _of_recording(recording: Recording, scores: Mapping[str, Score] | None) -> JobScores:
    file, conditions = f"{recording.sequence}.txt", {"sequence": recording.sequence}
    return _job_scores(recording.board, recording, scores, file=file, conditions=conditions)


def _job_scores(
    board: str,
    episode: Episode | Recording,
    scores: Mapping[str, Score] | None,
    *,
    file: Path | str,
    conditions: Mapping[str, str],
) -> JobScores:
    """Return the scores of an episode; they are None without the file of its results."""
    return JobScores(
        board,
        "",
        episode.scenario,
        episode.seed,
        episode.condition,
        "",
        scores or {},
        None if scores is not None else f"no result file {file}",
        conditions=conditions,
    )


class TrueSequence(NamedTuple):
    """The truth of a sequence of an exported suite, and what else scores need."""

    manifest: Manifest
    sequence: ExportedSequence
    episode: Episode
    truths: Sequence[Truth]
    view: SequenceView
    ego_from_lidar: Pose


def _true_sequence(manifest: Manifest, sequence: ExportedSequence, exported: Path) -> TrueSequence:
    """Compute the truth of a sequence again. Raise `SubmitError` if it differs from the export."""
    from roadscope.envs.sensors.rigs import rig as rig_of

    if not sequence.digest:
        raise SubmitError(
            f"{exported}: sequence {sequence.name} is not written: export the suite to its end"
        )
    episode = manifest.episode(sequence, exported)
    truths = [truth for _, truth in sensed(episode)]
    if truth_digest(truths) != sequence.digest:
        raise SubmitError(
            f"{exported}: sequence {sequence.name} has other traffic than this version of "
            f"roadscope makes; {manifest.roadscope} exported it: export the suite again"
        )
    rig = rig_of(episode.rig)
    view = SequenceView.of(rig, sensing_of(episode).calibration)
    return TrueSequence(manifest, sequence, episode, truths, view, rig.lidar.ego_from_lidar)


def _detection_scores(folder: Path, true: TrueSequence) -> dict[str, Score]:
    rows = _object_rows(folder, range(len(true.truths)))
    detections = _boxes(list(rows), list(rows.values()), true)
    answers = replace(
        EpisodeDetections.recorded(detections, true.truths),
        parked=parked_among(true.episode, true.truths),
    )
    rule = true.manifest.eligibility
    return {**detection_scores(answers, rule, timed=False), **detection_parts(answers, rule)}


def _tracking_scores(path: Path, true: TrueSequence) -> dict[str, Score]:
    tracks, parked = read_tracks(path, true), parked_among(true.episode, true.truths)
    pairings = true.manifest.eligibility.pairings(tracks, true.truths, parked)
    every = score_each_alpha(tracks, true.truths, pairings)
    return {name: score for name, score in every.items() if name not in NOT_IN_FILES}


def _odometry_scores(path: Path, true: TrueSequence) -> dict[str, Score]:
    arrived = [k for k in range(len(true.truths)) if k not in true.sequence.lost]
    stamps_s = np.array([truth.stamp_s for truth in true.truths])
    estimated = read_lidar_poses(path, stamps_s, arrived)
    driven = [true.truths[k].world_from_ego @ true.ego_from_lidar for k in arrived]
    both = Trajectories(*(np.array([p.matrix for p in poses]) for poses in (estimated, driven)))
    return {
        **score_odometry(both, lengths_m=true.manifest.odometry_lengths_m).named(),
        **score_standing(both, stamps_s[arrived]).named(),
        **by_distance(both),
    }


def _camera_scores(folder: Path, true: TrueSequence) -> dict[str, Score]:
    node = ImageNode(image_source(ORACLE), true.episode, true.manifest.camera_every_s)
    oracle: EpisodeImageDetections = node.read()
    return image_scores(read_image_results(folder, oracle), true.episode)


class ResultKind(NamedTuple):
    """Results that are scored on one board of an exported suite.

    name: of the board. score: returns the scores of the results at a path.
    ending: of the file of a sequence; empty: its results are a folder.
    gets_detections: whether the entry got detections, as trackers do.
    """

    name: str
    score: Callable[[Path, TrueSequence], Mapping[str, Score]]
    ending: str = ".txt"
    gets_detections: bool = False


RESULT_KINDS = (
    ResultKind(DetectionBoard.name, _detection_scores, ending=""),
    ResultKind(TrackingBoard.name, _tracking_scores, gets_detections=True),
    ResultKind(OdometryBoard.name, _odometry_scores),
    ResultKind(CameraBoard.name, _camera_scores, ending=""),
)


def read_image_results(folder: Path, oracle: EpisodeImageDetections) -> EpisodeImageDetections:
    """Read KITTI object results, a file for each image that is not lost, as detections in images.

    oracle: the true boxes, in whose place the results are returned.
    """
    detections = list(oracle.detections)
    numbers = {row: k for k, row in enumerate(oracle.rows.tolist()) if detections[k] is not None}
    rows = _object_rows(folder, list(numbers))
    normalized = _are_normalized(rows.values())
    for (path, own), k in zip(rows.items(), numbers.values(), strict=True):
        if not own.in_image.all():
            raise FormatError(f"{path}: expected boxes in the image, got a row without")
        scores = own.scores if normalized else logistic(own.scores)
        stamp_s = oracle.truths[k].stamp_s
        detections[k] = ImageDetections(own.boxes, _categories(own), scores, stamp_s)
    return replace(oracle, detections=tuple(detections))


def _object_rows(folder: Path, numbers: Sequence[int]) -> dict[Path, KittiObjects]:
    """Read the KITTI object results with these numbers, by their files."""
    names = [f"{number:06d}" for number in numbers]
    _check_names(folder, names)
    paths = [folder / f"{name}.txt" for name in names]
    rows = [read_kitti_object_results(p, n) for p, n in zip(paths, numbers, strict=True)]
    counted = [each.select(each.types != KittiType.DONT_CARE) for each in rows]
    return dict(zip(paths, counted, strict=True))


def read_tracks(path: Path, true: TrueSequence) -> list[Tracks]:
    """Read KITTI tracking results as tracks in the world, one record a frame."""
    count, rows = len(true.truths), read_kitti_labels(path, results=True)
    rows = rows.select(rows.types != KittiType.DONT_CARE)
    last = int(rows.frames.max(initial=-1))
    if last >= count:
        raise FormatError(f"{path}: expected frames 0 to {count - 1}, got {last}")
    if (rows.ids < 0).any():
        raise FormatError(f"{path}: expected ids from 0 on, got {int(rows.ids.min())}")
    frames = rows.by_frame(count)
    boxes = _boxes([path] * count, frames, true)
    return [Tracks.of(each, own.ids) for each, own in zip(boxes, frames, strict=True)]


def _boxes(
    paths: Sequence[Path], frames: Sequence[KittiObjects], true: TrueSequence
) -> list[Detections]:
    """Return the rows of each frame as detections in the world.

    If any score is outside 0 to 1, all scores are mapped by the logistic function.
    """
    normalized = _are_normalized(frames)
    detections = []
    for path, rows, truth in zip(paths, frames, true.truths, strict=True):
        if not rows.has_3d_box.all():
            raise FormatError(f"{path}: expected 3-D boxes in the camera frame, got a row without")
        boxes = detections_from_rows(
            rows, Category.CAR, stamp_s=truth.stamp_s, normalized=normalized
        )
        boxes = replace(boxes, categories=_categories(rows))
        detections.append(boxes.moved(true.view.turned(truth.world_from_ego), "world"))
    return detections


def _are_normalized(frames: Iterable[KittiObjects]) -> bool:
    """Return whether all scores are from 0 to 1 already."""
    return all(bool(((r.scores >= 0) & (r.scores <= 1)).all()) for r in frames)


def _categories(rows: KittiObjects) -> np.ndarray:
    return np.array([CATEGORY_OF[KittiType(kind)] for kind in rows.types], np.int8)


def read_lidar_poses(path: Path, stamps_s: np.ndarray, arrived: Sequence[int]) -> list[Pose]:
    """Read the pose of the LiDAR at each scan that arrived, from a KITTI or TUM file.

    stamps_s: (N,) of all scans. A file in KITTI's format has a line for each of these, or for each
    that arrived.
    """
    trajectory = read_any_trajectory(path)
    if trajectory.stamps_s is not None:
        poses = _poses_at(
            path, trajectory.poses, np.array(trajectory.stamps_s), stamps_s[list(arrived)]
        )
    elif len(trajectory.poses) == len(stamps_s):
        poses = [trajectory.poses[k] for k in arrived]
    elif len(trajectory.poses) == len(arrived):
        poses = list(trajectory.poses)
    else:
        raise FormatError(
            f"{path}: expected {len(stamps_s)} poses, one for each scan, got "
            f"{len(trajectory.poses)}"
        )
    x, y, z = np.abs((poses[0].inverse() @ poses[-1]).translation)
    if z > max(x, y, AHEAD_M):
        raise FormatError(
            f"{path}: expected poses of the LiDAR, x ahead; the z axis of these points ahead, as a "
            "camera's does"
        )
    return poses


def _poses_at(
    path: Path, poses: Sequence[Pose], stamps_s: np.ndarray, scans_s: np.ndarray
) -> list[Pose]:
    """Return for each scan, stamped scans_s, the pose whose stamp is nearest."""
    period_s = float(np.median(np.diff(scans_s))) if len(scans_s) > 1 else 0.1
    gaps_s = np.abs(stamps_s[:, None] - scans_s)
    missing = gaps_s.min(axis=0) > MOST_STAMP_GAP * period_s
    if missing.any():
        first_s = scans_s[missing][0]
        raise FormatError(f"{path}: expected a pose at each scan, got none at {first_s:.3f} s")
    return [poses[k] for k in gaps_s.argmin(axis=0).tolist()]
