"""A plug-in of one's own against its contract, in plain words.

It runs in a process of its own, one promise after the other, so that one that hangs or ends the
program is told like any other fault.
"""

from __future__ import annotations

import io
import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from multiprocessing.connection import Connection
from typing import Any

from roadscope.benchmarks.check import (
    camera_detectors,
    detectors,
    fusions,
    odometries,
    offline,
    trackers,
)
from roadscope.benchmarks.check.items import Item, Promise, PromiseError
from roadscope.benchmarks.jobs.entries import by_scans, in_images
from roadscope.benchmarks.jobs.stack import EntryError, describe
from roadscope.benchmarks.noisy_camera import CAMERA_NOISES
from roadscope.benchmarks.noisy_odometry import imitated
from roadscope.benchmarks.oracle import FUSED, full_name, made_from_truth
from roadscope.core.names import unknown
from roadscope.core.registry import Plugin, Registry, SpecError, split_spec
from roadscope.detectors import DETECTORS
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.fusion import FUSIONS
from roadscope.odometry import ODOMETRIES
from roadscope.trackers import TRACKERS
from roadscope.trackers.api import is_offline

LOADED = "can be loaded"
READY = "our own part of the scene is ready"
QUIET = "prints nothing"
DEADLINE_S = 120.0
"""For one promise, as ours compile what they need on their first call."""
PATIENCE_S = {LOADED: 120.0, READY: 900.0}
"""For what is not the plug-in's own."""

Told = Callable[[Item], None]


def check_plugin(
    spec: str, *, deadline_s: float = DEADLINE_S, told: Told | None = None
) -> list[Item]:
    """Look at everything that a detector, of LiDAR or images, tracker, fusion or odometry promises.

    spec: a name, `module:Class` or `path/to/file.py:Class`, with arguments if you like.
    deadline_s: for each promise; what takes longer hangs. Making our own part ready is not
        counted, and a plug-in of ours has at least the time for that: its first call compiles it.
    told: called with every item as it is known.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_look_at, args=(spec, theirs), daemon=True)
    child.start()
    theirs.close()
    items: list[Item] = []
    try:
        for item in _heard(ours, child, _patience_s(spec, deadline_s)):
            items.append(item)
            if told is not None:
                told(item)
    finally:
        child.kill()
        child.join()
        ours.close()
    return items


def broken(items: Sequence[Item]) -> int:
    """Return how many items are wrong."""
    return sum(item.times for item in items if not item.good)


def line(item: Item) -> str:
    """Return an item as a line to print."""
    mark = "ok   " if item.good else "WRONG"
    return f"{mark}  {item.promise}" + (f": {item.words}" if item.words else "")


def _patience_s(spec: str, deadline_s: float) -> float:
    """Return the deadline of each promise of a plug-in, which is not loaded for that."""
    name = full_name(spec.partition("?")[0])
    targets = [registry.target(name) for registry, _ in KINDS if name in registry]
    ours = any(target.startswith("roadscope.") for target in targets or [name])
    return max(deadline_s, PATIENCE_S[READY]) if ours else deadline_s


def _heard(ours: Connection, child: Any, deadline_s: float) -> Iterator[Item]:
    """Yield items until the child is done, is silent for too long, or is gone."""
    promise = LOADED
    while True:
        patience_s = PATIENCE_S.get(promise, deadline_s)
        if not ours.poll(patience_s):
            yield Item(promise, False, f"no answer within {patience_s:g} s: it hangs")
            return
        try:
            message = ours.recv()
        except EOFError:
            child.join()
            yield Item(promise, False, f"ended the whole program, exit code {child.exitcode}")
            return
        if message is None:
            return
        if isinstance(message, str):
            promise = message
        else:
            yield message


def _look_at(spec: str, theirs: Connection) -> None:
    """Look at all promises, in the child; a string says which is next, None that all are done.

    What is wrong in the same words once more is counted, and told when all else is.
    """
    printed, wrong = io.StringIO(), Counter[str]()
    with redirect_stdout(printed):
        try:
            plugin, promises = load(spec)
        except (SpecError, PromiseError) as error:
            theirs.send(Item(LOADED, False, str(error)))
            theirs.send(None)
            return
        theirs.send(Item(LOADED, True, _kind(promises) + _by_default(plugin, promises)))
        for number, promise in enumerate(promises):
            if promise.ready is not None:
                theirs.send(READY)
                promise.ready()
            theirs.send(promise.words)
            item = looked_at(promise, plugin)
            if item.good or item.words not in wrong:
                theirs.send(item)
            wrong.update([] if item.good else [item.words])
            # What cannot be made or called need not be asked for more.
            if not item.good and number < 2:
                break
    for words, times in wrong.items():
        if times > 1:
            theirs.send(Item(f"and {times - 1} more", False, f"the same: {words}", times - 1))
    theirs.send(_quiet(printed.getvalue()))
    theirs.send(None)


def looked_at(promise: Promise, plugin: Plugin[Any]) -> Item:
    """Look at one promise; whatever the plug-in raises is told."""
    try:
        return Item(promise.words, True, promise.look(plugin))
    except (PromiseError, SpecError) as error:
        return Item(promise.words, False, str(error))
    except EntryError as error:
        return Item(promise.words, False, str(error).removeprefix(f"{plugin.spec}: "))
    except (Exception, SystemExit) as error:
        return Item(promise.words, False, describe(error, in_plugin=True))


def load(spec: str) -> tuple[Plugin[Any], Sequence[Promise]]:
    """Find the plug-in and what its kind promises.

    A class with detect() is taken for a LiDAR's detector, unless `in_images` says otherwise; one
    with update() for a tracker, unless `by_scans` does.
    """
    spec = full_name(spec)
    name, _ = split_spec(spec)
    if name == FUSED:
        raise PromiseError("it joins two detectors by a fusion; check each of the three")
    if made_from_truth(name) or name in CAMERA_NOISES or imitated(spec):
        raise PromiseError("it is made from the truth and is no plug-in: it promises nothing")
    for registry, promises in KINDS:
        if name in registry:
            found = registry.resolve(spec)
            return found, _promises(found, promises)
    if ":" not in name and not name.endswith(".py"):
        known = [n for registry, _ in KINDS for n in registry.names()]
        raise SpecError(
            unknown("plug-in", name, known)
            + "; or name your own: package.module:Class, path/to/file.py:Class"
        )
    place, _, _ = name.rpartition(":")
    if ":" in place and not place.endswith(".py"):
        raise SpecError(
            f"'{name}' has more than one colon; possible: package.module:Class, "
            "path/to/file.py:Class"
        )
    plugin: Plugin[Any] = TRACKERS.resolve(spec)
    if hasattr(plugin.factory, "update"):
        told = odometries.PROMISES if by_scans(plugin.factory) else trackers.PROMISES
        return plugin, _promises(plugin, told)
    if hasattr(plugin.factory, "fuse"):
        return plugin, fusions.PROMISES
    if hasattr(plugin.factory, "detect"):
        seen = in_images(plugin.factory)
        return plugin, camera_detectors.PROMISES if seen else detectors.PROMISES
    raise PromiseError(
        f"{plugin.factory.__name__} has neither a method update, as a tracker or an odometry "
        "does, nor detect, as a detector does, nor fuse, as a fusion does"
    )


KINDS: tuple[tuple[Registry[Any], Sequence[Promise]], ...] = (
    (DETECTORS, detectors.PROMISES),
    (TRACKERS, trackers.PROMISES),
    (CAMERA_DETECTORS, camera_detectors.PROMISES),
    (FUSIONS, fusions.PROMISES),
    (ODOMETRIES, odometries.PROMISES),
)


def _promises(plugin: Plugin[Any], promises: Sequence[Promise]) -> Sequence[Promise]:
    late = promises is trackers.PROMISES and is_offline(plugin.factory)
    return (*promises, *offline.PROMISES) if late else promises


def _kind(promises: Sequence[Promise]) -> str:
    names = ("a detector", "a tracker", "a camera detector", "a fusion", "an odometry")
    for name, (_, known) in zip(names, KINDS, strict=True):
        if promises is known:
            return name
    return "an offline tracker"


def _by_default(plugin: Plugin[Any], promises: Sequence[Promise]) -> str:
    """Say how a class is taken for another kind, where nothing says which of two it is."""
    named = any(split_spec(plugin.spec)[0] in registry for registry, _ in KINDS)
    if promises is not detectors.PROMISES or named:
        return ""
    return "; for one of images, `detect` says so by `-> ImageDetections`"


def _quiet(printed: str) -> Item:
    if not printed.strip():
        return Item(QUIET, True)
    first = printed.strip().splitlines()[0]
    return Item(QUIET, False, f"stdout is for results, yet it prints '{first[:60]}'; use logging")
