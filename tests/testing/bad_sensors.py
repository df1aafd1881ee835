"""Camera detectors and fusions as a user would bring them, some of them bad."""

import time
from dataclasses import fields, replace

import numpy as np

from roadscope import FUSIONS, Detections, ImageDetections

UnionFusion = FUSIONS.resolve("union").factory


def box(stamp_s, right=600.0):
    return ImageDetections([[10.0, 10.0, right, 90.0]], [0], [0.9], stamp_s)


class Fine:
    """One box wherever there is light."""

    def reset(self): ...

    def detect(self, frame) -> ImageDetections:
        lit = frame.camera.pixels.max() > 8
        boxes = box(frame.stamp_s, 50.0)
        return boxes if lit else ImageDetections(np.empty((0, 4)), [], [], frame.stamp_s)


class Unsaid(Fine):
    def detect(self, frame):
        return box(frame.stamp_s, float(frame.camera.pixels.shape[1]))


class BoxesInSpace(Fine):
    def detect(self, frame) -> ImageDetections:
        return Detections.empty(frame.stamp_s)


class AnHourLate(Fine):
    def detect(self, frame) -> ImageDetections:
        return box(frame.stamp_s + 3600.0)


class SeesInTheDark(Fine):
    def detect(self, frame) -> ImageDetections:
        return box(frame.stamp_s)


class Greyscale(Fine):
    def detect(self, frame) -> ImageDetections:
        return box(frame.stamp_s)


class KeepsTheFirstImage(Fine):
    """Draws boxes as wide as the first image ever was bright on the left."""

    first = None

    def detect(self, frame) -> ImageDetections:
        self.first = self.first or 20.0 + float(frame.camera.pixels[:, :200].mean())
        return box(frame.stamp_s, self.first)


class Raises(Fine):
    def detect(self, frame) -> ImageDetections:
        raise KeyError("what is this")


class Hangs(Fine):
    def detect(self, frame) -> ImageDetections:
        time.sleep(600)


class EndsAll(Fine):
    def detect(self, frame) -> ImageDetections:
        import os

        os._exit(3)


class Mine(UnionFusion):
    """A good one."""


class NeedsBoth(UnionFusion):
    def fuse(self, lidar, camera, projection):
        assert len(camera.boxes) >= 0
        return super().fuse(lidar, camera, projection)


class MakesUp(UnionFusion):
    """Reports its first targets in every later frame without targets."""

    first_fused = None

    def fuse(self, lidar, camera, projection):
        fused = super().fuse(lidar, camera, projection)
        self.first_fused = self.first_fused or fused
        if len(fused):
            return fused
        some = np.ones(len(self.first_fused), bool)
        return replace(self.first_fused, by_lidar=~some, by_camera=some, stamp_s=fused.stamp_s)


class KeepsTheFirstTargets(UnionFusion):
    """Takes a score from the first targets ever."""

    first = None

    def fuse(self, lidar, camera, projection):
        fused = super().fuse(lidar, camera, projection)
        self.first = self.first or float(fused.centres.max()) / 100
        return replace(fused, scores=np.full(len(fused), self.first))


class ReturnsDetections(UnionFusion):
    def fuse(self, lidar, camera, projection):
        return Detections.empty(2.0)


class Unsettled(UnionFusion):
    def fuse(self, lidar, camera, projection):
        fused = super().fuse(lidar, camera, projection)
        return replace(fused, scores=np.random.default_rng().random(len(fused)))


class FindsAQuarter(UnionFusion):
    """Passes on the first quarter of what it gets."""

    def fuse(self, lidar, camera, projection):
        targets = super().fuse(lidar, camera, projection)
        return rows_of(targets, np.arange(len(targets) // 4))


def rows_of(targets, rows):
    names = [field.name for field in fields(targets) if field.name != "stamp_s"]
    return replace(targets, **{name: getattr(targets, name)[rows] for name in names})
