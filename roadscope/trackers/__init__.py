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
    summaries={
        "nearest": "Nearest association, constant velocity (Lu 2018).",
        "nearest-q": "Likewise, with process noise.",
        "nearest-q-confirmed": "Likewise, confirmed after three hits: the one to take.",
    },
)

__all__ = ["TRACKERS", "Tracker"]
