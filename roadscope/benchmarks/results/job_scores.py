"""The scores of one job, in the form of `leaderboard.json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, Self

from roadscope.benchmarks.metrics.score import Score


class JobName(NamedTuple):
    """What identifies a job beside its entry; jobs of two runs with equal names are compared.

    condition: weather, light and faults in words. inputs: the detector whose detections it gets.
    """

    board: str
    scenario: str
    seed: int
    condition: str
    inputs: str


@dataclass(frozen=True, slots=True)
class JobScores:
    """The scores of one entry on one episode.

    condition: weather, light and faults in words.
    inputs: the detector whose detections the entry gets; empty if it gets none.
    scores: by metric; empty if it failed.
    reason: why it failed, or None. log: the end of what the failed plug-in printed.
    not_installed: whether it failed because something that it needs is not installed.
    mark: which mark of the board the entry is, or None.
    conditions: the value of each condition of the board, such as `weather` or `sequence`.
    """

    board: str
    entry: str
    scenario: str
    seed: int
    condition: str
    inputs: str
    scores: Mapping[str, Score]
    reason: str | None = None
    mark: str | None = None
    conditions: Mapping[str, str] = field(default_factory=dict)
    log: str = ""
    not_installed: bool = False

    @property
    def name(self) -> JobName:
        """The name by which it is compared with the same job of another run."""
        return JobName(self.board, self.scenario, self.seed, self.condition, self.inputs)

    def to_json(self) -> dict[str, Any]:
        """Return the job as a JSON object, without its log."""
        named = {each.name: getattr(self, each.name) for each in fields(self) if each.name != "log"}
        scores = {name: score.to_json() for name, score in self.scores.items()}
        return {**named, "scores": scores, "conditions": dict(self.conditions)}

    @classmethod
    def from_json(cls, item: Mapping[str, Any]) -> Self:
        """Read what `to_json` returned; marks and conditions may be missing."""
        texts = {name: str(item[name]) for name in ("board", "entry", "scenario")}
        texts |= {name: str(item.get(name) or "") for name in ("condition", "inputs")}
        reason, mark = item.get("reason"), item.get("mark")
        return cls(
            **texts,
            seed=int(item["seed"]),
            scores={name: Score.from_json(score) for name, score in item["scores"].items()},
            reason=None if reason is None else str(reason),
            mark=None if mark is None else str(mark),
            conditions={str(k): str(v) for k, v in item.get("conditions", {}).items()},
            not_installed=bool(item.get("not_installed")),
        )
