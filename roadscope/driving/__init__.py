"""Driving on what is perceived: perception in a closed loop with traffic."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names

if TYPE_CHECKING:
    from roadscope.driving.belief import BelievedObservation
    from roadscope.driving.closed_loop import ClosedLoop
    from roadscope.driving.drivers import DRIVERS, Driver
    from roadscope.driving.perception import Perception
    from roadscope.driving.wrapper import PerceptionWrapper

_PLACES = {
    "BelievedObservation": "roadscope.driving.belief:BelievedObservation",
    "ClosedLoop": "roadscope.driving.closed_loop:ClosedLoop",
    "DRIVERS": "roadscope.driving.drivers:DRIVERS",
    "Driver": "roadscope.driving.drivers:Driver",
    "Perception": "roadscope.driving.perception:Perception",
    "PerceptionWrapper": "roadscope.driving.wrapper:PerceptionWrapper",
}
"""Public name -> `module:attribute`."""

__all__ = [
    "DRIVERS",
    "BelievedObservation",
    "ClosedLoop",
    "Driver",
    "Perception",
    "PerceptionWrapper",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES)
