"""Papers whose experiments can be repeated."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from roadscope.core import SpecError
from roadscope.core.names import unknown

PAPERS = {
    "li2021": "roadscope.benchmarks.papers.li2021",
    "lu2018": "roadscope.benchmarks.papers.lu2018",
    "zhang2017": "roadscope.benchmarks.papers.zhang2017",
    "zhang2022": "roadscope.benchmarks.papers.zhang2022",
}
"""Name -> module with `reproduce(seeds, progress, *, jobs) -> list[ReproductionRow]` and, where
tables need an explanation, `note_of(experiment) -> str | None`."""


def reproduction_of(paper: str) -> Callable[..., Any]:
    """Return the function that repeats a paper's experiments; `SpecError` for an unknown paper."""
    if paper not in PAPERS:
        raise SpecError(unknown("paper", paper, PAPERS))
    reproduce: Callable[..., Any] = import_module(PAPERS[paper]).reproduce
    return reproduce


def note_of(paper: str, experiment: str) -> str | None:
    """Return what must be known to read the tables of one of a paper's experiments."""
    note: Callable[[str], str | None] | None
    note = getattr(import_module(PAPERS[paper]), "note_of", None)
    return None if note is None else note(experiment)
