"""A tracker that keeps its promises, and others that each break one."""

import os
import sys
import time
from dataclasses import replace

import numpy as np
from scipy.spatial.distance import cdist

from roadscope import Detections, Tracks
from roadscope.trackers import assign_greedily, in_world


class Good:
    """The nearest detection within a gate takes the id over; the ids go on after a reset."""

    def __init__(self, *, gate_m=3.0):
        self.gate_m, self.next_id = gate_m, 0
        self.reset()

    def reset(self):
        self.centres, self.ids = np.empty((0, 3)), np.empty(0, np.int64)

    def update(self, detections, ego_pose):
        if ego_pose is not None:
            detections = detections.moved(ego_pose, "world")
        distances_m = np.linalg.norm(detections.centres[:, None] - self.centres, axis=2)
        ids = np.full(len(detections), -1)
        for row, column in np.argwhere(distances_m < self.gate_m):
            if distances_m[row, column] == distances_m[row].min() == distances_m[:, column].min():
                ids[row] = self.ids[column]
        new = ids < 0
        ids[new] = self.next_id + np.arange(new.sum())
        self.next_id += int(new.sum())
        self.centres, self.ids = detections.centres, ids
        return Tracks.of(detections, ids)


class WrongType(Good):
    def update(self, detections, ego_pose):
        return detections


class ReturnsNan(Good):
    def update(self, detections, ego_pose):
        tracks = super().update(detections, ego_pose)
        return replace(tracks, centres=tracks.centres * np.nan)


class WrongStamp(Good):
    def update(self, detections, ego_pose):
        tracks = super().update(detections, ego_pose)
        return Tracks.empty(tracks.stamp_s + 1)


class WorldWithoutPose(Good):
    def update(self, detections, ego_pose):
        return Tracks.empty(detections.stamp_s, "world")


class Invents(Good):
    kind = "tracker"

    def update(self, detections, ego_pose):
        if len(detections):
            return super().update(detections, ego_pose)
        some = Detections([[5, 0, 1]], [[4, 2, 1]], [0.0], [0], [1.0], "ego", detections.stamp_s)
        return Tracks.of(some, np.array([999_999]))


class NumbersRows(Good):
    """The number of a row is the id."""

    def update(self, detections, ego_pose):
        tracks = super().update(detections, ego_pose)
        return replace(tracks, ids=np.arange(len(tracks)))


class ReusesIds(Good):
    """Numbers the detections of every frame anew."""

    def update(self, detections, ego_pose):
        self.next_id = 0
        self.reset()
        return super().update(detections, ego_pose)


class ChangesIds(Good):
    def update(self, detections, ego_pose):
        self.reset()
        return super().update(detections, ego_pose)


class DependsOnOrder(Good):
    """Leaves out the first detection."""

    def update(self, detections, ego_pose):
        selected = np.arange(len(detections)) >= (len(detections) > 2)
        return super().update(detections.select(selected), ego_pose)


class MutatesInput(Good):
    def update(self, detections, ego_pose):
        tracks = super().update(detections, ego_pose)
        detections.centres[:] += 1.0
        return tracks


class Random(Good):
    def update(self, detections, ego_pose):
        selected = np.random.default_rng().random(len(detections)) < 0.5
        return super().update(detections.select(selected | (len(detections) < 2)), ego_pose)


class Remembers(Good):
    """Says nothing in the first five updates, and reset does not count them anew."""

    updates = 0

    def update(self, detections, ego_pose):
        self.updates += 1
        tracks = super().update(detections, ego_pose)
        return tracks if self.updates > 5 else Tracks.empty(tracks.stamp_s, tracks.frame)


class EmptyReset:
    """The README's tracker, begun when it is made; reset does nothing."""

    def __init__(self):
        self.places, self.ids, self.count = np.empty((0, 2)), np.empty(0, int), 0

    def reset(self):
        pass

    def update(self, detections, ego_pose):
        world_detections = in_world(detections, ego_pose)
        old, new = assign_greedily(cdist(self.places, world_detections.centres[:, :2]), 3.0)
        ids = self.count + np.arange(len(world_detections))
        ids[new] = self.ids[old]
        self.places, self.ids, self.count = (
            world_detections.centres[:, :2],
            ids,
            self.count + len(world_detections),
        )
        return Tracks.of(world_detections, ids)


class KeepsTracks(EmptyReset):
    """Counts anew after a reset, yet keeps the tracks."""

    def reset(self):
        self.count = 0


class RenamesTracks(EmptyReset):
    """Keeps the tracks at a reset, under new names in the same order."""

    def reset(self):
        self.ids, self.count = self.ids + 10_000, self.count + 10_000


class KeepsOne(EmptyReset):
    """Keeps the last track at a reset."""

    def reset(self):
        self.places, self.ids = self.places[-1:], self.ids[-1:]


class KeepsTheClock(Good):
    """Refuses stamps before those of the episode before."""

    last_s = -1.0

    def update(self, detections, ego_pose):
        if detections.stamp_s <= self.last_s:
            raise ValueError("stamps must increase")
        self.last_s = detections.stamp_s
        return super().update(detections, ego_pose)


class CountsAnew(Good):
    """The ids begin anew after a reset."""

    def reset(self):
        super().reset()
        self.next_id = 0


class RandomNames(CountsAnew):
    """No name tells which track was there first."""

    def reset(self):
        super().reset()
        self.names = np.random.default_rng().permutation(2**20)[:1000]

    def update(self, detections, ego_pose):
        tracks = super().update(detections, ego_pose)
        return replace(tracks, ids=self.names[tracks.ids])


class IgnoresThePose(Good):
    """Follows in the ego frame and calls it world."""

    def update(self, detections, ego_pose):
        tracks = super().update(detections, None)
        return tracks if ego_pose is None else replace(tracks, frame="world")


class Raises(Good):
    def update(self, detections, ego_pose):
        raise KeyError("what is this")


class PrintsAndRaises(Good):
    def update(self, detections, ego_pose):
        sys.stdout.write("hello from a tracker\n")
        raise KeyError("what is this")


class PrintsAndAnswersNan(ReturnsNan):
    def update(self, detections, ego_pose):
        sys.stdout.write("hello from a tracker\n")
        return super().update(detections, ego_pose)


class RaisesWhenMade(Good):
    def __init__(self):
        raise OSError("no weights")


class NeedsArguments(Good):
    def __init__(self, gate_m):
        super().__init__(gate_m=gate_m)


class Positional(Good):
    def __init__(self, gate_m=2.0):
        super().__init__(gate_m=gate_m)


class WithoutReset:
    def update(self, detections, ego_pose): ...


class WithoutPose(Good):
    def update(self, detections): ...


class FollowsNothing(Good):
    def update(self, detections, ego_pose):
        return Tracks.empty(detections.stamp_s)


class Hangs(Good):
    def update(self, detections, ego_pose):
        time.sleep(3600)


class Ends(Good):
    def update(self, detections, ego_pose):
        os._exit(7)


class Prints(Good):
    def update(self, detections, ego_pose):
        sys.stdout.write("hello from a tracker\n")
        return super().update(detections, ego_pose)


class Online(Good):
    """Has a second pass, and does not call itself offline."""

    def rescored(self, history):
        return history


class Late(Online):
    """An offline tracker that keeps its promises."""

    offline = True


class LateWithout(Good):
    offline = True


class LateNothing(Late):
    def rescored(self, history):
        del history


class LateShort(Late):
    def rescored(self, history):
        return history[1:]


class LateSwapped(Late):
    def rescored(self, history):
        return history[::-1]


class LateScribbles(Late):
    def rescored(self, history):
        for tracks in history:
            tracks.centres.setflags(write=True)
            tracks.centres[:] = 0
        return history


class LateCounts(Late):
    def rescored(self, history):
        self.called_before = not getattr(self, "called_before", False)
        return history if self.called_before else [replace(h, ids=h.ids[::-1]) for h in history]


class LateForgets(Late):
    def rescored(self, history):
        self.reset()
        return history


class SaysItsKind(Good):
    kind = "tracker"


class Neither:
    """No plug-in at all."""
