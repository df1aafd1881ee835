"""The promises of drivers."""

from __future__ import annotations

from functools import lru_cache

from roadscope.core import DrivingCommand, DrivingScene
from roadscope.core.answers import check_command
from roadscope.driving import ClosedLoop
from roadscope.driving.perception import BLIND, TRUTH
from roadscope.envs.sensors.rigs import rig
from roadscope.testing.shared import Words, input_promise, memory_promises, start_promises
from roadscope.testing.subject import Instance, Promise, PromiseError, Subject

SCENARIO, SEED, DURATION_S = "dense-motorway", 0, 20.0
"""Traffic, one of the training seeds, and how long it is driven in."""
OTHER = "stepping-out"
SCENES_S = 4.0
"""Length of the drives whose scenes are shown to a driver again."""


def answers(subject: Subject) -> str:
    """Drive in dense traffic on the truth; refuse a driver that collides or does not move."""
    with subject.started() as instance:
        loop = _loop(SCENARIO, TRUTH)
        start = loop.traffic.world_from_ego.translation[:2]
        while not loop.over:
            scene = loop.scene(loop.tracks())
            loop.step(command(instance, scene))
    driven_m = float(((loop.traffic.world_from_ego.translation[:2] - start) ** 2).sum() ** 0.5)
    if loop.traffic.collided_with is not None:
        raise PromiseError(f"it collides in dense traffic after {loop.traffic.now_s:.1f} s")
    if driven_m < 1.0:
        raise PromiseError("it does not drive at all in dense traffic")
    return f"{driven_m:.0f} m in {DURATION_S:g} s of dense traffic"


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
        commands, lambda instance: commands(instance, OTHER), Words("scenes", "commands")
    ),
)
"""All promises of drivers."""
