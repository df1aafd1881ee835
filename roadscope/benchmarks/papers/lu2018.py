"""The experiments of Lu 2018 with the paper's figures beside ours.

Targets and clutter are synthetic; seeds vary noise, roadside, speeds, sizes and offsets, never
the frames of events. The paper tracks in the vehicle's frame, and so do we here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from roadscope.benchmarks.papers import lu2018_events as events
from roadscope.benchmarks.papers.lu2018_clutter import clutter_of_clustering, clutter_of_detector
from roadscope.benchmarks.papers.lu2018_follow import NOBODY, Following, follow
from roadscope.benchmarks.papers.lu2018_scene import Take, film
from roadscope.benchmarks.papers.reproduction import Key, ReproductionRow, over_seeds, summarise
from roadscope.core import Detections
from roadscope.detectors import DETECTORS
from roadscope.detectors.clustering import CLUSTERINGS

TWO, OCCLUSION, THREE = "lu2018-two-vehicles", "lu2018-occlusion", "lu2018-three-vehicles"
TRACKED = ("pag", "pag-range", "distance", "breakpoint")
"""Detectors whose output is tracked; the first is the paper's."""
DETECTED = (*TRACKED, "pag-residual", "pag-range-residual", "distance-residual")
NOISES = {"half noise": 0.5, "double noise": 2.0}
"""The first experiment once more with other range noise: nothing may hang on a quiet sensor."""
TRACKERS = {"nearest": "nearest?frame=ego", "nearest-q": "nearest-q?frame=ego"}
FIRST_SEED = 20000
"""Test seeds, as in the suites; what was chosen by trying was chosen on seeds 10000 to 19999."""

CLAIMS = "claims"
NO_WRONG = "no wrong association in any experiment"
IDENTITY = "identity kept through forced misses and occlusion"
LESS_CLUTTER = "fewer false detections than with distance clustering"
FEWER_CLUSTERS = "fewer clusters of foliage than with distance clustering"

RMS = "RMS of estimate minus measurement, object {}, {}"
FORCED = "forced misses of object 1 re-associated in the next frame"
PAPER: dict[tuple[str, str], float] = {
    (TWO, RMS.format(1, events.LEFT)): 0.0856,
    (TWO, RMS.format(1, events.AHEAD)): 0.1304,
    (TWO, RMS.format(2, events.LEFT)): 0.0694,
    (TWO, RMS.format(2, events.AHEAD)): 0.1670,
    (TWO, "object 2 first tracked in frame"): 26,
    (TWO, "object 2 first missing for good in frame"): 147,
    (TWO, FORCED): 4,
    (TWO, "natural misses of object 1"): 0,
    (TWO, "natural misses of object 2"): 0,
    (TWO, "wrong associations"): 0,
    (OCCLUSION, "object 2 first tracked in frame"): 51,
    (OCCLUSION, "object 1 first missing in frame"): 62,
    (OCCLUSION, "object 1 re-associated in frame"): 75,
    (OCCLUSION, "identity of object 1 kept through the occlusion"): 1,
    (THREE, "objects tracked in frame 15"): 3,
    (THREE, "object 1 first missing for good in frame"): 16,
    (CLAIMS, NO_WRONG): 1,
    (CLAIMS, IDENTITY): 1,
    (CLAIMS, LESS_CLUTTER): 1,
    (CLAIMS, FEWER_CLUSTERS): 1,
}
"""Table 2, the frame numbers of section 4, and what the paper claims, as the share of seeds in
which it holds. The paper calls x abscissa and y ordinate and writes the rear faces it sees as
y = kx + b, so its x is taken to run across the road and its y ahead; in the other reading the two
figures of a row change places. Its errors leave out the frames of misses, whose measurement it
sets to 0."""
PAPERS_METHODS = ("pag + nearest", "pag + nearest-q", "pag", "clustering pag")
"""What the paper's figures stand beside: its method, and the named reading with process noise."""


def reproduce(
    seeds: int = 30, progress: Callable[[int, int], None] | None = None, *, jobs: int = 1
) -> list[ReproductionRow]:
    """Run all experiments and return the paper's figures beside ours.

    seeds: how many seeds stand behind every interval.
    progress: called with seeds done and seeds in all, after each.
    jobs: processes that share the seeds; the rows are the same for any number.
    """
    numbers = range(FIRST_SEED, FIRST_SEED + seeds)
    measured = over_seeds(measure, numbers, progress, jobs=jobs)
    return [
        summarise(
            (experiment, method),
            quantity,
            unit_of(quantity),
            values,
            PAPER.get((experiment, quantity)) if method in PAPERS_METHODS else None,
        )
        for (experiment, method, quantity), values in measured.items()
    ]


def measure(seed: int) -> dict[Key, float]:
    """Measure every quantity of every experiment and method with one seed."""
    found: dict[Key, float] = {}
    for experiment, look in LOOKS.items():
        found |= _named(experiment, _methods(film(experiment, seed), look, DETECTED, TRACKED))
    for name, noise in NOISES.items():
        take = film(TWO, seed, noise)
        few = _methods(take, two_vehicles, (TRACKED[0], "distance"), TRACKED[:1])
        found |= _named(f"{TWO}, {name}", few)
    return found | {(CLAIMS, *key): float(held) for key, held in claims(found).items()}


def claims(found: dict[Key, float]) -> dict[tuple[str, str], bool]:
    """Say which of the paper's claims hold in one seed, by method."""
    held = {}
    for method in [m for e, m, q in found if e == THREE and q == "wrong associations"]:
        wrong = sum(found[e, method, "wrong associations"] for e in LOOKS)
        kept = found[OCCLUSION, method, "identity of object 1 kept through the occlusion"]
        held[method, NO_WRONG] = wrong == 0
        held[method, IDENTITY] = found[TWO, method, FORCED] == 4 and kept == 1
    for method in ("pag", "pag-range"):
        if (TWO, method, "false detections") in found:
            ours, theirs = (found[TWO, m, "false detections"] for m in (method, "distance"))
            held[method, LESS_CLUTTER] = ours < theirs
        few, many = (f"clustering {m}" for m in (method, "distance"))
        clusters = "clusters of foliage"
        held[few, FEWER_CLUSTERS] = found[TWO, few, clusters] < found[TWO, many, clusters]
    return held


def two_vehicles(take: Take, followed: Following) -> dict[str, float]:
    """Experiment 1: errors, the left car's coming and going, forced misses."""
    misses = take.script.of("missed", 1)
    return {
        **events.errors(followed, 1),
        **events.errors(followed, 2),
        "object 2 first tracked in frame": events.first_tracked(followed, 2),
        "object 2 first missing for good in frame": events.lost_after(followed, 2),
        FORCED: sum(events.found_at_once(followed, 1, miss) for miss in misses),
        "natural misses of object 1": events.natural_misses(followed, 1, take.script),
        "natural misses of object 2": events.natural_misses(followed, 2, take.script),
        **_identities(followed),
    }


def occlusion(take: Take, followed: Following) -> dict[str, float]:
    """Experiment 2: a target goes out of sight and comes back."""
    (hidden,) = take.script.of("hidden", 1)
    return {
        "object 2 first tracked in frame": events.first_tracked(followed, 2),
        "object 1 first missing in frame": events.lost_after(followed, 1, hidden.last),
        "object 1 re-associated in frame": events.found_again(followed, 1, hidden.first),
        "identity of object 1 kept through the occlusion": events.kept_through(followed, 1, hidden),
        **_identities(followed),
    }


def three_vehicles(take: Take, followed: Following) -> dict[str, float]:
    """Experiment 3: three at once, then two."""
    return {
        "objects tracked in frame 15": float(np.count_nonzero(followed.ids[:, 14] != NOBODY)),
        "object 1 first missing for good in frame": events.lost_after(followed, 1),
        **_identities(followed),
    }


Look = Callable[[Take, Following], dict[str, float]]
LOOKS: dict[str, Look] = {TWO: two_vehicles, OCCLUSION: occlusion, THREE: three_vehicles}


def unit_of(quantity: str) -> str:
    """Return the unit in which a quantity is given."""
    if quantity.startswith("RMS"):
        return "m"
    if quantity.endswith("in frame"):
        return "frame"
    if quantity in (NO_WRONG, IDENTITY, LESS_CLUTTER, FEWER_CLUSTERS):
        return "share"
    if quantity.startswith(("identity of", "detection rate", "returns of")):
        return "share"
    return "1/scan" if quantity.split()[0] in ("clusters", "false", "detections") else "count"


def _named(experiment: str, methods: Iterator[tuple[str, dict[str, float]]]) -> dict[Key, float]:
    return {
        (experiment, method, quantity): value
        for method, values in methods
        for quantity, value in values.items()
    }


def _methods(
    take: Take, look: Look, detectors: Sequence[str], tracked: Sequence[str]
) -> Iterator[tuple[str, dict[str, float]]]:
    """Every method with its quantities, trackers first."""
    detected = {name: _detect(take, name) for name in detectors}
    for detector in tracked:
        for tracker, spec in TRACKERS.items():
            yield f"{detector} + {tracker}", look(take, follow(take, detected[detector], spec))
    for detector, found in detected.items():
        yield detector, clutter_of_detector(take, found)
    for clustering in CLUSTERINGS:
        yield f"clustering {clustering}", clutter_of_clustering(take, clustering)


def _detect(take: Take, name: str) -> list[Detections]:
    detector = DETECTORS.make(name)
    found = [detector.detect(frame) for frame in take.frames]
    return [boxes for boxes in found if isinstance(boxes, Detections)]


def _identities(followed: Following) -> dict[str, float]:
    return {
        "wrong associations": events.wrong_associations(followed),
        "clutter taken by a target's track": events.clutter_associations(followed),
        "identity changes": events.identity_changes(followed),
    }
