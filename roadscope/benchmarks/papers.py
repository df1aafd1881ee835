"""Papers whose experiments can be repeated."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from roadscope.benchmarks.suite import unknown
from roadscope.core import SpecError

PAPERS = {"lu2018": "roadscope.benchmarks.lu2018"}
"""Name -> module with `reproduce(seeds, progress, *, jobs) -> list[ReproductionRow]`."""


def reproduction_of(paper: str) -> Callable[..., Any]:
    """Return the function that repeats a paper's experiments."""
    if paper not in PAPERS:
        raise SpecError(unknown("paper", paper, PAPERS))
    experiments: Callable[..., Any] = import_module(PAPERS[paper]).reproduce
    return experiments
