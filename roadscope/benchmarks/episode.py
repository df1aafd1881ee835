"""One stretch of traffic seen by one rig; the traffic is recorded once and kept."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from roadscope.benchmarks.cache import cache_dir, kept
from roadscope.benchmarks.fingerprint import fingerprint, sensing_hash, timeline_hash
from roadscope.core import Frame, Truth
from roadscope.core.names import unknown
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.traffic.timeline import Timeline

if TYPE_CHECKING:
    from roadscope.envs.sensors.sensing import Sensing

LONGEST_S = 3600.0
"""Longest episode; its traffic alone takes about twelve minutes to record. Chosen by hand."""
KEPT_BYTES = 128_000_000
BYTES_PER_RETURN = 40
SCAN_ARRAYS = ("points", "intensity", "ring", "column", "time_offset_s")


@dataclass(frozen=True, slots=True)
class Episode:
    """What decides every byte that an entry gets to see.

    scenario: a name of `roadscope.envs.traffic.scenarios.SCENARIOS`.
    rig: a name of `roadscope.envs.sensors.rigs.RIGS` or a path to a TOML file.
    duration_s: None: as long as the scenario says.
    weather: a name of `roadscope.envs.sensors.weather.WEATHERS`; the traffic does not know it.
    light: a name of `roadscope.envs.imaging.light.LIGHTS`; scans do not know it.
    faults: such as `fog:3`, of `roadscope.envs.sensors.faults.FAULTS`; the traffic knows none.
    """

    scenario: str
    seed: int
    rig: str
    duration_s: float | None = None
    weather: str = "clear"
    light: str = "day"
    faults: tuple[str, ...] = ()

    @property
    def condition(self) -> str:
        """Weather, light and faults in one line: `clear`, `rain-3`, `fog:3 + night:2`."""
        parts = [self.weather] if self.weather != "clear" else []
        parts += [self.light] if self.light != "day" else []
        return " + ".join([*parts, *self.faults]) or "clear"

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
        from roadscope.envs.sensors.weather import weather

        # Without faults the hash is as it was before there were any.
        faulty = {"faults": fingerprint(faults_of(self.faults))} if self.faults else {}
        return {
            **self.traffic_spec(),
            "sensing": sensing_hash(self.scenario),
            "rig": fingerprint(rig(self.rig)),
            "weather": fingerprint(weather(self.weather)),
            "light": self.light,
            **faulty,
        }


def timeline_path(episode: Episode) -> Path:
    """Return where the traffic of an episode is kept."""
    key = fingerprint(episode.traffic_spec())
    return cache_dir() / "timelines" / f"{episode.scenario}-{episode.seed}-{key}.cache"


def timeline_of(episode: Episode) -> Timeline:
    """Read the traffic of an episode, or record and keep it."""
    return kept(timeline_path(episode), Timeline.load, partial(record_timeline, episode))


def record_timeline(episode: Episode) -> Timeline:
    """Record the traffic of an episode."""
    from roadscope.envs.traffic.scenarios import record

    return record(episode.scenario, episode.seed, episode.duration_s)


def sensing_of(episode: Episode, carrier: Rig | None = None) -> Sensing:
    """Return what senses an episode; carrier: in place of its rig."""
    from roadscope.envs.sensors.rigs import rig
    from roadscope.envs.sensors.sensing import Sensing

    # Without a name the light is that of some day too, and a fault may make it night.
    light = None if episode.light == "day" else episode.light
    return Sensing(
        rig(episode.rig) if carrier is None else carrier,
        episode.seed,
        weather=episode.weather,
        light=light,
        faults=episode.faults,
    )


def sensed(episode: Episode) -> Iterator[tuple[Frame, Truth]]:
    """Sense an episode's scans from its traffic: every time the same bytes, in arrays of one's own.

    A camera of the rig stays shut.
    """
    from roadscope.envs.sensors.rigs import rig

    timeline, sensors = timeline_of(episode), replace(rig(episode.rig), camera=None)
    spec = sensors.lidar.spec
    scans = (timeline.end_s - timeline.start_s) / spec.period_s
    if scans * spec.beams * spec.columns * BYTES_PER_RETURN > KEPT_BYTES:
        yield from sensing_of(episode, sensors).whole(timeline)
        return
    for frame, truth in _kept(episode, fingerprint(episode.spec())):
        yield _copied(frame), truth


@lru_cache(maxsize=1)
def _kept(episode: Episode, key: str) -> tuple[tuple[Frame, Truth], ...]:
    """Keep the last episode: the next job of a worker is often another entry on the same.

    key: changes when the rig file that the episode names does.
    """
    from roadscope.envs.sensors.rigs import rig

    timeline, sensors = timeline_of(episode), replace(rig(episode.rig), camera=None)
    return tuple(sensing_of(episode, sensors).whole(timeline))


def _copied(frame: Frame) -> Frame:
    """Give a plug-in arrays that it may write to without anybody else noticing."""
    scan = frame.lidar
    if scan is None:
        return frame
    arrays = {name: getattr(scan, name).copy() for name in SCAN_ARRAYS}
    motion = frame.previous_from_ego
    own = None if motion is None else replace(motion, matrix=motion.matrix.copy())
    return replace(frame, lidar=replace(scan, **arrays), previous_from_ego=own)


def check_episode(episode: Episode) -> None:
    """Refuse what cannot be sensed.

    That is unknown names, less time than one sweep takes or more than an hour, and a light that no
    camera of the rig would see.
    """
    from roadscope.envs.imaging.light import LIGHTS
    from roadscope.envs.sensors.sensing import check_light
    from roadscope.envs.traffic.scenarios import find

    find(episode.scenario)
    if episode.light not in LIGHTS:
        raise ValueError(unknown("light", episode.light, LIGHTS))
    sensors = sensing_of(episode).rig
    check_light(episode.light, sensors)
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
