"""The Gymnasium ids of this package, and environments by name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import gymnasium as gym

NAMESPACE = "roadscope"

IDS: dict[str, dict[str, str]] = {
    "Highway-v0": {"scenario": "motorway"},
    "HighwayDense-v0": {"scenario": "dense-motorway"},
    "Merge-v0": {"scenario": "merge"},
    "Roundabout-v0": {"scenario": "roundabout"},
    "Intersection-v0": {"scenario": "intersection"},
    "Racetrack-v0": {"scenario": "racetrack"},
    "TwoWay-v0": {"scenario": "two-way"},
    "ParkingLot-v0": {"scenario": "parking-lot"},
    "Street-v0": {"scenario": "street"},
    "TownCrossing-v0": {"scenario": "town-crossing"},
    "Lu2018TwoVehicles-v0": {"scenario": "lu2018-two-vehicles", "rig": "lux"},
    "Lu2018Occlusion-v0": {"scenario": "lu2018-occlusion", "rig": "lux"},
    "Lu2018ThreeVehicles-v0": {"scenario": "lu2018-three-vehicles", "rig": "lux"},
}
"""Ids without the namespace, and the arguments that each gives to `ScenarioEnv`."""


DRIVE_ID = f"{NAMESPACE}/Drive-v0"
"""The closed loop of the board `driving`, for agents."""


def env_ids() -> tuple[str, ...]:
    """Return the full ids of environments with sensors, `roadscope/Highway-v0` and so on."""
    return tuple(f"{NAMESPACE}/{name}" for name in IDS)


def register() -> None:
    """Make the ids known to Gymnasium; calling it again changes nothing."""
    from gymnasium.envs import registration

    for name, arguments in IDS.items():
        if f"{NAMESPACE}/{name}" not in registration.registry:
            registration.register(
                id=f"{NAMESPACE}/{name}",
                entry_point="roadscope.driving.wrapper:PerceivedEnv",
                vector_entry_point="roadscope.driving.wrapper:perceived_envs",
                kwargs=dict(arguments),
            )
    if DRIVE_ID not in registration.registry:
        registration.register(
            id=DRIVE_ID,
            entry_point="roadscope.driving.drive_env:DriveEnv",
            vector_entry_point="roadscope.driving.drive_env:drive_envs",
        )


def make(name: str, **settings: Any) -> gym.Env[Any, Any]:
    """Return the environment of a Gymnasium id or of a scenario's name.

    name: an id (`roadscope/Highway-v0`) or a name of `roadscope list scenarios` (`roundabout`).
    settings: those of `roadscope.envs.ScenarioEnv`, such as `rig="hdl32e"`, `ego="idm"` or
        `faults="fog:3"`, and those of `gymnasium.make`, such as `render_mode` or
        `max_episode_steps`.

    >>> import roadscope
    >>> env = roadscope.make("roundabout", rig="hdl32e")
    """
    import gymnasium as gym

    register()
    if "/" in name or ":" in name:
        return gym.make(name, **settings)
    from roadscope.envs.traffic.scenarios import find

    scenario = find(name).name
    of_scenario = {arguments["scenario"]: key for key, arguments in IDS.items()}
    if scenario in of_scenario:
        return gym.make(f"{NAMESPACE}/{of_scenario[scenario]}", **settings)
    # Every id accepts another scenario; scenarios without an id use the first one.
    return gym.make(env_ids()[0], scenario=scenario, **settings)
