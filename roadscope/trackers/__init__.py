"""Trackers by name."""

from roadscope.core import Registry
from roadscope.trackers.api import Tracker

TRACKERS: Registry[Tracker] = Registry(
    "tracker",
    {
        "nearest": "roadscope.trackers.nearest:NearestTracker",
        "nearest-q": "roadscope.trackers.nearest:NearestTracker?acceleration_m_s2=2.0",
        "nearest-q-confirmed": "roadscope.trackers.nearest:NearestTracker"
        "?acceleration_m_s2=2.0&confirm_hits=3",
    },
    group="roadscope.trackers",
)

__all__ = ["TRACKERS", "Tracker"]
