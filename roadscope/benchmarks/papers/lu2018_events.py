"""What the experiments of Lu 2018 are about, as numbers: errors, events, identities.

Frames are numbered from 1, as in the paper; targets too. A frame that never came counts as the
one after the last, so that a failure shows in the mean instead of vanishing from it.
"""

from __future__ import annotations

import numpy as np

from roadscope.benchmarks.papers.lu2018_follow import NOBODY, Following
from roadscope.envs.traffic.lu2018 import Event, Script

AHEAD, LEFT = "ahead (paper's y)", "left (paper's x)"
AXES = (AHEAD, LEFT)


def errors(followed: Following, target: int) -> dict[str, float]:
    """Root mean squares over the frames with a detection, metres, in the vehicle's frame."""
    row = target - 1
    used = followed.detected[row] & (followed.ids[row] != NOBODY)
    pairs = {
        "estimate minus measurement": followed.estimated[row] - followed.measured[row],
        "estimate minus truth": followed.estimated[row] - followed.truth[row],
        "measurement minus truth": followed.measured[row] - followed.truth[row],
    }
    return {
        f"RMS of {name}, object {target}, {axis}": _rms(values[used, column])
        for name, values in pairs.items()
        for column, axis in enumerate(AXES)
    }


def first_tracked(followed: Following, target: int) -> float:
    """Return the first frame in which a target was detected and had a track."""
    return _first(followed.detected[target - 1] & (followed.ids[target - 1] != NOBODY))


def lost_after(followed: Following, target: int, last: int | None = None) -> float:
    """Return the frame after the last one (up to frame `last`) in which a target was detected."""
    seen = np.flatnonzero(followed.detected[target - 1, :last])
    return float(seen[-1] + 2) if len(seen) else 1.0


def found_again(followed: Following, target: int, gone: int) -> float:
    """Return the first frame from `gone` on that brought a detection to the target's old track."""
    row = target - 1
    before = _last_id(followed, target, gone)
    again = followed.detected[row] & (followed.ids[row] == before) & (before != NOBODY)
    again[: gone - 1] = False
    return _first(again)


def found_at_once(followed: Following, target: int, event: Event) -> float:
    """Return 1 when a detection in the frame after an event goes to the old track, otherwise 0."""
    return float(found_again(followed, target, event.first) == event.last + 1)


def kept_through(followed: Following, target: int, event: Event) -> float:
    """Return 1 when the first detection after an event goes to the old track, otherwise 0."""
    row = target - 1
    before = _last_id(followed, target, event.first)
    after = np.flatnonzero(followed.detected[row, event.last :])
    if before == NOBODY or not len(after):
        return 0.0
    return float(followed.ids[row, event.last + after[0]] == before)


def natural_misses(followed: Following, target: int, script: Script) -> float:
    """Count frames without a detection between the first and the last one with, less the forced."""
    seen = followed.detected[target - 1].copy()
    for kind in ("missed", "hidden"):
        for event in script.of(kind, target):
            seen[event.first - 1 : event.last] = True
    span = np.flatnonzero(followed.detected[target - 1])
    return float((~seen[span[0] : span[-1] + 1]).sum()) if len(span) else 0.0


def wrong_associations(followed: Following) -> float:
    """Count how often a track that followed one target took the detection of another."""
    taken = np.where(followed.detected, followed.ids, NOBODY)
    owner: dict[int, int] = {}
    wrong = 0
    for frame in taken.T:
        for target, identity in enumerate(frame.tolist()):
            if identity != NOBODY:
                wrong += owner.get(identity, target) != target
                owner[identity] = target
    return float(wrong)


def clutter_associations(followed: Following) -> float:
    """Count how often a track that followed a target took a detection of no target."""
    followers: set[int] = set()
    wrong = 0
    for k, strays in enumerate(followed.strays):
        wrong += len(followers & strays)
        detected = followed.ids[followed.detected[:, k], k]
        followers = (followers - strays) | set(detected.tolist())
    return float(wrong)


def identity_changes(followed: Following) -> float:
    """Count how often a target's track was another than the one it had last."""
    known = (ids[ids != NOBODY] for ids in followed.ids)
    return float(sum(int((np.diff(ids) != 0).sum()) for ids in known))


def _last_id(followed: Following, target: int, gone: int) -> int:
    ids = followed.ids[target - 1, : gone - 1]
    known = ids[ids != NOBODY]
    return int(known[-1]) if len(known) else NOBODY


def _first(flags: np.ndarray) -> float:
    return float(flags.argmax() + 1) if flags.any() else float(len(flags) + 1)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
