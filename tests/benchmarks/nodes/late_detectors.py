"""Detectors that answer late, or for frames that there were not."""

import numpy as np

from roadscope import Detections


class LateBy:
    """Says in each frame that something stood at the ego's origin some frames ago."""

    def __init__(self, *, frames=2, until=99):
        self.frames, self.until = frames, until

    def reset(self):
        self.stamps = []

    def detect(self, frame):
        self.stamps.append(frame.stamp_s)
        if not self.frames < len(self.stamps) <= self.until:
            return Detections.empty(frame.stamp_s)
        return self.at(self.stamps[-1 - self.frames])

    def at(self, stamp_s):
        size = np.array([[4.5, 1.8, 1.5]])
        kind = np.zeros(1, np.int8)
        return Detections(np.zeros((1, 3)), size, np.zeros(1), kind, np.ones(1), "ego", stamp_s)


class Twice(LateBy):
    """Answers the first frame again and again."""

    def detect(self, frame):
        self.stamps.append(frame.stamp_s)
        return self.at(self.stamps[0])


class Unknown(LateBy):
    """Answers for a moment at which there was no frame."""

    def detect(self, frame):
        return self.at(frame.stamp_s - 0.01)
