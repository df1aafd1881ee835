"""What a fusion makes of a LiDAR detector's and a camera detector's answers on one episode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import methodcaller

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensing_of
from roadscope.benchmarks.fingerprint import code_hash, fingerprint, plugin_hash
from roadscope.benchmarks.jobs.camera_job import CameraJob, seen_of
from roadscope.benchmarks.jobs.public import PublicDetections
from roadscope.benchmarks.jobs.stack import EntryError, guarded, timed
from roadscope.benchmarks.metrics.fusion import Targets
from roadscope.benchmarks.oracle import FUSED
from roadscope.benchmarks.perceived import Perceived
from roadscope.benchmarks.seen import Seen
from roadscope.benchmarks.targets import targets_of
from roadscope.core import Detections, ImageDetections, Pose, SpecError
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.core.registry import split_spec
from roadscope.fusion import FUSIONS
from roadscope.fusion.calibration_file import read_calibration
from roadscope.fusion.pairing import ALONE, ClocksApartError, moved_projection, nearest_images

LIDAR_ALONE, CAMERA_ALONE = "LiDAR alone", "camera alone"
CODE = (
    "benchmarks/jobs/fused.py", "benchmarks/targets.py", "fusion/pairing.py",
    "fusion/calibration_file.py",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class FusedSpec:
    """Whose detections are joined, and by what; all are specs.

    calibration: a file of `roadscope calibrate`; empty: what the rig is believed to be.
    """

    lidar: str = "cluster-boxes"
    camera: str = "network"
    fusion: str = "consistent"
    calibration: str = ""

    @staticmethod
    def parse(spec: str) -> FusedSpec:
        """Read `fused?lidar=distance-l-shape&camera=network&fusion=consistent`."""
        name, arguments = split_spec(spec)
        known = FusedSpec.__slots__
        for key in arguments:
            if name != FUSED or key not in known:
                raise SpecError(f"'{spec}': no argument '{key}'; known: {', '.join(known)}")
        return FusedSpec(**{key: str(value) for key, value in arguments.items()})

    def sources(
        self, episode: Episode, eligibility: Eligibility, every_s: float
    ) -> tuple[PublicDetections, CameraJob]:
        """Return whose detections are joined; every_s: from scan to scan."""
        return (
            PublicDetections(self.lidar, episode, eligibility),
            CameraJob(self.camera, self.camera, episode, every_s, scans=True),
        )

    def made_by(self, episode: Episode, eligibility: Eligibility, every_s: float) -> str:
        """Hash everything that the joined detections depend on."""
        lidar, camera = self.sources(episode, eligibility, every_s)
        alone = self.fusion in (LIDAR_ALONE, CAMERA_ALONE)
        plugin = FUSIONS.resolve("union" if alone else self.fusion)
        calibration = read_calibration(self.calibration).matrix if self.calibration else None
        return fingerprint(
            [
                lidar.spec, camera.detections_spec, plugin_hash(plugin), self.fusion,
                calibration, code_hash(*CODE),
            ]
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Moments:
    """Fused detections of some scans of an episode, one after the other.

    rows: (K,) int64, which scans. fused: at the stamps of the scans, ego frame.
    targets: what was to be found. calls_ms: (K,) of the fusion alone.
    """

    rows: np.ndarray
    fused: tuple[FusedDetections, ...]
    targets: tuple[Targets, ...]
    calls_ms: np.ndarray


def fuse(
    spec: FusedSpec, episode: Episode, eligibility: Eligibility, every_s: float = 0.0
) -> Moments:
    """Join the kept detections of both sensors; those that are missing are made and kept.

    every_s: from scan to scan; 0: all of them. A scan is joined with the image whose stamp is
    nearest, moved by what the ego did in between; a black image is none. Without an image, or
    without a scan, fusions are told so.
    """
    lidar, camera = spec.sources(episode, eligibility, every_s)
    perceived, seen = lidar.read(), seen_of(camera)
    rows = scan_rows(episode, len(perceived.truths), every_s)
    views = _views(spec, episode, perceived, seen, rows)
    call = _caller(spec.fusion)
    fused, calls_ms = [], []
    for row, (points, boxes, projection) in zip(rows, views, strict=True):
        stamp_s = perceived.truths[row].stamp_s
        answer, took_ms = (
            (nothing_fused(stamp_s), 0.0)
            if points is None and boxes is None
            else call(points, boxes, projection)
        )
        fused.append(replace(answer, stamp_s=stamp_s))
        calls_ms.append(took_ms)
    targets = _targets(episode, perceived, seen, rows)
    return Moments(rows, tuple(fused), targets, np.array(calls_ms))


def scan_rows(episode: Episode, scans: int, every_s: float) -> np.ndarray:
    """Return (K,) int64, which scans are joined; the first is not, nothing is known before it."""
    from roadscope.envs.sensors.rigs import rig

    period_s = rig(episode.rig).lidar.spec.period_s
    step = max(1, round(every_s / period_s))
    return np.arange(0 if step == 1 else step, scans, step)


View = tuple[Detections | None, ImageDetections | None, Projection]


def _views(
    spec: FusedSpec, episode: Episode, perceived: Perceived, seen: Seen, rows: np.ndarray
) -> list[View]:
    """Pair scans and images by their stamps, in the frames in which the user believes."""
    from roadscope.benchmarks.images import camera_of

    sensing = sensing_of(episode)
    camera = camera_of(sensing.rig)
    pinhole = camera.spec.pinhole
    believed = Projection.of(
        pinhole.intrinsics, sensing.calibration.pose(camera.name), pinhole.width, pinhole.height
    )
    if spec.calibration:
        believed = fitting(read_calibration(spec.calibration), believed, spec.calibration)
    # What a detector makes of a black image says nothing of what is there.
    there = [
        d
        for d, image in zip(seen.detections, seen.rows.tolist(), strict=True)
        if d is not None and sensing.image_lost(image) is None
    ]
    scan_s = np.array([perceived.truths[row].stamp_s for row in rows])
    nearest = _paired(scan_s, np.array([d.stamp_s for d in there]))
    views: list[View] = []
    for row, image in zip(rows.tolist(), nearest.tolist(), strict=True):
        truth = perceived.truths[row]
        boxes = None if image == ALONE or spec.fusion == LIDAR_ALONE else there[image]
        lost = sensing.scan_lost(row) or spec.fusion == CAMERA_ALONE
        points = perceived.detections[row].moved(truth.world_from_ego.inverse(), "ego")
        gap_s = 0.0 if boxes is None else boxes.stamp_s - truth.stamp_s
        views.append((None if lost else points, boxes, _moved(believed, perceived, row, gap_s)))
    return views


def _paired(scan_s: np.ndarray, image_s: np.ndarray) -> np.ndarray:
    try:
        return nearest_images(scan_s, image_s)
    except ClocksApartError:
        # Clocks of an episode agree: the images near these few scans were lost.
        return np.full(len(scan_s), ALONE)


def fitting(given: Projection, rig_s: Projection, path: str) -> Projection:
    """Refuse a calibration for images of another size than the rig's."""
    if (given.width, given.height) != (rig_s.width, rig_s.height):
        raise EntryError(
            f"{path} is for images of {given.width} x {given.height} pixels, the rig's have "
            f"{rig_s.width} x {rig_s.height}"
        )
    return given


def _moved(projection: Projection, perceived: Perceived, row: int, gap_s: float) -> Projection:
    """Move a projection to another moment by the ego's motion, which trackers are told too."""
    truths = perceived.truths
    if len(truths) < 2:
        return projection
    before, now = truths[max(row, 1) - 1], truths[max(row, 1)]
    motion: Pose = before.world_from_ego.inverse() @ now.world_from_ego
    return moved_projection(projection, motion, now.stamp_s - before.stamp_s, gap_s)


def _targets(
    episode: Episode, perceived: Perceived, seen: Seen, rows: np.ndarray
) -> tuple[Targets, ...]:
    """Return what both sensors could find; the image is the nearest one, lost or not."""
    from roadscope.benchmarks.images import projection_of
    from roadscope.envs.sensors.rigs import rig

    true = projection_of(rig(episode.rig))
    image_s = np.array([t.stamp_s for t in seen.truths])
    found = []
    for row in rows.tolist():
        truth = perceived.truths[row]
        image = seen.truths[int(np.abs(image_s - truth.stamp_s).argmin())]
        moved = _moved(true, perceived, row, image.stamp_s - truth.stamp_s)
        found.append(targets_of(truth, image, perceived.parked, moved))
    return tuple(found)


Call = Callable[..., tuple[FusedDetections, float]]


def _caller(spec: str) -> Call:
    """Return what is called with both sensors' detections: the answer, and how many ms."""
    named = "union" if spec in (LIDAR_ALONE, CAMERA_ALONE) else spec
    plugin = guarded(named, lambda: FUSIONS.make(named))
    guarded(named, methodcaller("reset"), plugin)

    def call(
        points: Detections | None, boxes: ImageDetections | None, projection: Projection
    ) -> tuple[FusedDetections, float]:
        answer, took_ms = timed(named, methodcaller("fuse", points, boxes, projection), plugin)
        if not isinstance(answer, FusedDetections):
            raise EntryError(f"{named}: fuse returned {type(answer).__name__}, not FusedDetections")
        return answer, took_ms

    return call


def nothing_fused(stamp_s: float) -> FusedDetections:
    """Return no targets: neither sensor brought anything."""
    none, number, yes = np.empty(0), np.empty(0, np.int64), np.empty(0, bool)
    return FusedDetections(
        np.empty(0, np.int8), none, yes, yes, yes, np.empty((0, 3)), np.empty((0, 3)), none, none,
        number, yes, np.empty((0, 4)), np.empty((0, 4)), stamp_s,
    )  # fmt: skip


def perceive_fused(detector: str, episode: Episode, eligibility: Eligibility) -> Perceived:
    """Return the joined detections of all scans as a detector's; targets without a place are out.

    Its time is that of both detectors and of the fusion.
    """
    spec = FusedSpec.parse(detector)
    lidar, camera = spec.sources(episode, eligibility, 0.0)
    perceived, seen = lidar.read(), seen_of(camera)
    moments = fuse(spec, episode, eligibility)
    looked_ms = float(seen.calls_ms.sum()) / max(len(moments.rows), 1)
    return replace(
        perceived,
        detections=tuple(
            fused.detections().moved(truth.world_from_ego, "world")
            for fused, truth in zip(moments.fused, perceived.truths, strict=True)
        ),
        calls_ms=perceived.calls_ms + moments.calls_ms + looked_ms,
    )
