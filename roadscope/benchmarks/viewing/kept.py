"""Reads what a leaderboard run kept of one episode: truth, tracks, detections, poses.

No plug-in runs again. The results database says what each score was computed from, and so which
files in the cache folder have the answers.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from roadscope.benchmarks.cache import cache_dir, read_kept
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.fingerprint import fingerprint
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
from roadscope.benchmarks.viewing.curves import running_scores
from roadscope.benchmarks.viewing.view import EpisodeView
from roadscope.core import RecordError, Truth
from roadscope.envs.traffic.timeline import Timeline

KEPT = (TrackNode, DetectionNode, FusionNode, ImageNode, PoseNode)
"""Nodes whose files are shown; their content is told apart by its record."""
MOST_NAMED = 8
"""Most possibilities that an error names."""

R = TypeVar("R")


class KeptError(ValueError):
    """Nothing is kept of an episode, or there is no such episode."""


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

    def allows(self, job: JobScores) -> bool:
        """Return whether a job is such an episode."""
        names = {name: getattr(self, name) for name in self.__slots__}
        return all(wanted in (None, getattr(job, name)) for name, wanted in names.items())


def view_of_results(folder: Path | str, choice: EpisodeChoice) -> EpisodeView:
    """Return the first episode that is chosen, of the best entry that has one.

    folder: of `roadscope leaderboard --out`. Returns and images are made again, if the code and the
    rig are those of the run. `KeptError` if there is no such episode, or nothing is kept of it;
    `FolderError` for a folder without results.
    """
    place = Path(folder)
    results, job = _chosen([run.results for run in read_runs(place)], choice)
    content = _content(place, job)
    kept = list(_kept(content))
    if not kept:
        raise KeptError(
            f"nothing is kept of {_named(job)} in {cache_dir()}: it was removed, or the run used "
            "another cache folder (ROADSCOPE_CACHE); run the leaderboard again"
        )
    detections, tracks = _first(kept, EpisodeDetections), _first(kept, EpisodeTracks)
    fusions, poses = _first(kept, EpisodeFusions), _first(kept, EpisodePoses)
    spec = next(_specs(content), None)
    episode = None if spec is None else _episode(spec, job, results)
    notes = []
    if episode is None:
        notes.append("No sensor data: they cannot be made again, as code or rig has changed.")
    truths: Sequence[Truth] = () if detections is None else detections.truths
    if not truths and episode is not None:
        truths = [without_sources(truth) for _, truth in sensed(episode)]
    rule = _rule(results)
    if rule is None:
        notes.append("No scores over time: the suite is not known any more.")
    boxes = () if detections is None else detections.detections
    if fusions is not None:
        boxes = tuple(each.detections() for each in fusions.fused)
    scored = detections if fusions is None and rule is not None else None
    return EpisodeView(
        title=_named(job),
        episode=episode,
        timeline=None if spec is None else _timeline(spec),
        truths=truths,
        detections=boxes,
        tracks=() if tracks is None else tracks.tracks,
        poses=poses,
        images=_first(kept, EpisodeImageDetections),
        scores={job.board: job.scores},
        curves=running_scores(
            rule or Eligibility(), scored, () if tracks is None else tracks.tracks, poses
        ),
        notes=notes,
    )


def _chosen(runs: Sequence[Results], choice: EpisodeChoice) -> tuple[Results, JobScores]:
    """Return the job that is shown, and its results."""
    for results in runs:
        fitting = [job for job in results.jobs if choice.allows(job) and job.reason is None]
        for board in results.boards():
            for entry in results.entries(board):
                own = [job for job in fitting if (job.board, job.entry) == (board, entry)]
                if own:
                    return results, own[0]
    jobs = [job for results in runs for job in results.jobs]
    if choice == EpisodeChoice():
        raise KeptError("every entry failed in every episode")
    raise KeptError(f"no episode with {_wanted(choice)} but failed ones; {_possible(jobs, choice)}")


def _wanted(choice: EpisodeChoice) -> str:
    named = ((name, getattr(choice, name)) for name in choice.__slots__)
    return ", ".join(f"{name} '{value}'" for name, value in named if value is not None)


def _possible(jobs: Sequence[JobScores], choice: EpisodeChoice) -> str:
    """Return what the results have of each property that was chosen."""
    texts = []
    for name in choice.__slots__:
        if getattr(choice, name) is not None:
            values = list(dict.fromkeys(str(getattr(job, name)) for job in jobs))
            more = f" and {len(values) - MOST_NAMED} more" if len(values) > MOST_NAMED else ""
            texts.append(f"{name}: {', '.join(values[:MOST_NAMED])}{more}")
    return "there are " + "; ".join(texts)


def _named(job: JobScores) -> str:
    condition = "" if job.condition in ("", "clear") else f", {job.condition}"
    inputs = f" on {job.inputs}" if job.inputs else ""
    return f"{job.entry}{inputs}, {job.scenario}, seed {job.seed}{condition}"


def _content(folder: Path, job: JobScores) -> Mapping[str, Any]:
    """Return what the answers of a job depended on, from the results database."""
    path = folder / DATABASE
    if not path.is_file():
        raise KeptError(f"no {DATABASE} in {folder}, which says where answers are kept")
    with Store(path) as store:
        spec = store.spec(entry=job.entry, **job.name._asdict())
    if spec is None:
        raise KeptError(f"{path} has no row of {_named(job)}")
    answers: Mapping[str, Any] = json.loads(spec)["answers"]
    return answers


def _kept(content: Mapping[str, Any]) -> Iterator[Any]:
    """Yield the kept records of an answer and of everything that it was computed from."""
    key = fingerprint(content)
    for node in KEPT:
        path = cache_dir() / node.folder / f"{key}.cache"
        if path.is_file():
            try:
                yield read_kept(path, node.record.load)
            except RecordError:
                continue
    for value in content.values():
        if isinstance(value, Mapping):
            yield from _kept(value)


def _first(answers: Sequence[Any], record: type[R]) -> R | None:
    return next((each for each in answers if isinstance(each, record)), None)


def _specs(content: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Yield what the episodes of an answer and of its sources depended on."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            if name == "episode" and "name" in value:
                yield value
            yield from _specs(value)


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
    """Return the traffic of an episode, if it is kept."""
    names = ("scenario", "name", "seed", "duration_s", "code")
    try:
        key = fingerprint({name: spec[name] for name in names})
        name = f"{spec['name']}-{spec['seed']}-{key}.cache"
        return read_kept(cache_dir() / TrafficNode.folder / name, Timeline.load)
    except (KeyError, OSError, RecordError):
        return None


def _rule(results: Results) -> Eligibility | None:
    """Return which objects were eligible; None unless the suite is one of ours as it is now."""
    name = results.manifest.get("suite")
    if name not in SUITES:
        return None
    # A run may have used only the first seeds.
    suite = replace(load_suite(name), seeds=tuple(results.manifest.get("seeds", ())))
    return suite.eligibility if fingerprint(suite) == results.manifest.get("suite_hash") else None
