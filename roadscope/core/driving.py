"""What a driver gets and answers at every step of a drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.pose import Pose
from roadscope.core.record import Record
from roadscope.core.tracks import Tracks


@dataclass(frozen=True, slots=True, eq=False)
class DrivingCommand(Record):
    """What a driver wants: the vehicle steers by itself along the lane that it names.

    acceleration_m_s2: negative to brake. target_lane: from 0 at the left, below
        `DrivingScene.lanes`; the vehicle crosses the lanes between.
    """

    acceleration_m_s2: float
    target_lane: int

    def __post_init__(self) -> None:
        value, lane = self.acceleration_m_s2, self.target_lane
        is_number = isinstance(value, float | int | np.floating) and not isinstance(value, bool)
        is_number = is_number and bool(np.isfinite(value))
        require(is_number, self, "acceleration_m_s2", "a finite number", value)
        is_whole = isinstance(lane, int | np.integer) and not isinstance(lane, bool)
        require(is_whole, self, "target_lane", "a whole number", lane)
        object.__setattr__(self, "acceleration_m_s2", float(value))
        object.__setattr__(self, "target_lane", int(lane))


@dataclass(frozen=True, slots=True, eq=False)
class DrivingScene(Record):
    """What a driver knows of itself and of the road, and believes of the others.

    stamp_s: seconds since the start of the drive.
    world_from_ego: the true pose. speed_m_s: the true speed. size: (3,) float64, metres, of the
        ego: length width height.
    tracks: road users as they are perceived, frame `world`, moved on to the stamp.
    lanes: how many lanes the ego may use, numbered from 0 at the left. lane, target_lane: where it
        is, and which it follows; during a change they differ.
    desired_speed_m_s: on a free straight road. allowed_speed_m_s: the same, or less before curves
        and speed limits.
    gap_m: to the next track ahead on the lane or the target lane, bumper to bumper; inf for none.
    leader_speed_m_s: speed of that track along the lane; 0 without one.
    line_m: from the front bumper to the line where the ego must give way; inf without one.
    path: (P, 2) float64, metres, frame `world`: centre line of the way ahead, a point every 2 m.
    model: what the drivers of the simulation would do on the same tracks: the IDM, and MOBIL where
        lanes may be changed.
    following: what the IDM would do on the lane, or on the target lane during a change.
    """

    stamp_s: float
    world_from_ego: Pose
    speed_m_s: float
    size: np.ndarray
    tracks: Tracks
    lanes: int
    lane: int
    target_lane: int
    desired_speed_m_s: float
    allowed_speed_m_s: float
    gap_m: float
    leader_speed_m_s: float
    line_m: float
    path: np.ndarray
    model: DrivingCommand
    following: DrivingCommand

    def __post_init__(self) -> None:
        settle_arrays(self, size=(np.float64, (3,)), path=(np.float64, ("P", 2)))
