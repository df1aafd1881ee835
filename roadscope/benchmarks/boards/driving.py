"""The driving board: drivers with perception stacks, in a closed loop with traffic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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
)
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.kinds import DETECTOR, DRIVER, KINDS, check_plugin_spec, traits_of
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.detection import GATE_M, count_scores
from roadscope.benchmarks.metrics.driving import ScoredDrive, score_drive
from roadscope.benchmarks.metrics.matching import match_all
from roadscope.benchmarks.metrics.tracking import score_tracks
from roadscope.benchmarks.nodes.drives import DriveNode, EpisodeDrive, Stack, duration_of
from roadscope.benchmarks.references import LOWER_MARK, UPPER_MARK, check_detection_source
from roadscope.benchmarks.suite import BoardSettings, Names, Suite
from roadscope.core import Spec, SpecError
from roadscope.core.spec import FUSED
from roadscope.driving.perception import BLIND, TRUTH, parts_of
from roadscope.envs.traffic.driven import check_driven

BY_STACK = "stack"
"""The breakdown by the perception stack that a driver gets."""
DETECTED = ("detection_rate", "false_alarms_per_frame")
TRACKED = ("recall", "precision", "hota", "velocity_rmse_m_s")
"""Metrics of the detections in a stack, and of the tracks that a driver gets."""


class DrivingSettings(BoardSettings, frozen=True, kw_only=True):
    """The table `[driving]`.

    stacks: perception stacks, `DETECTOR + TRACKER [+ N ms]`; every driver drives with each.
    """

    stacks: Names = ()


class DrivingBoard(Board):
    """Ranks drivers with perception stacks by reward, in traffic that reacts to them."""

    name = "driving"
    kind = DRIVER
    settings_type = DrivingSettings
    headline = "reward"
    columns = (
        Column(
            "reward", "reward", 3, "reward: mean of speed over desired speed, 0 after a collision."
        ),
        Column("collided", "collided", 2, "collided: share of drives that end in a collision."),
        Column(
            "call_p50_ms", "ms p50", 1, "ms p50: median processor time of the stack for a scan."
        ),
        Column("collisions", "coll./h", 1, "/h: events in an hour of driving."),
        Column("near_misses", "near/h", 0, "near: less than 1 s to a collision."),
        Column(
            "hard_braking",
            "hard/h",
            0,
            "hard: braking harder than 3 m/s2; phantom: without reason.",
        ),
        Column("phantom_braking", "phantom/h", 0),
        Column("progress", "progress", 2, "progress: distance over that at desired speed."),
        Column("comfort_m_s2", "acc. m/s2", 2, "acc.: RMS of the acceleration."),
        Column("least_ttc_s", "TTC s", 2, "TTC: shortest time to a collision, mean of the drives."),
        Column("detection_rate", "detected", 2, "detected, false: of the detections in the stack."),
        Column("false_alarms_per_frame", "false per frame", 2),
        Column(
            "recall", "recall", 2, "recall, prec., HOTA, vel.: of the tracks that the driver gets."
        ),
        Column("precision", "prec.", 2),
        Column("hota", "HOTA", 2),
        Column("velocity_rmse_m_s", "vel. m/s", 2),
        Column("driver_p50_ms", "driver ms", 2, "driver ms: of the driver's own call."),
        Column("wall_p50_ms", "wall ms", 1, "wall: median time of the stack on the clock."),
    )
    breakdowns = (
        *(Breakdown(by) for by in CONDITIONS),
        Breakdown(BY_STACK, note="In brackets: the rank with this stack."),
    )
    by_condition = (
        "reward",
        "collided",
        "collisions",
        "near_misses",
        "hard_braking",
        "phantom_braking",
        "recall",
    )
    shown_parts = (
        Column("reward", "reward"),
        Column("collided", "share of drives that collide"),
        Column("phantom_braking", "phantom braking per hour"),
    )
    detections_field = "stacks"
    inputs_name = BY_STACK
    marks_notes: Mapping[str, str] = {
        f"on {TRUTH}": "with all road users as they are",
        f"on {BLIND}": "with none",
    }
    predictors = (*DETECTED, *TRACKED)
    predicted = ("reward", "collided", "phantom_braking")
    default_suite = "driving"
    unviewable = (
        "a drive, which no view shows; its worst moments are in the page of roadscope report"
    )
    takes_scripted = False

    def suite_checks(self, suite: Suite) -> list[SuiteCheck]:
        """Return the checks of scenarios and stacks."""
        settings = suite.settings(self.name, DrivingSettings)

        def check(text: str) -> None:
            check_stack(text, suite)

        if not settings.stacks:
            # Otherwise nobody drives in this suite.
            return input_checks(suite, {"driving.stacks": ()} if settings.entries else {})
        return [
            *(SuiteCheck("scenarios", check_driven, name) for name in suite.scenarios),
            *(SuiteCheck("driving.stacks", check, text) for text in settings.stacks),
        ]

    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return every driver with every stack on all episodes; truth and blind are marks."""
        settings = suite.settings(self.name, DrivingSettings)
        check_inputs(suite, "driving.stacks", settings.stacks)
        marks = {TRUTH: UPPER_MARK, BLIND: LOWER_MARK}
        named = [text for text in settings.stacks if text not in marks]
        if len(named) == 0:
            marks, named = {}, list(settings.stacks)
        texts = [*named, *(marks if options.marks else ())]
        stacks = {text: Stack(text) for text in texts}
        missing = {text: stack.missing() for text, stack in stacks.items()}
        return [
            Job(
                self,
                f"{driver} on {text}",
                episode,
                DriveNode(driver, stack, episode if stack.senses else _unsensed(episode)),
                mark=marks.get(text),
                inputs=text,
                settings=suite.eligibility,
                missing=missing[text] or traits_of(driver).requires,
            )
            for episode in episodes(suite)
            for text, stack in stacks.items()
            for driver in entries
        ]

    def score(self, job: Job, answers: EpisodeDrive, options: RunOptions) -> Scores:
        """Return the scores of a drive, of its detections, and of the tracks of the driver."""
        assert isinstance(job.episode, Episode)
        scores = score_drive(drive_of(answers, duration_of(job.episode))).named()
        scores["driver_p50_ms"] = call_cost(answers.driver_times, (50,))["call_p50_ms"]
        if answers.sensed:
            scores |= call_cost(answers.perception_times, (50,))
            truths, parked = answers.sensed, answers.parked
            pairings = job.settings.pairings(answers.detected, truths, parked)
            detected = count_scores(match_all(pairings, GATE_M))
            pairings = job.settings.pairings(answers.believed, truths, parked)
            tracked = score_tracks(answers.believed, truths, pairings).named()
            scores |= {name: detected[name] for name in DETECTED}
            scores |= {name: tracked[name] for name in TRACKED}
        return scores

    def explanation(self, suite: Suite) -> str:
        """Return as text what drivers get, and when a drive ends."""
        return (
            "Drivers get the tracks of a perception stack ten times a second and drive among "
            "traffic that reacts to them, until the time is up or they collide. Of themselves and "
            "of the road they know the truth."
        )


def check_stack(text: str, suite: Suite) -> None:
    """Raise `SpecError` for a text that is no stack, or one that a suite's rig cannot serve."""
    stack = Stack(text)
    for spec in stack.plugins():
        if spec.kind == DETECTOR.name:
            check_detection_source(spec)
        else:
            check_plugin_spec(spec, KINDS[spec.kind])
        if traits_of(spec).offline:
            raise SpecError(f"'{spec}' needs the whole episode, so nobody can drive with it")
    if stack.senses and parts_of(text).detector.name == FUSED:
        check_camera(suite)


def drive_of(answers: EpisodeDrive, planned_s: float) -> ScoredDrive:
    """Return what the scores of a drive are made of. planned_s: how long it should last."""
    return ScoredDrive(
        stamps_s=answers.stamps_s,
        speeds=answers.speeds,
        accelerations=answers.accelerations,
        reference_accelerations=answers.reference_accelerations,
        ego=answers.poses[:, 0],
        others=answers.poses[:, 1:],
        velocities=answers.velocities,
        sizes=answers.sizes[:, :2],
        end_s=answers.end_s,
        desired_speed_m_s=answers.desired_speed_m_s,
        planned_s=planned_s,
        collided=answers.collided_with >= 0,
    )


def _unsensed(episode: Episode) -> Episode:
    """Return the episode without what only sensors feel, so that one drive serves all faults."""
    return Episode(episode.scenario, episode.seed, episode.rig, episode.duration_s)
