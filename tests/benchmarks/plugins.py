"""Plug-ins as a user would bring them, some of them bad."""

import os
import sys
import time
from pathlib import Path

import numpy as np

from roadscope.core import Detections, Tracks


class Logged:
    """Finds nothing, and writes a line for every episode that it begins."""

    kind = "detector"

    def __init__(self, *, log, wait_s=0.0):
        self.log, self.wait_s = Path(log), wait_s

    def reset(self):
        with self.log.open("a") as file:
            file.write("begun\n")

    def detect(self, frame):
        time.sleep(self.wait_s)
        return Detections.empty(frame.stamp_s)


class Raises:
    def reset(self): ...

    def detect(self, frame):
        raise KeyError("what\nis this")


class ReturnsNonsense:
    def reset(self): ...

    def detect(self, frame):
        return [1, 2, 3]


class ReturnsNan:
    def reset(self): ...

    def detect(self, frame):
        return Detections([[np.nan, 0, 0]], [[4, 2, 1]], [0.0], [0], [1.0], "ego", frame.stamp_s)


class Scribbles:
    """Writes over the scan that it was given."""

    def reset(self): ...

    def detect(self, frame):
        frame.lidar.points[:] = 0
        return Detections.empty(frame.stamp_s)


class Prints:
    def reset(self):
        sys.stdout.write("hello from a plug-in\n")

    def detect(self, frame):
        return Detections.empty(frame.stamp_s)


class LooksAside:
    """Tells of one car, far from the road."""

    def reset(self): ...

    def detect(self, frame):
        car = [[10, 80, 1]], [[4.5, 1.8, 1.5]], [0.0], [0], [1.0]
        return Detections(*car, "ego", frame.stamp_s)


class KeepsTheFirstScan:
    """Tells of a car as far away as the first returns ever were, which no reset changes."""

    first = None

    def reset(self): ...

    def detect(self, frame):
        self.first = self.first or float(np.abs(frame.lidar.points).mean())
        car = [[self.first, 0, 1]], [[4.5, 1.8, 1.5]], [0.0], [0], [1.0]
        return Detections(*car, "ego", frame.stamp_s)


class Late:
    def reset(self): ...

    def detect(self, frame):
        return Detections.empty(frame.stamp_s + 1)


class WithoutReset:
    def detect(self, frame): ...


class Dies:
    def reset(self): ...

    def detect(self, frame):
        os._exit(3)


class EgoFrame:
    """Follows nothing but calls every detection a new track, in the ego frame."""

    def __init__(self):
        self.next = 0

    def reset(self):
        self.next = 0

    def update(self, detections, ego_pose):
        ids = self.next + np.arange(len(detections))
        self.next += len(detections)
        return Tracks.of(detections, ids)
