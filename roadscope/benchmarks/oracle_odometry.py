"""Marks of the odometry board: methods that are spared all that moves, and those of no method."""

from __future__ import annotations

from roadscope.benchmarks.noisy_odometry import imitated
from roadscope.benchmarks.oracle import MARKS, ONE_CLUSTER, ORACLE
from roadscope.core.registry import split_spec

GIVEN_TRUTH = f"{ORACLE}?odometry="
"""Names an odometry that gets scans without the returns of what truly moves."""
IMITATION = "imitation"
"""The mark of what is made from truth with errors."""
LOWER_MARKS = ("still", "dead-reckoning")
"""They look at no scan."""


def spared(spec: str) -> str | None:
    """Return whom an oracle's spec names: all of `oracle?odometry=A?b=1&c=2` after the first `=`.

    None where a spec is no oracle's.
    """
    return spec.removeprefix(GIVEN_TRUTH) if spec.startswith(GIVEN_TRUTH) else None


def needs_truth(spec: str) -> bool:
    """Say whether a spec names what only truth can make: an oracle or an imitation."""
    return split_spec(spec)[0] == ORACLE or imitated(spec)


def method_of(spec: str) -> str:
    """Return the odometry that is run."""
    inner = spared(spec)
    return spec if inner is None else inner


def entry_of(spec: str) -> str:
    """Return how the board calls an odometry."""
    inner = spared(spec)
    return spec if inner is None else f"{inner} on {ORACLE}"


def odometry_mark(spec: str) -> str | None:
    """Say which mark an odometry's spec is of; None: it is ranked."""
    if spared(spec) is not None:
        return MARKS[ORACLE]
    if imitated(spec):
        return IMITATION
    return MARKS[ONE_CLUSTER] if spec in LOWER_MARKS else None
