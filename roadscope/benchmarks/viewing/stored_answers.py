"""Reads the stored answers of one episode of a leaderboard run: truth, tracks, detections, poses.

No plug-in runs again. The results database says what each score was computed from, and so which
files in the cache folder have the answers.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.cache import cache_dir, read_kept
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.fingerprints import fingerprint
from roadscope.benchmarks.nodes.detections import DetectionNode
from roadscope.benchmarks.nodes.fusions import FusionNode
from roadscope.benchmarks.nodes.images import ImageNode
from roadscope.benchmarks.nodes.poses import PoseNode
from roadscope.benchmarks.nodes.tracks import TrackNode
from roadscope.benchmarks.nodes.traffic import TrafficNode
from roadscope.benchmarks.records import (
    EpisodeDetections,
    EpisodeFusions,
    EpisodeImageDetections,
    EpisodePoses,
    EpisodeTracks,
    without_sources,
)
from roadscope.benchmarks.report.page import read_runs
from roadscope.benchmarks.results import JobScores, Results
from roadscope.benchmarks.run import DATABASE
from roadscope.benchmarks.store import Store
from roadscope.benchmarks.suite_files import SUITES, load_suite
from roadscope.benchmarks.viewing.curves import boards_over_time, running_scores
from roadscope.benchmarks.viewing.view import EpisodeView
from roadscope.core import RecordError, Truth
from roadscope.envs.traffic.timeline import Timeline

STORED_NODES = (TrackNode, DetectionNode, FusionNode, ImageNode, PoseNode)
"""Nodes whose answers are shown, one for each folder of files. Other nodes that write to one of
these folders use the same record."""
MOST_NAMED = 8
"""Most possible values that an error names."""

R = TypeVar("R")


class StoredAnswersError(ValueError):
    """No answer of an episode is stored, or there is no such episode."""


@dataclass(frozen=True, slots=True)
class EpisodeChoice:
    """Which episode of a run is shown; None: any.

    condition: weather, light and faults as boards show them. inputs: the detector whose detections
    a tracker got.
    """

    board: str | None = None
    entry: str | None = None
    scenario: str | None = None
    seed: int | None = None
    condition: str | None = None
    inputs: str | None = None

    @property
    def named(self) -> dict[str, str | int]:
        """What is not any."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def allows(self, job: JobScores) -> bool:
        """Return whether a job is such an episode."""
        return all(value == getattr(job, name) for name, value in self.named.items())


def view_of_results(folder: Path | str, choice: EpisodeChoice) -> EpisodeView:
    """Return the first episode that is chosen, of the best entry that has one.

    folder: of `roadscope leaderboard --out`. Returns and images are made again, if the code and the
    rig are those of the run. `StoredAnswersError` if there is no such episode, or no answer is
    stored; `FolderError` for a folder without results.
    """
    place = Path(folder)
    results, job = _chosen([run.results for run in read_runs(place)], choice)
    if why := board_named(job.board).unviewable:
        raise StoredAnswersError(f"{_named(job)} is {why}")
    spec = _score_spec(place, job)
    content = spec["answers"]
    if isinstance(content.get("parts"), list):
        raise StoredAnswersError(
            f"{_named(job)} is scored on all drives together, which no view shows; choose another "
            "board with --board"
        )
    parts = list(_parts("answers", content))
    answers = [answer for _, part in parts for answer in _stored_answers(part)]
    if not answers:
        raise StoredAnswersError(
            f"no answer of {_named(job)} is stored in {cache_dir()}: it was removed, or the run "
            "used another cache folder (ROADSCOPE_CACHE); run the leaderboard again"
        )
    detections, tracks = _first(answers, EpisodeDetections), _first(answers, EpisodeTracks)
    fusions, poses = _first(answers, EpisodeFusions), _first(answers, EpisodePoses)
    episode_spec = next((part for name, part in parts if name == "episode"), {})
    episode = _episode(episode_spec, job, results)
    truths: Sequence[Truth] = () if detections is None else detections.truths
    if not truths and episode is not None:
        truths = [without_sources(truth) for _, truth in sensed(episode)]
    boxes = () if detections is None else detections.detections
    if fusions is not None:
        boxes = tuple(each.detections() for each in fusions.fused)
    rule = _rule(spec["settings"])
    scored = detections if board_named(job.board).over_time and rule is not None else None
    view = EpisodeView(
        title=_named(job),
        episode=episode,
        timeline=_timeline(episode_spec),
        truths=truths,
        detections=boxes,
        tracks=() if tracks is None else tracks.tracks,
        poses=poses,
        images=_first(answers, EpisodeImageDetections),
        scores={job.board: job.scores},
        curves=running_scores(
            rule or Eligibility(), scored, () if tracks is None else tracks.tracks, poses
        ),
    )
    return replace(view, notes=list(_notes(view, job.board, episode_spec, rule)))


def _notes(
    view: EpisodeView, board: str, episode_spec: Mapping[str, Any], rule: Eligibility | None
) -> Iterator[str]:
    """Yield what is not shown, and why."""
    recorded = bool(episode_spec) and "seed" not in episode_spec
    if recorded:
        reason = "the cache has no recorded data"
    elif not episode_spec:
        reason = "the results do not say which episode it was"
    else:
        reason = "they cannot be made again, as code or rig has changed"
    missing = ["sensor data"] if view.episode is None else []
    missing += [] if view.truths else ["true boxes"]
    if missing:
        yield f"No {' and '.join(missing)}: {reason}."
    if view.episode is None and view.poses is not None:
        yield "Path and pose of the odometry are of the LiDAR: its mounting is not known."
    if view.tracks and not view.detections:
        removed = f"their file is not in {cache_dir()} any more"
        yield f"No detections: {removed if episode_spec and not recorded else reason}."
    if view.tracks or view.detections or view.images:
        if recorded:
            yield "No scores over time: recorded data have rules of their own."
        elif not board_named(board).over_time:
            possible = " and ".join(each.name for each in boards_over_time())
            yield f"No scores over time: they are for {possible} alone."
        elif not view.detections:
            yield "No scores over time: there are no detections."
        elif rule is None:
            yield "No scores over time: no suite has the rule for which objects were eligible."


def _chosen(runs: Sequence[Results], choice: EpisodeChoice) -> tuple[Results, JobScores]:
    """Return the job that is shown, and its results; one that no view shows comes last."""
    possible = []
    for results in runs:
        fitting = [job for job in results.jobs if choice.allows(job) and job.reason is None]
        for board in results.boards():
            for entry in results.entries(board):
                own = [job for job in fitting if (job.board, job.entry) == (board, entry)]
                possible += [(results, job) for job in own[:1]]
    if possible:
        return min(possible, key=lambda pair: bool(board_named(pair[1].board).unviewable))
    jobs = [job for results in runs for job in results.jobs]
    wanted = ", ".join(f"{name} '{value}'" for name, value in choice.named.items())
    if failed := [job for job in jobs if choice.allows(job)]:
        who = wanted or "every entry"
        raise StoredAnswersError(f"{who} failed in every episode, first with: {failed[0].reason}")
    possible_values = "; ".join(_possible(jobs, name) for name in choice.named)
    raise StoredAnswersError(f"no episode has {wanted}; the results have {possible_values}")


def _possible(jobs: Sequence[JobScores], name: str) -> str:
    """Return what the results have of a property."""
    values = list(dict.fromkeys(str(getattr(job, name)) for job in jobs))
    more = f" and {len(values) - MOST_NAMED} more" if len(values) > MOST_NAMED else ""
    return f"{name}: {', '.join(values[:MOST_NAMED])}{more}"


def _named(job: JobScores) -> str:
    condition = "" if job.condition in ("", "clear") else f", {job.condition}"
    # The names of some entries end with their inputs.
    inputs = f" on {job.inputs}" if job.inputs else ""
    inputs = "" if job.entry.endswith(inputs) else inputs
    return f"{job.entry}{inputs}, {job.scenario}, seed {job.seed}{condition}"


def _score_spec(folder: Path, job: JobScores) -> Mapping[str, Any]:
    """Return what the score of a job depended on, see `Job.spec`, from the results database."""
    path = folder / DATABASE
    if not path.is_file():
        raise StoredAnswersError(f"no {DATABASE} in {folder}, which says where answers are stored")
    with Store(path) as store:
        spec = store.spec(entry=job.entry, **job.name._asdict())
    if spec is None:
        raise StoredAnswersError(f"{path} has no row of {_named(job)}")
    content: Mapping[str, Any] = json.loads(spec)
    return content


def _stored_answers(content: Mapping[str, Any]) -> Iterator[Any]:
    """Yield the stored record of an answer: of a node with this content."""
    key = fingerprint(content)
    for node in STORED_NODES:
        path = cache_dir() / node.folder / f"{key}.cache"
        if path.is_file():
            try:
                yield read_kept(path, node.record.load)
            except RecordError:
                continue


def _first(answers: Sequence[Any], record: type[R]) -> R | None:
    return next((each for each in answers if isinstance(each, record)), None)


def _parts(name: str, content: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield what an answer and everything that it was computed from depended on, with its name."""
    yield name, content
    for inner, value in content.items():
        if isinstance(value, Mapping):
            yield from _parts(inner, value)


def _episode(spec: Mapping[str, Any], job: JobScores, results: Results) -> Episode | None:
    """Return the episode that a score was computed on; None if it would be another one now."""
    try:
        episode = Episode(
            str(spec["name"]),
            int(spec["seed"]),
            str(results.manifest["rig"]),
            spec["duration_s"],
            job.conditions.get("weather", "clear"),
            str(spec["light"]),
            tuple(part for part in job.condition.split(" + ") if ":" in part),
        )
        return episode if fingerprint(episode.spec()) == fingerprint(spec) else None
    except (KeyError, TypeError, ValueError, OSError):
        return None


def _timeline(spec: Mapping[str, Any]) -> Timeline | None:
    """Return the traffic of an episode, if it is stored."""
    names = ("scenario", "name", "seed", "duration_s", "code")
    try:
        key = fingerprint({name: spec[name] for name in names})
        name = f"{spec['name']}-{spec['seed']}-{key}.cache"
        return read_kept(cache_dir() / TrafficNode.folder / name, Timeline.load)
    except (KeyError, OSError, RecordError):
        return None


def _rule(settings: str) -> Eligibility | None:
    """Return the rule with this fingerprint; None unless it is the default or that of a suite."""
    rules = [Eligibility(), *(load_suite(name).eligibility for name in SUITES)]
    return next((rule for rule in rules if fingerprint(rule) == settings), None)
