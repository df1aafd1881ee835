"""The recorded traffic of an episode, and nodes that depend on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from roadscope.benchmarks.episode import Episode, record_timeline, timeline_path, traffic_of
from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.loop import RunOptions
from roadscope.envs.traffic.timeline import Timeline


@dataclass(frozen=True)
class TrafficNode(Node):
    """Recorded traffic; episodes that differ only in weather, light, faults or rig share it."""

    episode: Episode

    stage = "traffic"
    folder = "timelines"
    record = Timeline
    recomputed_if_fresh = False

    @staticmethod
    def of(episode: Episode) -> TrafficNode:
        """Return the node of an episode's traffic."""
        return TrafficNode(traffic_of(episode))

    def content(self) -> Mapping[str, Any]:
        """Return what the traffic depends on."""
        return self.episode.traffic_spec()

    @property
    def path(self) -> Path:
        """Its file in the cache."""
        return timeline_path(self.episode)

    def compute(self, options: RunOptions) -> Timeline:
        """Record the traffic."""
        return record_timeline(self.episode)


class SensingNode(Node):
    """A node whose plug-in gets what is sensed in an episode."""

    episode: Episode

    def sources(self) -> tuple[Node, ...]:
        """Return the traffic; recorded data have none."""
        return (TrafficNode.of(self.episode),) if self.episode.simulated else ()
