"""Driving on what is perceived: perception in a closed loop with traffic."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names

if TYPE_CHECKING:
    from roadscope.driving.agent import AgentDriver, command_of, load_agent, observed, save_agent
    from roadscope.driving.belief import BelievedObservation
    from roadscope.driving.closed_loop import ClosedLoop
    from roadscope.driving.drive_env import DriveEnv
    from roadscope.driving.drivers import DRIVERS, Driver
    from roadscope.driving.perception import Perception
    from roadscope.driving.wrapper import PerceptionWrapper

_PLACES = {
    "AgentDriver": "roadscope.driving.agent:AgentDriver",
    "BelievedObservation": "roadscope.driving.belief:BelievedObservation",
    "ClosedLoop": "roadscope.driving.closed_loop:ClosedLoop",
    "DRIVERS": "roadscope.driving.drivers:DRIVERS",
    "DriveEnv": "roadscope.driving.drive_env:DriveEnv",
    "Driver": "roadscope.driving.drivers:Driver",
    "Perception": "roadscope.driving.perception:Perception",
    "PerceptionWrapper": "roadscope.driving.wrapper:PerceptionWrapper",
    "command_of": "roadscope.driving.agent:command_of",
    "load_agent": "roadscope.driving.agent:load_agent",
    "observed": "roadscope.driving.agent:observed",
    "save_agent": "roadscope.driving.agent:save_agent",
}
"""Public name -> `module:attribute`."""

__all__ = [
    "DRIVERS",
    "AgentDriver",
    "BelievedObservation",
    "ClosedLoop",
    "DriveEnv",
    "Driver",
    "Perception",
    "PerceptionWrapper",
    "command_of",
    "load_agent",
    "observed",
    "save_agent",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES)
