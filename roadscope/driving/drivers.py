"""Drivers: they decide on what is perceived."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from roadscope.core import DrivingCommand, DrivingScene, Registry


@runtime_checkable
class Driver(Protocol):
    """Drives the ego; it is called every 0.1 s.

    Constructor arguments are keyword-only and all have defaults.
    """

    def reset(self) -> None:
        """Forget the last drive."""

    def drive(self, scene: DrivingScene) -> DrivingCommand:
        """Return what to do until the next call."""


class IdmDriver:
    """Drives as the simulation's own drivers: IDM, and MOBIL for lane changes.

    lane_changes: whether lanes are changed.
    """

    def __init__(self, *, lane_changes: bool = True) -> None:
        self._lane_changes = lane_changes

    def reset(self) -> None:
        """Do nothing: there is no state."""

    def drive(self, scene: DrivingScene) -> DrivingCommand:
        """Return what the model does."""
        return scene.model if self._lane_changes else scene.following


class EmergencyBrake:
    """Keeps its lane and its speed, and brakes with full force when a collision is near.

    It reacts to tracks only shortly before a collision, so errors of tracks have a great effect.

    time_to_collision_s: it brakes if the gap would shrink to `standstill_gap_m` within this time at
        constant speeds. braking_m_s2: how hard it brakes.
    standstill_gap_m: it also brakes while the gap is smaller.
    gain_1_s: acceleration for each m/s between the allowed speed and its own, at most
        `comfort_m_s2` either way; slower traffic ahead is followed only by braking.
    """

    def __init__(
        self,
        *,
        time_to_collision_s: float = 2.0,
        braking_m_s2: float = 8.0,
        standstill_gap_m: float = 3.0,
        gain_1_s: float = 0.5,
        comfort_m_s2: float = 2.0,
    ) -> None:
        self._time_s, self._braking_m_s2 = time_to_collision_s, braking_m_s2
        self._gap_m = standstill_gap_m
        self._gain_1_s, self._comfort_m_s2 = gain_1_s, comfort_m_s2

    def reset(self) -> None:
        """Do nothing: there is no state."""

    def drive(self, scene: DrivingScene) -> DrivingCommand:
        """Return the command."""
        wanted = self._gain_1_s * (scene.allowed_speed_m_s - scene.speed_m_s)
        acceleration = min(max(wanted, -self._comfort_m_s2), self._comfort_m_s2)
        for gap_m, speed_m_s in (
            (scene.gap_m, scene.leader_speed_m_s),
            (scene.line_m + self._gap_m, 0.0),
        ):
            closing = scene.speed_m_s - speed_m_s
            if gap_m < self._gap_m or (
                closing > 0.0 and gap_m - self._gap_m < self._time_s * closing
            ):
                acceleration = -self._braking_m_s2
        return DrivingCommand(acceleration, scene.lane)


DRIVERS: Registry[Driver] = Registry(
    "driver",
    {
        "idm-mobil": "roadscope.driving.drivers:IdmDriver",
        "idm": "roadscope.driving.drivers:IdmDriver?lane_changes=False",
        "emergency-brake": "roadscope.driving.drivers:EmergencyBrake",
        "learned": "roadscope.driving.agent:AgentDriver",
    },
    group="roadscope.drivers",
    summaries={
        "idm-mobil": "Keeps its distance (IDM, 2000), changes lanes (MOBIL, 2007).",
        "idm": "Keeps its distance and its lane (IDM, Treiber 2000).",
        "emergency-brake": "Keeps its speed; brakes hard by time to collision.",
        "learned": "A network; the shipped ones imitate idm-mobil (DAgger, 2011).",
    },
)
"""Drivers by name."""
