"""The promises of drivers."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache, partial

from roadscope.core import DrivingCommand, DrivingScene
from roadscope.core.answers import check_command
from roadscope.driving import ClosedLoop
from roadscope.driving.perception import BLIND, TRUTH
from roadscope.envs.sensors.rigs import rig
from roadscope.testing.shared import input_promise, memory_promises, start_promises
from roadscope.testing.subject import Instance, Promise, PromiseError, Subject

SCENARIO, SEED, DURATION_S = "dense-motorway", 0, 20.0
"""Traffic, one of the training seeds, and how long it is driven in."""
OTHER = "stepping-out"
USUAL = "idm-mobil"
"""Driver that does what those of the simulation do (`DrivingScene.model`)."""
SCENES_S = 4.0
"""Length of the drives whose scenes are shown to a driver again."""
LEAST_SHARE = 0.2
"""A driver that gets less far than this share of a driver of the simulation does not drive. One
that brakes to a stop gets 4 % as far. Chosen by hand."""


def answers(subject: Subject) -> str:
    """Drive in dense traffic on the truth; refuse a driver that collides or hardly moves."""
    loop = _loop(SCENARIO, TRUTH)
    with subject.started() as instance:
        driven_m = _driven_m(loop, partial(command, instance))
    if loop.traffic.collided_with is not None:
        raise PromiseError(f"it collides in dense traffic after {loop.traffic.now_s:.1f} s")
    usual_m = _usual_m()
    text = f"{driven_m:.0f} m in {DURATION_S:g} s of dense traffic ({USUAL}: {usual_m:.0f} m)"
    if driven_m < LEAST_SHARE * usual_m:
        raise PromiseError(f"it hardly drives: {text}")
    return text


@cache
def _usual_m() -> float:
    """Return how far the drivers of the simulation get."""
    return _driven_m(_loop(SCENARIO, TRUTH), lambda scene: scene.model)


def _driven_m(loop: ClosedLoop, drive: Callable[[DrivingScene], DrivingCommand]) -> float:
    """Drive to the end, and return how far it is from the start."""
    start = loop.traffic.world_from_ego.translation[:2]
    while not loop.over:
        loop.step(drive(loop.scene(loop.tracks())))
    return float(((loop.traffic.world_from_ego.translation[:2] - start) ** 2).sum() ** 0.5)


def command(instance: Instance, scene: DrivingScene) -> DrivingCommand:
    """Return the command of a scene."""
    return check_command(instance.call("drive", scene), lanes=scene.lanes)


def commands(instance: Instance, scenario: str = SCENARIO) -> list[DrivingCommand]:
    """Return the commands of consecutive scenes, on which they have no effect."""
    return [command(instance, scene) for scene in scenes(scenario)]


@lru_cache(maxsize=2)
def scenes(scenario: str = SCENARIO) -> tuple[DrivingScene, ...]:
    """Return the scenes of a drive by a driver of the simulation, with tracks and without."""
    drives = []
    for perception in (TRUTH, BLIND):
        loop = _loop(scenario, perception)
        while not loop.over and loop.traffic.now_s < SCENES_S:
            scene = loop.scene(loop.tracks())
            drives.append(scene)
            loop.step(scene.model)
    return tuple(drives)


def _loop(scenario: str, perception: str) -> ClosedLoop:
    return ClosedLoop(
        scenario, SEED, perception=perception, rig=rig("vlp16"), duration_s=DURATION_S
    )


PROMISES = (
    *start_promises("drive", "scene"),
    Promise("drives", answers),
    input_promise(commands),
    *memory_promises(
        commands, lambda instance: commands(instance, OTHER), inputs="scenes", answers="commands"
    ),
)
"""All promises of drivers."""
