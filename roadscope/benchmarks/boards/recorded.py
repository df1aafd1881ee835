"""The boards of recorded data: trackers on KITTI's and MOTChallenge's sequences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from roadscope.benchmarks.boards.board import (
    NO_RECORDED_REPLAY,
    Board,
    Breakdown,
    Column,
    Condition,
    JobOptions,
    Scores,
    call_cost,
    slow_calls_column,
    time_columns,
)
from roadscope.benchmarks.boards.tracking import (
    ALPHA_BREAKDOWN,
    ALPHA_METRICS,
    HEADING_ERRORS,
    NEES,
    OFFLINE,
    TrackingBoard,
    check_tuned,
    missing_requirement,
    offline_score,
    with_each_ego,
)
from roadscope.benchmarks.fingerprints import code_hash
from roadscope.benchmarks.formats.kitti_sequence import DETECTOR_PREFIX
from roadscope.benchmarks.graph import Job, Node
from roadscope.benchmarks.kinds import TRACKER
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.nodes.tracks import TrackNode, is_offline, scores_tentative_tracks
from roadscope.benchmarks.nodes.tuned import (
    THRESHOLDS,
    TunedNode,
    at_threshold,
    hota_nodes,
    is_tuned,
)
from roadscope.benchmarks.recorded.combined import COMBINED, NEES_BAND
from roadscope.benchmarks.recorded.recording import (
    KITTI_CLASSES,
    MOT_CLASSES,
    RecordedSettings,
    Recording,
    SequenceSettings,
)
from roadscope.benchmarks.recorded.suite import DataFolder, kitti_tracking_settings
from roadscope.benchmarks.records import EpisodeDetections, EpisodeTracks
from roadscope.benchmarks.suite import Suite
from roadscope.core import Spec, SpecError
from roadscope.core.spec import NO_POSES, TRUE_POSES

SEQUENCES: Mapping[str, Condition] = {"sequence": lambda recording: recording.sequence}
"""By what recordings are broken down."""
SUMS_NOTE = "Counts: sums over the sequences."
SAMOTA_NOTE = (
    "sAMOTA: mean of sequences; tentative tracks count if the tracker scores them (weighed = True)."
)
SEQUENCES_NOTE = (
    "A sequence without a labelled object of the class has no figures but false alarms, which "
    "count in HOTA, MOTA and IDF1 of all sequences."
)
NEES_BAND_NOTE = (
    "NEES over its degrees of freedom; in brackets the 95 % band of a consistent tracker, where "
    "all errors of an object count as one value; all: all sequences."
)


@dataclass(frozen=True)
class RecordedNode(Node):
    """The detections of a recording, which are read from its own files for every use."""

    recording: Recording

    stage = "reading"
    folder = "recorded"
    record = EpisodeDetections
    recomputed_if_fresh = False

    def content(self) -> Mapping[str, Any]:
        """Return what the detections depend on."""
        return {"episode": self.recording.spec(), "code": code_hash(__name__)}

    def compute(self, options: RunOptions) -> EpisodeDetections:
        """Read the recording."""
        return self.recording.replayed()

    def read(
        self, options: RunOptions | None = None, *, recompute: bool = False
    ) -> EpisodeDetections:
        """Read the recording; nothing is written to the cache."""
        return self.recording.replayed()


def _track_nodes(tracker: Spec, recordings: Sequence[Recording]) -> Sequence[TrackNode | TunedNode]:
    """Return the tracks of a tracker on each recording.

    If its spec has `tuned`, the threshold is chosen on all other videos with the same detector.
    """
    chosen = at_threshold(tracker, THRESHOLDS[0])
    nodes = [
        TrackNode(
            tracker,
            RecordedNode(recording),
            posed=tracker.ego is None,
            tentative=scores_tentative_tracks(chosen),
        )
        for recording in recordings
    ]
    if not is_tuned(tracker):
        return nodes
    scored = list(map(hota_nodes, nodes, recordings))
    return [
        TunedNode(
            tuple(each.tracks for each in own),
            tuple(
                other
                for other, another in zip(scored, recordings, strict=True)
                if another.detector == recording.detector and another.video != recording.video
            ),
        )
        for own, recording in zip(scored, recordings, strict=True)
    ]


def _missing_training(node: TrackNode | TunedNode) -> str:
    """Return what a tracker with `tuned` lacks where there is one sequence; empty if nothing."""
    if isinstance(node, TrackNode) or node.training:
        return ""
    return "a threshold is chosen on other sequences, and there is only one"


def _image_columns(data: str) -> tuple[Column, ...]:
    """Return the first columns of a board, scores of image boxes. data: whose rules are used."""
    note = f"HOTA, MOTA, IDF1: image boxes, all sequences as one ({data})."
    return (
        Column("hota", "HOTA", 3, note),
        Column(OFFLINE, "pass", 0, "pass: online, or offline with all frames at hand."),
        Column("mota", "MOTA", 3),
        Column("idf1", "IDF1", 3),
        *time_columns(2, "frame"),
    )


class RecordedBoard(Board):
    """Ranks trackers on one class of recorded objects by HOTA of image boxes."""

    kind = TRACKER
    settings_type = RecordedSettings
    headline = "hota"
    conditions = SEQUENCES
    summed = ("id_switches", "wrong_associations", "fragmentations")
    object_metric = "mota"
    sample = "sequences"
    without_replay = NO_RECORDED_REPLAY
    simulated_board = compared_with = TrackingBoard.name

    def __init__(self, name: str) -> None:
        """Take the board's name, `kitti car` or the like."""
        self.name = name

    def check_entry(self, spec: Spec) -> Spec:
        """Return a tracker's resolved spec; recordings have no scans for an odometry."""
        resolved = check_tuned(spec, super().check_entry)
        if spec.ego is not None and str(spec.ego) not in (TRUE_POSES, NO_POSES):
            raise SpecError(f"'{spec}': recorded detections come without scans for an odometry")
        return resolved

    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return every tracker on every recording.

        Names of entries contain the detector, unless it is the first one of the suite.
        """
        settings = suite.settings(self.name, RecordedSettings)
        first = settings.detectors[0]
        recordings = [each for each in settings.recordings if each.board == self.name]
        nodes = {
            tracker: _track_nodes(tracker, recordings)
            for tracker in with_each_ego(entries, (TRUE_POSES,))
        }
        jobs = []
        for row, recording in enumerate(recordings):
            on_detector = "" if recording.detector == first else f" on {recording.detector}"
            for tracker, of_recordings in nodes.items():
                node = of_recordings[row]
                missing = missing_requirement(tracker) or _missing_training(node)
                jobs.append(Job(self, f"{tracker}{on_detector}", recording, node, missing=missing))
        return jobs

    def score(self, job: Job, answers: EpisodeTracks, options: RunOptions) -> Scores:
        """Return the scores of a job's answers, times of calls, and `offline`."""
        assert isinstance(job.answers, TrackNode | TunedNode)
        assert isinstance(job.episode, Recording)
        offline = is_offline(job.answers.tracker)
        return {
            **job.episode.scores(answers.tracks),
            **offline_score(len(answers.tracks), offline),
            **call_cost(answers.times),
        }

    def pooled(self, metric: str, scores: Sequence[Scores]) -> list[Score]:
        """Return scores that pool to the figure of all sequences taken as one."""
        if metric in COMBINED and scores:
            return COMBINED[metric](scores, metric)
        return super().pooled(metric, scores)

    def explanation(self, suite: Suite) -> str:
        """Return as text which detections are tracked, and in which sequences."""
        settings = suite.settings(self.name, RecordedSettings)
        sequences = len(dict.fromkeys(r.sequence for r in settings.recordings))
        first, *others = settings.detectors
        on_others = f"; entries 'on' another detector get its own: {', '.join(others)}"
        return (
            f"{sequences} of {settings.labelled} labelled sequences have detections. Trackers get "
            f"those of {first}{on_others if others else ''}. {settings.remark}"
        ).rstrip()


class KittiBoard(RecordedBoard):
    """Ranks trackers on one class of KITTI's objects."""

    kitti_markers = ((f"{DETECTOR_PREFIX}*",),)
    comparison_note = (
        "How these ranks agree with those on simulated traffic is shown once that was run too: "
        f"roadscope leaderboard {TrackingBoard.name} --suite {TrackingBoard.name}, with "
        "the same --out if any."
    )
    columns = (
        *_image_columns("KITTI"),
        Column("id_switches", "ID sw.", 0, SUMS_NOTE),
        Column("hota_3d", "HOTA 3-D", 3, "3-D: IoU in space, from 0.25."),
        Column("ass_a", "AssA", 3),
        Column("det_a", "DetA", 3),
        Column("samota_3d", "sAMOTA 3-D", 3, SAMOTA_NOTE),
        NEES,
        Column(
            "nees_in_band",
            "in band",
            2,
            "in band: share of sequences whose NEES lies in its 95 % band.",
        ),
        Column("hota_centre", "HOTA centre", 3, "centre: from above, gate 2 m."),
        Column("position_rmse_m", "pos. m", 2, "pos.: RMSE of centres that match."),
        Column("fragmentations", "frag.", 0, SUMS_NOTE),
        Column("mota_3d", "MOTA 3-D", 3),
        slow_calls_column(2),
        *HEADING_ERRORS,
        Column("wrong_associations", "wrong assoc", 0, SUMS_NOTE),
    )
    breakdowns = (ALPHA_BREAKDOWN, Breakdown("sequence", note=f"{SEQUENCES_NOTE} {NEES_BAND_NOTE}"))
    by_condition = ("hota", "mota", "idf1", "hota_3d", "false_alarms", "nees_position", *NEES_BAND)
    shown_parts = (
        Column("hota", "HOTA"),
        Column("hota_3d", "HOTA of 3-D boxes"),
        Column("mota", "MOTA"),
        Column("idf1", "IDF1"),
        Column("false_alarms", "false alarms"),
        Column("nees_position", "NEES (its 95 % band)"),
        *ALPHA_METRICS,
    )

    def kitti_settings(self, place: DataFolder) -> Mapping[str, SequenceSettings]:
        """Return the settings of the boards of all classes that are labelled."""
        return kitti_tracking_settings(place)


class MotBoard(RecordedBoard):
    """Ranks trackers on MOTChallenge's people."""

    columns = (
        *_image_columns("MOT"),
        Column("id_switches", "ID sw.", 0, SUMS_NOTE),
        Column("samota", "sAMOTA", 3, SAMOTA_NOTE),
        Column("ass_a", "AssA", 3),
        Column("det_a", "DetA", 3),
        Column("fragmentations", "frag.", 0, SUMS_NOTE),
        slow_calls_column(2),
    )
    breakdowns = (ALPHA_BREAKDOWN, Breakdown("sequence", note=SEQUENCES_NOTE))
    by_condition = ("hota", "mota", "idf1", "false_alarms")
    shown_parts = (
        Column("hota", "HOTA"),
        Column("mota", "MOTA"),
        Column("idf1", "IDF1"),
        Column("false_alarms", "false alarms"),
        *ALPHA_METRICS,
    )


KITTI_BOARDS = tuple(KittiBoard(f"kitti {name}") for name in KITTI_CLASSES)
MOT_BOARDS = tuple(MotBoard(f"mot {name}") for name in MOT_CLASSES)
