"""Traffic scenarios by name, recorded to timelines."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.names import unknown
from roadscope.envs.traffic.terrain import terrain_of
from roadscope.envs.traffic.timeline import Timeline

if TYPE_CHECKING:
    from roadscope.envs.traffic.simulated import Stage

LEAST_OBJECTS = 5
NEAR_M = 60.0
MOST_CRASHED = 0.05
"""Traffic is accepted if `LEAST_OBJECTS` are within `NEAR_M` of the ego at every instant, and if at
most the share `MOST_CRASHED` of all actors crashes; chosen by hand."""
TRIES = 10
"""Most sub-seeds that are tried until traffic is accepted."""
_GROUND_SALT = 0x47726E64
"""Keeps this stream of random numbers apart from others of the same seed."""


class ScenarioError(ValueError):
    """A scenario is unknown or could not be recorded."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """Traffic that can be recorded.

    description: one line for lists.
    style: roadside style, a name of `roadside.STYLES`.
    builder: `module:function`, loaded on use; makes a `Stage` from a generator, or for a
        scripted scenario a `Timeline` from name, seed and duration.
    duration_s: default length of a recording.
    scripted: whether all motion is written down; such scenarios are exempt from `accept`.
    unseen: whether vehicles have the shapes of `mix.UNSEEN`, on which no detector was trained.
    uneven: whether the ground is the terrain of the scenario's name in `terrain.TERRAINS`.
    adversarial: whether others cut in ahead of the ego or step out in front of it on purpose.
    """

    name: str
    description: str
    style: str
    builder: str
    duration_s: float = 20.0
    scripted: bool = False
    unseen: bool = False
    uneven: bool = False
    adversarial: bool = False

    def build(self) -> Callable[..., Any]:
        """Return the builder."""
        module, _, function = self.builder.partition(":")
        build: Callable[..., Any] = getattr(importlib.import_module(module), function)
        return build


@dataclass(frozen=True, slots=True)
class Acceptance:
    """Whether traffic is dense and safe enough to be sensed.

    least_objects: fewest objects within `NEAR_M` of the ego at any instant.
    crashed_share: share of the actors, the ego included, that crash; people are not counted as
        crashed.
    accepted: at least `LEAST_OBJECTS` at every instant, and at most `MOST_CRASHED` crashed.
    """

    least_objects: int
    crashed_share: float
    accepted: bool


def _simulated(
    name: str, style: str, description: str, duration_s: float = 20.0, *, unseen: bool = False
) -> Scenario:
    """Return a scenario that is built by the function of its name in `simulated`."""
    function = name.removeprefix("unseen-").replace("-", "_")
    builder = f"{_PACKAGE}.simulated:{function}"
    return Scenario(name, description, style, builder, duration_s, unseen=unseen)


def _adversarial(name: str, style: str, description: str) -> Scenario:
    """Return a simulated scenario in which others act against the ego."""
    return replace(_simulated(name, style, description), adversarial=True)


def _uneven(name: str, traffic: str, style: str, description: str) -> Scenario:
    """Return a scenario with the traffic of a function in `simulated` on its own terrain."""
    builder = f"{_PACKAGE}.simulated:{traffic}"
    return Scenario(name, description, style, builder, uneven=True)


def _scripted(name: str, style: str, duration_s: float, description: str) -> Scenario:
    """Return a scenario built by the function of its name in `scripts`, or one of Lu 2018."""
    lu2018 = name.startswith("lu2018-")
    place = "lu2018:play_script" if lu2018 else f"scripts:{name.replace('-', '_')}"
    return Scenario(name, description, style, f"{_PACKAGE}.{place}", duration_s, scripted=True)


_PACKAGE = "roadscope.envs.traffic"
_SCENARIOS = (
    _simulated(
        "motorway",
        "motorway",
        "Four lanes at about 25 m/s, from motorcycles to articulated lorries.",
    ),
    _simulated("dense-motorway", "motorway", "Four full lanes at about 12 m/s."),
    _simulated("merge", "motorway", "Vehicles from a ramp join two lanes of a motorway."),
    _simulated(
        "roundabout", "urban", "Four roads meet at a roundabout; drivers that enter give way."
    ),
    _simulated(
        "intersection", "urban", "A crossing in town; drivers wait until their path is free."
    ),
    _simulated("racetrack", "bare", "Two lanes in a winding loop."),
    _simulated(
        "racetrack-loop",
        "motorway",
        "A whole lap of the racetrack between rails, walls and trees.",
        70.0,
    ),
    _simulated("two-way", "urban", "A road with oncoming traffic."),
    _simulated("parking-lot", "campus", "A car park with slow traffic past standing cars."),
    _simulated(
        "waiting",
        "urban",
        "The ego waits at a crossing in town while others cross in both directions.",
    ),
    _simulated(
        "street", "town", "A street in town: people walk, wait, cross and ride beside the traffic."
    ),
    _simulated("town-crossing", "town", "A crossing in town with people on foot and on bicycles."),
    _adversarial(
        "cutting-in", "motorway", "Drivers cut in closely ahead of the ego, again and again."
    ),
    _adversarial("stepping-out", "town", "A street where people step out in front of the ego."),
    _simulated(
        "unseen-motorway",
        "motorway",
        "As motorway, with flatbeds, tankers and other bodies that no detector was trained on.",
        unseen=True,
    ),
    _simulated(
        "unseen-street",
        "town",
        "As street, with flatbeds, tankers and other bodies that no detector was trained on.",
        unseen=True,
    ),
    _uneven(
        "hills",
        "two_way",
        "urban",
        "As two-way, over crests and through sags, on slopes of mostly 10 %, rarely over 15 %.",
    ),
    _uneven(
        "camber",
        "motorway",
        "motorway",
        "As motorway, on a road that leans or has a crown, between banks and ditches.",
    ),
    _uneven(
        "bumps", "street", "town", "As street, over humps of 6 to 12 cm, between raised pavements."
    ),
    _scripted(
        "cut-ins", "motorway", 12.0, "Vehicles cut in and change lanes closely ahead of the ego."
    ),
    _scripted(
        "long-occlusion",
        "motorway",
        12.0,
        "A lorry beside the ego hides overtaking and oncoming vehicles.",
    ),
    _scripted(
        "convoy-pull-away",
        "urban",
        40.0,
        "The ego stands among lorries and pulls away with all of them.",
    ),
    _scripted(
        "platoon", "motorway", 30.0, "The ego drives in dense traffic that moves along with it."
    ),
    _scripted("cold-start", "motorway", 25.0, "The first scan is taken at 15 to 35 m/s."),
    _scripted(
        "standing-in-traffic", "urban", 30.0, "The ego stands while others pass on both sides."
    ),
    _scripted(
        "standing-barriers",
        "barriers",
        30.0,
        "The ego stands between noise walls while others pass.",
    ),
    _scripted("barriers", "barriers", 30.0, "A motorway between long smooth noise walls."),
    _scripted("tunnel", "tunnel", 30.0, "A tunnel; only its lamps and niches distinguish places."),
    _scripted("stop-and-go", "motorway", 60.0, "Waves of standstill in a jam."),
    _scripted(
        "empty-motorway",
        "motorway",
        30.0,
        "The ego alone on a motorway, from rest or at speed from the first scan.",
    ),
    _scripted(
        "empty-street",
        "urban",
        30.0,
        "The ego alone in a street with houses, trees and parked cars.",
    ),
    _scripted(
        "lu2018-two-vehicles",
        "campus",
        15.36,
        "Lu 2018, 1: a car stays ahead, another comes and goes on its left.",
    ),
    _scripted(
        "lu2018-occlusion", "campus", 10.56, "Lu 2018, 2: a van cuts in and hides the car ahead."
    ),
    _scripted(
        "lu2018-three-vehicles",
        "campus",
        8.16,
        "Lu 2018, 3: three cars, one falls back out of view.",
    ),
)
SCENARIOS: Mapping[str, Scenario] = MappingProxyType({each.name: each for each in _SCENARIOS})
"""The scenarios by name."""

_SCENARIO_OF_ENVIRONMENT: Mapping[str, str] = MappingProxyType(
    {
        "highway": "motorway",
        "highway-fast": "motorway",
        "highway-dense": "dense-motorway",
        "parking": "parking-lot",
    }
)
"""Environments whose scenario has another name."""


def record(name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Record a scenario; the same name, seed and duration give the same bytes.

    Traffic that is not accepted is drawn again from the next sub-seed; `ScenarioError` names
    the scenario and the seed when none of `TRIES` is accepted.
    """
    scenario = find(name)
    if duration_s is not None and not duration_s > 0:
        raise ScenarioError(f"a duration is a positive number of seconds, got {duration_s}")
    if scenario.scripted:
        timeline: Timeline = scenario.build()(scenario.name, seed, duration_s)
        return timeline
    from roadscope.envs.traffic.mix import with_unseen_bodies

    timeline = accepted_traffic(scenario, seed, duration_s).timeline
    if scenario.uneven:
        ground = np.random.default_rng([_GROUND_SALT, seed])
        return with_terrain(timeline, scenario.name, ground)
    return with_unseen_bodies(timeline) if scenario.unseen else timeline


def accepted_stage(name: str, seed: int, duration_s: float | None = None) -> Stage:
    """Return the stage whose traffic `record` accepts for a simulated scenario, before any step."""
    scenario = find(name)
    spawn_key = _accepted_key(scenario, seed, duration_s)
    draw = np.random.SeedSequence(seed, spawn_key=spawn_key)
    stage: Stage = scenario.build()(np.random.default_rng(draw))
    return stage


@lru_cache(maxsize=4096)
def _accepted_key(scenario: Scenario, seed: int, duration_s: float | None) -> tuple[int, ...]:
    """Return the spawn key of the accepted sub-seed; to find it, the traffic is recorded."""
    return accepted_traffic(scenario, seed, duration_s).draw.spawn_key


class AcceptedTraffic(NamedTuple):
    """Traffic that is accepted. draw: the sub-seed from which its stage was drawn."""

    draw: np.random.SeedSequence
    timeline: Timeline


def accepted_traffic(scenario: Scenario, seed: int, duration_s: float | None) -> AcceptedTraffic:
    """Return the traffic of the first sub-seed whose traffic is accepted."""
    from roadscope.envs.traffic.simulated import play

    build = scenario.build()
    for child in np.random.SeedSequence(seed).spawn(TRIES):
        draw = child.spawn(1)[0]
        timeline = play(
            build(np.random.default_rng(draw)),
            duration_s=duration_s or scenario.duration_s,
            style=scenario.style,
        )
        if accept(timeline).accepted:
            return AcceptedTraffic(draw, timeline)
    raise ScenarioError(f"'{scenario.name}' with seed {seed}: no traffic accepted in {TRIES} tries")


def with_terrain(timeline: Timeline, name: str, rng: np.random.Generator) -> Timeline:
    """Return the same traffic on a terrain of `terrain.TERRAINS`."""
    terrain = terrain_of(name, timeline.road, timeline.axles[:, 0], rng)
    return replace(timeline, terrain=terrain)


def find(name: str) -> Scenario:
    """Return the scenario of that name; raise `ScenarioError` if there is none."""
    if name in SCENARIOS:
        return SCENARIOS[name]
    scenario = scenario_of_environment(name)
    hint = "" if scenario is None else f"an environment; its traffic is the scenario '{scenario}'"
    raise ScenarioError(unknown("scenario", name, SCENARIOS, hint=hint))


def scenario_of_environment(env_id: str) -> str | None:
    """Return the scenario with the traffic of an environment, or None where there is none.

    env_id: an id of highway-env or of this package, with or without namespace and version, such as
        `highway-fast-v0`, `roadscope/Highway-v0` or `highway`.
    """
    plain = re.sub(r"-v\d+$", "", env_id.rpartition("/")[2])
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", plain).lower().split("-")
    # Variants of an environment, such as `racetrack-oval`, have the traffic of the base one.
    shortest = 0 if plain != env_id else len(words) - 1
    for count in range(len(words), shortest, -1):
        name = "-".join(words[:count])
        if name in _SCENARIO_OF_ENVIRONMENT:
            return _SCENARIO_OF_ENVIRONMENT[name]
        if name in SCENARIOS:
            return name
    return None


def accept(timeline: Timeline) -> Acceptance:
    """Return whether traffic has enough objects around the ego at every instant and few crashes."""
    centres = timeline.axles + timeline.centre_ahead_m[:, None] * np.stack(
        [np.cos(timeline.yaws), np.sin(timeline.yaws)], axis=-1
    )
    away = np.linalg.norm(centres - centres[:, :1], axis=-1)
    near = timeline.present & (away <= NEAR_M)
    least = int(near[:, 1:].sum(axis=1).min())
    people = np.isin(timeline.categories, (Category.PEDESTRIAN, Category.CYCLIST))
    crashed = float((timeline.crashed.any(axis=0) & ~people).mean())
    return Acceptance(least, crashed, least >= LEAST_OBJECTS and crashed <= MOST_CRASHED)
