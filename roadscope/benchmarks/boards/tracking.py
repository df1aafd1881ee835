"""The tracking board: trackers on the same detections."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import product
from typing import Annotated

from msgspec import Meta

from roadscope.benchmarks.boards.board import (
    CONDITIONS,
    Board,
    Breakdown,
    Column,
    JobOptions,
    Scores,
    SuiteCheck,
    call_cost,
    check_camera,
    check_inputs,
    episodes,
    input_checks,
    slow_calls_column,
    time_columns,
)
from roadscope.benchmarks.boards.detection import rule_in_words
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.graph import Job, Node
from roadscope.benchmarks.kinds import TRACKER, traits_of
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.matching import Pairing
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracking import score_each_alpha, score_tracks
from roadscope.benchmarks.metrics.tracking.scores import BY_ALPHA
from roadscope.benchmarks.nodes.fusions import detection_node
from roadscope.benchmarks.nodes.poses import PoseNode
from roadscope.benchmarks.nodes.tracks import TrackNode, is_offline
from roadscope.benchmarks.nodes.tuned import (
    THRESHOLDS,
    HotaNode,
    TunedNode,
    at_threshold,
    hota_nodes,
    is_tuned,
)
from roadscope.benchmarks.records import EpisodeDetections, EpisodeTracks
from roadscope.benchmarks.references import (
    UPPER_MARK,
    check_detection_source,
    check_ego,
    detection_source,
    missing_for_poses,
    pose_source,
)
from roadscope.benchmarks.suite import SPLITS, BoardSettings, Names, Suite
from roadscope.core import Spec, Tracks, Truth
from roadscope.core.spec import FUSED, NO_POSES, ORACLE, TRUE_POSES

OFFLINE = "offline"
"""Metric that is 1 for an offline tracker, which uses all frames of an episode."""
BY_DETECTOR = "detector"
"""The breakdown by the detector whose detections a tracker gets."""
NEES = Column(
    "nees_position",
    "NEES",
    2,
    "NEES: of positions, over its degrees of freedom; 1 when consistent, more when the tracks' "
    "covariances are too small.",
)
HEADING_ERRORS = (
    Column(
        "heading_rmse_deg",
        "head. deg",
        1,
        "head.: RMSE of matched headings; of objects that stand, modulo half a turn.",
    ),
    Column(
        "heading_reversed",
        "rev.",
        3,
        "rev.: share of matches with moving objects (from 1 m/s) whose heading is reversed.",
    ),
)
ALPHA_BREAKDOWN = Breakdown(
    BY_ALPHA,
    note="A pair is a hit where its similarity reaches alpha; HOTA is the mean over alphas.",
)
ALPHA_METRICS = (Column("det_a", "DetA"), Column("ass_a", "AssA"), Column("loc_a", "LocA"))
"""The metrics that are shown at each alpha."""

PoseSource = Annotated[str, Meta(min_length=1)]


class TrackingSettings(BoardSettings, frozen=True, kw_only=True):
    """The table `[tracking]`.

    detectors: all trackers get the detections of each; `oracle` stands for the true boxes of all
        eligible objects.
    ego: where trackers get the poses of the ego from, one text or several: `truth`, `none` or an
        odometry. Every tracker is run with each, unless its spec names one (`gnn?ego=none`).
    """

    detectors: Names = ()
    ego: PoseSource | Annotated[tuple[PoseSource, ...], Meta(min_length=1)] = TRUE_POSES

    @property
    def egos(self) -> Names:
        """`ego` as several texts."""
        return (self.ego,) if isinstance(self.ego, str) else self.ego


class TrackingBoard(Board):
    """Ranks trackers by HOTA."""

    name = "tracking"
    kind = TRACKER
    settings_type = TrackingSettings
    headline = "hota"
    columns = (
        Column("hota", "HOTA", 2, "HOTA, MOTA, IDF1: centres from above, gate 2 m."),
        Column("mota", "MOTA", 2),
        Column("idf1", "IDF1", 2),
        *time_columns(2, "frame"),
        Column("id_switches", "ID sw.", 1, "ID sw.: identity switches per episode."),
        Column(
            "wrong_associations",
            "wrong assoc",
            1,
            "wrong assoc: times in an episode that a track goes over to another object.",
        ),
        Column(
            "kept_through_occlusion",
            "kept hidden",
            2,
            "kept hidden: share of objects with the same track after an occlusion.",
        ),
        Column("velocity_rmse_m_s", "vel. m/s", 2, "vel.: RMSE of matched velocities."),
        Column("motp_m", "MOTP m", 2),
        Column("fragmentations", "frag.", 1, "frag.: fragmentations per episode."),
        slow_calls_column(2),
        Column("ass_a", "AssA", 2),
        Column("det_a", "DetA", 2),
        Column("samota", "sAMOTA", 2, "sAMOTA: as AB3DMOT defines it."),
        Column("gospa_m", "GOSPA m", 2, "GOSPA: order 1, cut-off 2 m, per frame."),
        Column(
            "inside_state", "in 95 %", 2, "in 95 %: objects within their tracks' 95 % ellipses."
        ),
        *HEADING_ERRORS,
        NEES,
        Column(
            "nees_in_band",
            "in band",
            2,
            "in band: share of episodes whose NEES lies in its 95 % band.",
        ),
        Column(
            "amota_nuscenes",
            "AMOTA nuSc.",
            2,
            "nuSc.: as nuScenes defines them; AMOTP in metres, 2 where a recall is not reached.",
        ),
        Column("amotp_nuscenes_m", "AMOTP nuSc.", 2),
    )
    breakdowns = (
        *(Breakdown(by) for by in CONDITIONS),
        Breakdown(BY_DETECTOR, note="In brackets: the rank on these detections."),
        ALPHA_BREAKDOWN,
    )
    by_condition = ("hota", "mota", "idf1")
    shown_parts = (Column("hota", "HOTA"), *ALPHA_METRICS)
    detections_field = "detectors"
    inputs_name = BY_DETECTOR
    object_metric = "mota"
    over_time = ("hota", "mota", "idf1", "id_switches")

    def check_entry(self, spec: Spec) -> Spec:
        """Return a tracker's resolved spec, with the odometry that gives it the ego's poses."""
        resolved = check_tuned(spec, super().check_entry)
        if spec.ego is not None:
            check_ego(spec.ego)
        return resolved

    def suite_checks(self, suite: Suite) -> list[SuiteCheck]:
        """Return the checks of odometries that give trackers poses, and of detectors."""
        settings = suite.settings(self.name, TrackingSettings)

        def check_detector(text: str) -> None:
            if check_detection_source(text).kind == FUSED:
                check_camera(suite)

        inputs = {"tracking.detectors": settings.detectors} if settings.entries else {}
        return [
            *input_checks(suite, inputs),
            *(SuiteCheck("tracking.ego", check_ego, ego) for ego in settings.egos),
            *(SuiteCheck("tracking.detectors", check_detector, s) for s in settings.detectors),
        ]

    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return every tracker on the detections of every detector; those on the oracle are marks.

        If the oracle is the only detector, trackers are ranked on it.
        """
        settings, rule = suite.settings(self.name, TrackingSettings), suite.eligibility
        if entries:
            check_inputs(suite, "tracking.detectors", settings.detectors)
        sources = {name: detection_source(name) for name in settings.detectors}
        alone = settings.detectors == (ORACLE,)
        trackers = with_each_ego(entries, settings.egos)
        missing = {tracker: missing_requirement(tracker) for tracker in trackers}
        tuned = {
            (tracker, detector): _training(tracker, source, suite)
            for tracker in filter(is_tuned, trackers)
            for detector, source in sources.items()
        }
        jobs = []
        for episode, (detector, source), tracker in product(
            episodes(suite), sources.items(), trackers
        ):
            is_mark = detector == ORACLE and not alone
            node = track_node(tracker, source, episode, rule)
            candidates = hota_nodes(node, rule) if is_tuned(tracker) else ()
            tracks = tuple(each.tracks for each in candidates)
            jobs.append(
                Job(
                    self,
                    f"{tracker} on {detector}" if is_mark else str(tracker),
                    episode,
                    TunedNode(tracks, tuned[tracker, detector]) if tracks else node,
                    mark=UPPER_MARK if is_mark else None,
                    inputs=detector,
                    settings=rule,
                    missing=missing[tracker],
                )
            )
        return jobs

    def score(self, job: Job, answers: EpisodeTracks, options: RunOptions) -> Scores:
        """Return the scores of a job's answers."""
        assert isinstance(job.answers, TrackNode | TunedNode)
        inputs: EpisodeDetections = job.answers.detections.read(options)
        pairings = job.settings.pairings(answers.tracks, inputs.truths, inputs.parked)
        scores = score_each_alpha(answers.tracks, inputs.truths, pairings)
        scores |= call_cost(answers.times)
        if is_offline(job.answers.tracker):
            scores |= offline_score(len(answers.tracks))
        return scores

    def box_scores(
        self, boxes: Sequence[Tracks], truths: Sequence[Truth], pairings: Sequence[Pairing]
    ) -> Scores:
        """Return the scores of tracks."""
        return score_tracks(boxes, truths, pairings).named()

    def explanation(self, suite: Suite) -> str:
        """Return as text which objects are eligible, and which detections trackers get."""
        text = rule_in_words(suite.eligibility)
        detectors = suite.settings(self.name, TrackingSettings).detectors
        if not detectors:
            return text
        first, *others = [d for d in detectors if d != ORACLE] or [ORACLE]
        text += f" Trackers get the detections of {', of '.join([first, *others])}"
        text += "; figures are of all of these together" if others else ""
        has_oracle = ORACLE in detectors and first != ORACLE
        return text + (", 'on oracle' the true boxes." if has_oracle else ".")


def with_each_ego(trackers: Iterable[Spec], egos: Sequence[str]) -> list[Spec]:
    """Return every tracker with each source of the ego's poses, or with the one that it names.

    `gnn` and `gnn?ego=truth` are one entry, `gnn`: the true poses are the default.
    """
    specs = (
        tracker.plain if ego == TRUE_POSES else tracker.with_ego(ego)
        for tracker in trackers
        for ego in (egos if tracker.ego is None else [str(tracker.ego)])
    )
    return list(dict.fromkeys(specs))


def check_tuned(spec: Spec, check_entry: Callable[[Spec], Spec]) -> Spec:
    """Return an entry's resolved spec; `tuned` is checked with a threshold in its place."""
    if not is_tuned(spec):
        return check_entry(spec)
    resolved = check_entry(at_threshold(spec, THRESHOLDS[0]))
    arguments = {**resolved.arguments, **spec.arguments}
    return replace(spec, arguments=arguments, kind=resolved.kind, target=resolved.target)


Training = tuple[tuple[HotaNode, ...], ...]
"""HOTA of each episode at each threshold."""


def _training(tracker: Spec, source: Spec, suite: Suite) -> Training:
    """Return HOTA on train seeds, by which the threshold of a tracker is chosen.

    There are as many of them as the suite has seeds, and none is a seed of the suite.
    """
    unranked = [seed for seed in SPLITS["train"] if seed not in suite.seeds]
    train = replace(suite, seeds=tuple(unranked[: len(suite.seeds)]))
    rule = suite.eligibility
    return tuple(
        hota_nodes(track_node(tracker, source, episode, rule), rule) for episode in episodes(train)
    )


def track_node(tracker: Spec, source: Spec, episode: Episode, rule: Eligibility) -> TrackNode:
    """Return the node of a tracker on the detections of a `references.detection_source`."""
    detections: Node = detection_node(source, episode, rule)
    if tracker.ego is None:
        return TrackNode(tracker, detections)
    if str(tracker.ego) == NO_POSES:
        return TrackNode(tracker, detections, posed=False)
    return TrackNode(tracker, detections, ego=PoseNode(pose_source(tracker.ego), episode))


def missing_requirement(tracker: Spec) -> str:
    """Return what a tracker or its odometry needs and is not installed; empty if nothing."""
    if missing := traits_of(at_threshold(tracker, THRESHOLDS[0])).requires:
        return missing
    if tracker.ego is None or str(tracker.ego) in (TRUE_POSES, NO_POSES):
        return ""
    return missing_for_poses(pose_source(tracker.ego))


def tracking_scores(
    answers: EpisodeTracks, inputs: EpisodeDetections, rule: Eligibility
) -> dict[str, Score]:
    """Return a tracker's scores on an episode, and the times of its calls."""
    pairings = rule.pairings(answers.tracks, inputs.truths, inputs.parked)
    scores = score_tracks(answers.tracks, inputs.truths, pairings).named()
    return scores | call_cost(answers.times)


def offline_score(frames: int, offline: bool = True) -> dict[str, Score]:
    """Return the metric `offline`: 1 for a tracker that uses all frames of an episode, else 0."""
    return {OFFLINE: Score(float(offline), "1", "lower", frames)}
