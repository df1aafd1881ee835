"""Whose poses of the ego a tracker is told: part of its spec, `gnn?gate_m=2&ego=voxel-map`."""

from __future__ import annotations

import re
from collections.abc import Iterable

TRUE_POSES, NO_POSES = "truth", "none"
"""What may be named beside an odometry; without a word, trackers are told the true poses."""
_ARGUMENT = re.compile(r"[?&]ego=")


def split_ego(spec: str) -> tuple[str, str]:
    """Split a tracker's spec into the tracker itself and whose poses it is told.

    `ego=` is no argument of a tracker's constructor and comes last: all behind it is `truth`,
    `none` or the spec of an odometry, with arguments of its own or an oracle's.
    """
    tracker, *told = _ARGUMENT.split(spec, maxsplit=1)
    return tracker, told[0] if told else TRUE_POSES


def tracker_of(spec: str) -> str:
    """Return the spec of what is called."""
    return split_ego(spec)[0]


def with_ego(tracker: str, ego: str) -> str:
    """Undo `split_ego`; the true poses go without saying."""
    if ego == TRUE_POSES:
        return tracker
    return f"{tracker}{'&' if '?' in tracker else '?'}ego={ego}"


def told_each(trackers: Iterable[str], egos: Iterable[str]) -> list[str]:
    """Return every tracker with each of some poses; whoever names its own is told those."""
    every = list(egos)
    specs = [
        with_ego(tracker_of(spec), ego)
        for spec in trackers
        for ego in (every if _ARGUMENT.search(spec) is None else [split_ego(spec)[1]])
    ]
    return list(dict.fromkeys(specs))


def odometry_told(spec: str) -> str | None:
    """Return the odometry whose poses a tracker is told, an oracle's too; None without one."""
    return odometry_among(split_ego(spec)[1])


def odometry_among(ego: str) -> str | None:
    """Return an odometry's spec as it is, and None for the true poses and for none."""
    return None if ego in (TRUE_POSES, NO_POSES) else ego
