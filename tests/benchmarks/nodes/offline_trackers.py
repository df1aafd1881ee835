"""Trackers with a second pass, as a user would bring them."""

from dataclasses import replace

import numpy as np

from roadscope import Tracks, TrackState
from roadscope.trackers import NearestTracker


class Online(NearestTracker):
    """Has a second pass, and does not call itself offline."""

    def rescored(self, history):
        return [Tracks.empty(tracks.stamp_s, tracks.frame) for tracks in history]


class Late(Online):
    """Returns nothing, with all frames at hand."""

    offline = True


class Whole(Late):
    """Takes tentative tracks for sure ones."""

    def rescored(self, history):
        sure = [np.full(len(tracks), TrackState.CONFIRMED, np.int8) for tracks in history]
        return [replace(tracks, states=s) for tracks, s in zip(history, sure, strict=True)]


class Slow(Whole):
    """Takes its time for the second pass."""

    def rescored(self, history):
        import time

        time.sleep(0.4)
        return super().rescored(history)


class Short(Late):
    """Returns fewer frames."""

    def rescored(self, history):
        return list(history[1:])


class Nothing(Late):
    """Forgets to return."""

    def rescored(self, history):
        del history


class Swapped(Late):
    """Returns frames in the wrong order."""

    def rescored(self, history):
        return list(history[::-1])
