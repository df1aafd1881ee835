"""What a fusion promises, one by one."""

from __future__ import annotations

from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from roadscope.benchmarks.check.items import (
    Promise,
    PromiseError,
    begins,
    begun,
    having,
    leaving_alone,
    settled,
)
from roadscope.benchmarks.jobs.stack import STAMP_TOLERANCE_S, guarded
from roadscope.benchmarks.seen import nothing_seen
from roadscope.core import Category, Detections, ImageDetections, Pose
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.core.registry import Plugin
from roadscope.fusion.overlap import projected_boxes

if TYPE_CHECKING:
    from roadscope.benchmarks.jobs.fused import Moments

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
LOOK = Projection.of(
    np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]),
    Pose.from_parts(OPTICAL, np.array([0.0, 0.0, 1.4])), 640, 480,
)  # fmt: skip
STAMP_S, LATER_S = 2.0, 2.02
STREET, EVERY_S = ("street", 0, "wide", 2.0), 0.2
"""Traffic, one of the training seeds, sensors, length; from scan to scan."""
PLACES = np.array([[12.0, 1.0, 0.8], [20.0, -4.0, 0.85], [28.0, 5.0, 0.8], [15.0, 3.5, 0.85]])
SIZES = np.array([[4.4, 1.8, 1.6], [0.5, 0.6, 1.7], [4.4, 1.8, 1.6], [1.8, 0.6, 1.7]])
KINDS = np.array([Category.CAR, Category.PEDESTRIAN, Category.CAR, Category.CYCLIST], np.int8)

Moment = tuple[Detections | None, ImageDetections | None]


@lru_cache(maxsize=1)
def scene() -> tuple[Detections, ImageDetections]:
    """Return two cars, a cyclist and a pedestrian as both sensors find them."""
    lidar = Detections(PLACES, SIZES, np.zeros(4), KINDS, np.full(4, 0.8), "ego", STAMP_S)
    boxes, _ = projected_boxes(lidar, LOOK)
    return lidar, ImageDetections(boxes, KINDS, np.full(4, 0.9), LATER_S)


def moments() -> list[Moment]:
    """Return what may come: both sensors, one, none of one's objects, nothing at all."""
    lidar, camera = scene()
    return [
        (lidar, camera), (lidar, None), (None, camera), (Detections.empty(STAMP_S), camera),
        (lidar, nothing_seen(LATER_S)), (Detections.empty(STAMP_S), nothing_seen(LATER_S)),
    ]  # fmt: skip


def fused(plugin: Plugin[Any], fusion: Any, moment: Moment) -> FusedDetections:
    """Call fuse; an answer that is not what the contract says is a fault."""
    lidar, camera = moment
    found = guarded(plugin.spec, fusion.fuse, lidar, camera, LOOK)
    if not isinstance(found, FusedDetections):
        name = type(found).__name__
        raise PromiseError(f"fuse returned {name}, not roadscope.core.fused.FusedDetections")
    stamp_s = lidar.stamp_s if lidar is not None else LATER_S
    if abs(found.stamp_s - stamp_s) > STAMP_TOLERANCE_S:
        raise PromiseError(
            f"targets are stamped {round(found.stamp_s, 6)} s, expected {round(stamp_s, 6)} s: "
            "the LiDAR's stamp, or the camera's without one"
        )
    for name in ("centres", "scores", "image_boxes", "masses"):
        if not np.isfinite(getattr(found, name)).all():
            raise PromiseError(f"{name} must be finite")
    return found


def answers(plugin: Plugin[Any]) -> str:
    """Look at what comes back where both sensors see the same four."""
    found = fused(plugin, begun(plugin), scene())
    both = int((found.by_lidar & found.by_camera).sum())
    return f"{len(found)} targets of 4, {both} of both sensors"


def sensors_fail(plugin: Plugin[Any]) -> str:
    """Look at what comes back with one sensor or none of its objects."""
    fusion = begun(plugin)
    for moment in moments():
        found = fused(plugin, fusion, moment)
        lidar, camera = moment
        if not len(lidar or ()) and found.by_lidar.any():
            raise PromiseError("targets that LiDAR is said to have found, without any of its own")
        if not len(camera or ()) and found.by_camera.any():
            raise PromiseError("targets that the camera is said to have found, which found nothing")
        if not len(lidar or ()) and not len(camera or ()) and len(found):
            raise PromiseError(f"{len(found)} targets although neither sensor found anything")
    return ""


def told(plugin: Plugin[Any], fusion: Any) -> list[FusedDetections]:
    """Fuse all moments."""
    return [fused(plugin, fusion, moment) for moment in moments()]


def order(plugin: Plugin[Any]) -> str:
    """Look at whether the order of detections matters."""
    lidar, camera = scene()
    back = np.arange(len(lidar))[::-1]
    turned = ImageDetections(
        camera.boxes[back], camera.categories[back], camera.scores[back], camera.stamp_s
    )
    one = fused(plugin, begun(plugin), (lidar, camera))
    other = fused(plugin, begun(plugin), (lidar.select(back), turned))
    if len(one) != len(other) or not np.allclose(
        np.sort(one.distances_m), np.sort(other.distances_m)
    ):
        raise PromiseError("the same detections in another order give other targets")
    return ""


def two_seconds(plugin: Plugin[Any]) -> str:
    """Join what imitations of both sensors find in a street; how well is remarked."""
    from roadscope.benchmarks.jobs.fusion_job import moment_scores

    scores = moment_scores(joined(plugin.spec))
    return (
        f"detection rate {scores['detection_rate'].value:.2f} with "
        f"{scores['false_alarms'].value:.1f} false alarms a scan in a street, "
        f"{scores['call_p50_ms'].value:.2g} ms a scan"
    )


def joined(spec: str) -> Moments:
    """Return what a fusion makes of the street."""
    from roadscope.benchmarks.eligibility import Eligibility
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.jobs.fused import FusedSpec, fuse

    given = FusedSpec(lidar="noisy-misses", camera="noisy-camera", fusion=spec)
    return fuse(given, Episode(*STREET), Eligibility(), EVERY_S)


@cache
def street_ready() -> None:
    """Drive, sense and join the street without the plug-in, which compiles our part."""
    joined("union")


PROMISES = (
    *begins("fuse", having("fuse", "lidar", "camera", "projection")),
    Promise("answers with targets of that moment", answers),
    Promise("goes on with one sensor, and finds nothing of nothing", sensors_fail),
    leaving_alone(fused, moments, "fuse changed the detections it was given"),
    *settled(told, "detections", "targets"),
    Promise("the order of detections is irrelevant", order),
    Promise("joins two seconds of a street", two_seconds, street_ready),
)
