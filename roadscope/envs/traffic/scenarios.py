"""Traffic scenarios by name, recorded to timelines."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from roadscope.core import Category
from roadscope.core.names import unknown
from roadscope.envs.traffic.timeline import Timeline

LEAST_OBJECTS = 5
NEAR_M = 60.0
MOST_CRASHED = 0.05
TRIES = 10


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
    unseen: whether vehicles have the shapes of `unseen.UNSEEN`, from which nothing is learned.
    """

    name: str
    description: str
    style: str
    builder: str
    duration_s: float = 20.0
    scripted: bool = False
    unseen: bool = False


@dataclass(frozen=True, slots=True)
class Acceptance:
    """Whether traffic is worth sensing.

    least_objects: fewest objects within 60 m of the ego at any instant.
    crashed_share: crashed actors over all actors, the ego included.
    accepted: at least 5 objects at every instant and at most 5 % crashed.
    """

    least_objects: int
    crashed_share: float
    accepted: bool


def _scenarios(*items: Scenario) -> Mapping[str, Scenario]:
    return MappingProxyType({item.name: item for item in items})


_HERE = "roadscope.envs.traffic."
SCENARIOS: Mapping[str, Scenario] = _scenarios(
    Scenario(
        "motorway", "Four lanes at about 25 m/s, from motorcycles to articulated lorries.",
        "motorway", _HERE + "scenario_motorway:motorway",
    ),
    Scenario(
        "dense-motorway", "Four full lanes at about 12 m/s.",
        "motorway", _HERE + "scenario_motorway:dense_motorway",
    ),
    Scenario(
        "merge", "Vehicles from a ramp join two lanes of a motorway.",
        "motorway", _HERE + "scenario_merge:merge",
    ),
    Scenario(
        "roundabout", "Four roads meet at a roundabout; who enters gives way.",
        "urban", _HERE + "scenario_roundabout:roundabout",
    ),
    Scenario(
        "intersection", "A crossing in town; drivers wait until their way is free.",
        "urban", _HERE + "scenario_intersection:intersection",
    ),
    Scenario(
        "racetrack", "Two lanes in a winding loop.",
        "bare", _HERE + "scenario_racetrack:racetrack",
    ),
    Scenario(
        "racetrack-loop", "A whole lap of it between rails, walls and trees.",
        "motorway", _HERE + "scenario_racetrack:racetrack_loop", 70.0,
    ),
    Scenario(
        "two-way", "A road with oncoming traffic.",
        "urban", _HERE + "scenario_two_way:two_way",
    ),
    Scenario(
        "parking-lot", "A car park with slow traffic past standing cars.",
        "campus", _HERE + "scenario_parking:parking_lot",
    ),
    Scenario(
        "waiting", "The ego stands before a road in town on which others cross both ways.",
        "urban", _HERE + "scenario_waiting:waiting",
    ),
    Scenario(
        "street", "A street in town: people walk, wait, cross and ride beside the traffic.",
        "town", _HERE + "scenario_street:street",
    ),
    Scenario(
        "town-crossing", "A crossing in town with people on foot and on bicycles.",
        "town", _HERE + "scenario_street:town_crossing",
    ),
    Scenario(
        "unseen-motorway", "As motorway, with flatbeds, tankers and other bodies never learned.",
        "motorway", _HERE + "scenario_motorway:motorway", unseen=True,
    ),
    Scenario(
        "unseen-street", "As street, with vehicles of such bodies.",
        "town", _HERE + "scenario_street:street", unseen=True,
    ),
    Scenario(
        "cut-ins", "Vehicles cut in and change places closely before the ego.",
        "motorway", _HERE + "script_cut_ins:cut_ins", 12.0, scripted=True,
    ),
    Scenario(
        "long-occlusion", "A lorry beside the ego hides who overtakes and who comes towards it.",
        "motorway", _HERE + "script_long_occlusion:long_occlusion", 12.0, scripted=True,
    ),
    Scenario(
        "convoy-pull-away", "The ego stands among lorries and pulls away with all of them.",
        "urban", _HERE + "script_convoy:convoy_pull_away", 40.0, scripted=True,
    ),
    Scenario(
        "platoon", "The ego drives within dense traffic that keeps its places.",
        "motorway", _HERE + "script_platoon:platoon", 30.0, scripted=True,
    ),
    Scenario(
        "cold-start", "The first scan is taken at 15 to 35 m/s.",
        "motorway", _HERE + "script_cold_start:cold_start", 25.0, scripted=True,
    ),
    Scenario(
        "standing-in-traffic", "The ego stands while others pass on both sides.",
        "urban", _HERE + "script_standing:standing_in_traffic", 30.0, scripted=True,
    ),
    Scenario(
        "standing-barriers", "The ego stands between noise walls while others pass.",
        "barriers", _HERE + "script_standing:standing_barriers", 30.0, scripted=True,
    ),
    Scenario(
        "barriers", "A motorway between long smooth noise walls.",
        "barriers", _HERE + "script_walled:barriers", 30.0, scripted=True,
    ),
    Scenario(
        "tunnel", "A tunnel whose lamps and niches alone tell places apart.",
        "tunnel", _HERE + "script_walled:tunnel", 30.0, scripted=True,
    ),
    Scenario(
        "stop-and-go", "Waves of standstill in a jam.",
        "motorway", _HERE + "script_stop_and_go:stop_and_go", 60.0, scripted=True,
    ),
    Scenario(
        "empty-motorway", "The ego alone on a motorway, from rest or at speed from the first scan.",
        "motorway", _HERE + "script_empty:empty_motorway", 30.0, scripted=True,
    ),
    Scenario(
        "empty-street", "The ego alone in a street with houses, trees and parked cars.",
        "urban", _HERE + "script_empty:empty_street", 30.0, scripted=True,
    ),
    Scenario(
        "lu2018-two-vehicles", "Lu 2018, 1: a car stays ahead, another comes and goes on its left.",
        "campus", _HERE + "scripted:play_script", 15.36, scripted=True,
    ),
    Scenario(
        "lu2018-occlusion", "Lu 2018, 2: a van cuts in and hides the car ahead.",
        "campus", _HERE + "scripted:play_script", 10.56, scripted=True,
    ),
    Scenario(
        "lu2018-three-vehicles", "Lu 2018, 3: three cars, one falls back out of view.",
        "campus", _HERE + "scripted:play_script", 8.16, scripted=True,
    ),
)  # fmt: skip


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
    the scenario and the seed when none of 10 is accepted.
    """
    scenario = find(name)
    if duration_s is not None and not duration_s > 0:
        raise ScenarioError(f"a duration is a positive number of seconds, got {duration_s}")
    module, _, function = scenario.builder.partition(":")
    build = getattr(importlib.import_module(module), function)
    if scenario.scripted:
        timeline: Timeline = build(scenario.name, seed, duration_s)
        return timeline
    from roadscope.envs.traffic.stage import play
    from roadscope.envs.traffic.unseen import with_unseen_bodies

    for child in np.random.SeedSequence(seed).spawn(TRIES):
        traffic, dressing = child.spawn(2)
        timeline = play(
            build(np.random.default_rng(traffic)),
            duration_s=duration_s or scenario.duration_s,
            style=scenario.style,
            seed=dressing,
        )
        if accept(timeline).accepted:
            return with_unseen_bodies(timeline) if scenario.unseen else timeline
    raise ScenarioError(f"'{name}' with seed {seed}: no traffic accepted in {TRIES} tries")


def find(name: str) -> Scenario:
    """Return the scenario of that name."""
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
    # Variants of an environment, such as `racetrack-oval`, have the traffic of the first of them.
    shortest = 0 if plain != env_id else len(words) - 1
    for count in range(len(words), shortest, -1):
        name = "-".join(words[:count])
        if name in _SCENARIO_OF_ENVIRONMENT:
            return _SCENARIO_OF_ENVIRONMENT[name]
        if name in SCENARIOS:
            return name
    return None


def accept(timeline: Timeline) -> Acceptance:
    """Judge traffic by the objects around the ego at every recorded instant, and by crashes."""
    centres = timeline.axles + timeline.centre_ahead_m[:, None] * np.stack(
        [np.cos(timeline.yaws), np.sin(timeline.yaws)], axis=-1
    )
    away = np.linalg.norm(centres - centres[:, :1], axis=-1)
    near = timeline.present & (away <= NEAR_M)
    least = int(near[:, 1:].sum(axis=1).min())
    people = np.isin(timeline.categories, (Category.PEDESTRIAN, Category.CYCLIST))
    crashed = float((timeline.crashed.any(axis=0) & ~people).mean())
    return Acceptance(least, crashed, least >= LEAST_OBJECTS and crashed <= MOST_CRASHED)
