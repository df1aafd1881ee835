"""What jobs of all boards have in common: what they are known by, and how they end."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

from roadscope.benchmarks.fingerprint import code_hash, fingerprint
from roadscope.benchmarks.jobs.stack import EntryError, describe
from roadscope.benchmarks.jobs.store import Outcome
from roadscope.benchmarks.metrics import METRIC_VERSION
from roadscope.benchmarks.metrics.score import Score


class KeyedJob(ABC):
    """One entry on one episode of a board, known by everything that its result depends on."""

    board: str
    entry: str

    @property
    @abstractmethod
    def scoring(self) -> tuple[str, ...]:
        """Files that scores depend on beside what `content` says."""

    @abstractmethod
    def content(self) -> Mapping[str, Any]:
        """Return what else the result depends on, beside board and entry, as JSON can hold it."""

    @cached_property
    def spec(self) -> str:
        """Everything that the result depends on, as JSON."""
        content = {
            "board": self.board,
            "entry": self.entry,
            "metric_version": METRIC_VERSION,
            "metric_code": code_hash(*self.scoring),
            **self.content(),
        }
        return json.dumps(content, sort_keys=True)

    @cached_property
    def key(self) -> str:
        """The content hash under which the result is kept."""
        return fingerprint(self.spec)


def outcome_of(work: Callable[[], Mapping[str, Score]]) -> Outcome:
    """Return the scores; whatever goes wrong becomes the reason, nothing is raised."""
    try:
        return Outcome(work())
    except EntryError as error:
        return Outcome({}, str(error))
    except Exception as error:
        return Outcome({}, f"not the entry's fault: {describe(error)}")
