"""What a detector promises, one by one."""

from __future__ import annotations

from functools import lru_cache
from time import perf_counter
from typing import Any

from roadscope.benchmarks.check.items import (
    TWO_SECONDS,
    Promise,
    PromiseError,
    begins,
    begun,
    having,
    leaving_alone,
    settled,
    traffic_ready,
)
from roadscope.benchmarks.jobs.stack import STAMP_TOLERANCE_S, guarded
from roadscope.core import Detections, Frame
from roadscope.core.registry import Plugin


@lru_cache(maxsize=1)
def frames() -> tuple[Frame, ...]:
    """Return the frames of the two-second scene."""
    from roadscope.benchmarks.episode import Episode, sensed

    return tuple(frame for frame, _ in sensed(Episode(*TWO_SECONDS)))


def detected(plugin: Plugin[Any], detector: Any, frame: Frame) -> Detections:
    """Call detect; an answer that is not what the contract says is a fault."""
    found = guarded(plugin.spec, detector.detect, frame)
    if not isinstance(found, Detections):
        raise PromiseError(f"detect returned {type(found).__name__}, not roadscope.core.Detections")
    if found.frame not in ("ego", "world"):
        raise PromiseError(f"detections in frame '{found.frame}'; possible: ego, world")
    seen = [f.stamp_s for f in frames() if f.stamp_s <= frame.stamp_s + STAMP_TOLERANCE_S]
    if all(abs(found.stamp_s - stamp_s) > STAMP_TOLERANCE_S for stamp_s in seen):
        raise PromiseError(
            f"detections are stamped {round(found.stamp_s, 6)} s, their frame "
            f"{round(frame.stamp_s, 6)} s, and no earlier frame bears that stamp; return the stamp "
            "of the frame you answer"
        )
    return found


def told(plugin: Plugin[Any], detector: Any) -> list[Detections]:
    """Run a detector over the scene."""
    return [detected(plugin, detector, frame) for frame in frames()]


def answers(plugin: Plugin[Any]) -> str:
    """Look at what comes back."""
    told(plugin, begun(plugin))
    return ""


def two_seconds(plugin: Plugin[Any]) -> str:
    """Detect simulated traffic for two seconds."""
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.single import run_episode

    begin = perf_counter()
    summary = run_episode(Episode(*TWO_SECONDS), detector=plugin.spec, tracker="nearest")
    scores = summary.detection
    if not any(len(found) for found in summary.perceived.detections):
        raise PromiseError("two seconds of a motorway full of cars: nothing is detected")
    if not scores["detection_rate"].value:
        count = sum(len(found) for found in summary.perceived.detections)
        raise PromiseError(
            f"{count} boxes in two seconds of a motorway full of cars, and none of them on a car; "
            "centres are metres in the frame that is named: 'ego', x ahead and y to the left, or "
            "'world'"
        )
    return (
        f"detection rate {scores['detection_rate'].value:.2f} on a motorway, "
        f"{scores['call_p50_ms'].value:.2g} ms a frame, {perf_counter() - begin:.0f} s in all"
    )


PROMISES = (
    *begins("detect", having("detect", "frame")),
    Promise("answers with detections of a frame it saw", answers, frames),
    leaving_alone(detected, lambda: frames()[:8], "detect changed the frame it was given"),
    *settled(told, "frames", "detections"),
    Promise("detects two seconds of traffic", two_seconds, traffic_ready),
)
