"""Episodes: the traffic of one scenario and seed, sensed by one rig.

The traffic is recorded once and kept; scans are sensed again, the same bytes every time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial, singledispatch
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar

from roadscope.benchmarks.cache import cache_dir, read_or_make
from roadscope.benchmarks.fingerprints import fingerprint, sensing_hash, timeline_hash
from roadscope.core import Frame, Truth
from roadscope.core.names import unknown
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.traffic.timeline import Timeline

if TYPE_CHECKING:
    from roadscope.envs.sensors.sensing import Sensing

LONGEST_S = 3600.0
"""Longest episode; its traffic alone takes about twelve minutes to record. Chosen by hand."""
BYTES_PER_RETURN = 40
"""Memory of a return in a scan and in its truth."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Episode:
    """The settings that decide every byte that an entry gets.

    scenario: a name of `roadscope.envs.traffic.scenarios.SCENARIOS`.
    rig: a name of `roadscope.envs.sensors.rigs.RIGS` or a path to a TOML file.
    duration_s: length; None: that of the scenario.
    weather: a name of `roadscope.envs.sensors.weathers.WEATHERS`; no effect on traffic.
    light: a name of `roadscope.envs.imaging.light.LIGHTS`; no effect on scans.
    faults: such as `fog:3`, of `roadscope.envs.sensors.faults.FAULTS`; no effect on traffic.
    """

    scenario: str
    seed: int
    rig: str
    duration_s: float | None = None
    weather: str = "clear"
    light: str = "day"
    faults: tuple[str, ...] = ()

    simulated: ClassVar[bool] = True
    """Whether traffic is simulated and sensed; episodes of recorded data have neither."""

    @property
    def condition(self) -> str:
        """Weather, light and faults in one line: `clear`, `rain-3`, `fog:3 + night:2`."""
        parts = [self.weather] if self.weather != "clear" else []
        parts += [self.light] if self.light != "day" else []
        return " + ".join([*parts, *self.faults]) or "clear"

    def check(self) -> None:
        """Do nothing; episodes of recorded data read their files here, before anything runs."""

    def traffic_spec(self) -> dict[str, object]:
        """Return what the traffic depends on."""
        from roadscope.envs.traffic.scenarios import find

        return {
            "scenario": fingerprint(find(self.scenario)),
            "name": self.scenario,
            "seed": self.seed,
            "duration_s": self.duration_s,
            "code": timeline_hash(self.scenario),
        }

    def spec(self) -> dict[str, object]:
        """Return what frames and truth depend on."""
        from roadscope.envs.sensors.faults import faults_of
        from roadscope.envs.sensors.rigs import rig
        from roadscope.envs.sensors.weathers import weather

        # Without faults the key is left out: the hash is that from before there were faults.
        faulty = {"faults": fingerprint(faults_of(self.faults))} if self.faults else {}
        return {
            **self.traffic_spec(),
            "sensing": sensing_hash(self.scenario),
            "rig": fingerprint(rig(self.rig)),
            "weather": fingerprint(weather(self.weather)),
            "light": self.light,
            **faulty,
        }


def traffic_of(episode: Episode) -> Episode:
    """Return the episode with what its traffic depends on alone: scenario, seed and length."""
    return Episode(episode.scenario, episode.seed, "", episode.duration_s)


def timeline_path(episode: Episode) -> Path:
    """Return where the traffic of an episode is kept."""
    key = fingerprint(episode.traffic_spec())
    return cache_dir() / "timelines" / f"{episode.scenario}-{episode.seed}-{key}.cache"


def timeline_of(episode: Episode) -> Timeline:
    """Read the traffic of an episode, or record and keep it."""
    return read_or_make(timeline_path(episode), Timeline.load, partial(record_timeline, episode))


def record_timeline(episode: Episode) -> Timeline:
    """Record the traffic of an episode."""
    from roadscope.envs.traffic.scenarios import record

    return record(episode.scenario, episode.seed, episode.duration_s)


def sensing_of(episode: Episode, rig: Rig | None = None) -> Sensing:
    """Return the sensing of an episode. rig: in place of the episode's."""
    from roadscope.envs.sensors.rigs import rig as rig_of
    from roadscope.envs.sensors.sensing import Sensing

    # None is daylight too, and unlike a named light it lets a fault make it night.
    light = None if episode.light == "day" else episode.light
    return Sensing(
        rig_of(episode.rig) if rig is None else rig,
        episode.seed,
        weather=episode.weather,
        light=light,
        faults=episode.faults,
    )


class LastEpisode(Generic[T]):
    """Remembers what was sensed of the last episode; a worker's next job is often on it too."""

    def __init__(self, most_bytes: int) -> None:
        """Take the size of the largest episode that is remembered, bytes."""
        self._most_bytes = most_bytes
        self._key: object = None
        self._items: tuple[T, ...] = ()

    def get(self, key: object, size_bytes: float, sense: Callable[[], Iterable[T]]) -> Iterable[T]:
        """Return what `sense` returns, from memory if the key is that of the last call."""
        if size_bytes > self._most_bytes:
            return sense()
        if key != self._key:
            self._key, self._items = None, ()
            self._items = tuple(sense())
            self._key = key
        return self._items


_last_scans = LastEpisode[tuple[Frame, Truth]](most_bytes=600_000_000)


@singledispatch
def sensed(episode: Episode) -> Iterator[tuple[Frame, Truth]]:
    """Yield the frames with scans of an episode and their truth; a camera is not used.

    They are the same bytes every time, in arrays that a plug-in may write to.
    """
    from roadscope.envs.sensors.rigs import rig

    timeline, sensors = timeline_of(episode), replace(rig(episode.rig), camera=None)
    lidar = sensors.lidar.spec
    scans = (timeline.end_s - timeline.start_s) / lidar.period_s
    size_bytes = scans * lidar.beams * lidar.columns * BYTES_PER_RETURN
    # The episode's spec is part of the key, as the content of its rig file may have changed.
    key, sense = fingerprint(episode.spec()), partial(sensing_of(episode, sensors).whole, timeline)
    for frame, truth in _last_scans.get(key, size_bytes, sense):
        yield deepcopy(frame), truth


def check_episode(episode: Episode) -> None:
    """Raise `ValueError` for an episode that cannot be sensed.

    That is: unknown names, less time than one sweep or more than an hour, a light for a rig
    without a camera, and a camera on uneven ground.
    """
    from roadscope.envs.imaging.light import LIGHTS
    from roadscope.envs.sensors.sensing import check_light
    from roadscope.envs.traffic.scenarios import find

    scenario = find(episode.scenario)
    if episode.light not in LIGHTS:
        raise ValueError(unknown("light", episode.light, LIGHTS))
    sensors = sensing_of(episode).rig
    check_light(episode.light, sensors)
    if scenario.uneven and sensors.camera is not None:
        raise ValueError(
            f"images show level ground only: scenario '{scenario.name}' is uneven, and rig "
            f"'{episode.rig}' has a camera; its LiDAR alone is, for example, rig "
            f"'{sensors.lidar.spec.name}'"
        )
    mount = sensors.lidar
    least_s = mount.stamp_s(0) + mount.spec.sweep_s / 2
    duration_s = episode.duration_s
    if duration_s is None:
        return
    if not duration_s >= least_s:
        raise ValueError(
            f"an episode lasts at least {least_s:.3g} s, one sweep of '{episode.rig}', "
            f"got {duration_s:g} s"
        )
    if duration_s > LONGEST_S:
        raise ValueError(f"an episode lasts at most {LONGEST_S:g} s, an hour, got {duration_s:g} s")
