"""Simulated traffic whose ego obeys commands; a driver knows other road users from tracks only."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi
from typing import NamedTuple

import numpy as np

from roadscope.core import Category, DrivingCommand, Pose, Tracks, TrackState
from roadscope.core.jit import compiled
from roadscope.envs.traffic.conversion import from_world, to_world
from roadscope.envs.traffic.driving import (
    COMFORT_M_S2,
    HARDEST_BRAKING_M_S2,
    LANE_CHANGE_DELAY_S,
    speed_allowed,
)
from roadscope.envs.traffic.flow import Flow
from roadscope.envs.traffic.flow_recorder import FlowRecorder
from roadscope.envs.traffic.inflow import is_at_end
from roadscope.envs.traffic.lane_geometry import Traffic, heading_at, lane_point, path_ahead
from roadscope.envs.traffic.mix import EGO
from roadscope.envs.traffic.motion import first_touching
from roadscope.envs.traffic.road_users import (
    DRIVER,
    OBSTACLE,
    WALKER,
    Bodies,
    copied,
    joined,
    neutral_bodies,
)
from roadscope.envs.traffic.scenarios import ScenarioError, accepted_stage, find
from roadscope.envs.traffic.simulated import STEP_S, advance
from roadscope.envs.traffic.timeline import Timeline

HARDEST_ACCELERATION_M_S2 = 4.0
"""Largest acceleration of the ego; commands beyond it are limited. Chosen by hand."""
MOVING_M_S = 1.0
"""Tracks at this speed or faster head along their velocity, slower ones along their yaw."""
PATH_STEP_M, PATH_POINTS = 2.0, 50
"""Distance between points, and their number, of the path ahead that a driver knows."""
TIME_GAP_S, STANDSTILL_GAP_M = 1.2, 2.5
"""Gaps to their leaders that others are assumed to keep; the defaults of `DriverSetup`."""
ONCOMING_M_S = 3.0
"""Tracks against the direction of their lane that are slower than this are assumed to stand."""
AGAINST_M = 10.0
"""Added to the distance of a lane whose direction is opposite to the motion of a track."""
_PEOPLE = (Category.PEDESTRIAN, Category.CYCLIST)


@dataclass(frozen=True, slots=True)
class Outlook:
    """What the ego knows and believes of the road ahead.

    lane, target_lane: where it is and where it wants to go, numbers from the left of `lanes`.
    allowed_speed_m_s: what its desired speed, the curves and the speed limits ahead allow.
    gap_m: to the next road user ahead on its lane or target lane, bumper to bumper; inf for none.
    leader_speed_m_s: of that one, along the lane; 0 without one.
    line_m: from its front bumper to the line where it must give way; inf without one.
    path: (P, 2) centre line of the way ahead, metres, frame `world`.
    model: what a driver of the simulation would do: IDM, and MOBIL where lanes may be changed.
    following: what the IDM would do on the lane or target lane.
    """

    lane: int
    target_lane: int
    lanes: int
    allowed_speed_m_s: float
    gap_m: float
    leader_speed_m_s: float
    line_m: float
    path: np.ndarray
    model: DrivingCommand
    following: DrivingCommand


def check_driven(scenario: str) -> None:
    """Raise `ScenarioError` for a scenario in which nobody can drive."""
    described = find(scenario)
    if described.scripted:
        raise ScenarioError(f"'{scenario}' is scripted: its traffic cannot react to a driver")
    if described.uneven or described.unseen:
        what = "uneven ground" if described.uneven else "unseen bodies"
        raise ScenarioError(
            f"'{scenario}' has {what}: drives are on level ground, in usual traffic"
        )


class DrivenTraffic:
    """The traffic of a scenario and seed, in which the ego obeys commands and all others react.

    It begins as `record` of the same scenario, seed and duration does. `ScenarioError` for traffic
    that is not simulated. duration_s: of the drive.
    """

    def __init__(self, scenario: str, seed: int, duration_s: float) -> None:
        check_driven(scenario)
        self._stage = accepted_stage(scenario, seed, duration_s)
        for _ in range(round(self._stage.warm_up_s / STEP_S)):
            advance(self._stage)
        self._style = find(scenario).style
        self._flow = self._stage.flow
        self._recorder = FlowRecorder(self._flow, self._stage.ego)
        self._ego["commanded"] = True
        self.steps = 0

    @property
    def now_s(self) -> float:
        """Time since the start of the drive."""
        return self.steps * STEP_S

    @property
    def collided_with(self) -> int | None:
        """Id in `true_tracks` of whom the ego collided with, 0 for an obstacle, None for nobody."""
        bodies, slot = self._flow.bodies, self._slot
        other = first_touching(bodies, slot)
        if other < 0 and bodies["crashed"][slot]:
            # Their collision has moved them apart; people never crash.
            away = np.hypot(bodies["x"] - bodies["x"][slot], bodies["y"] - bodies["y"][slot])
            away -= bodies["diagonal"] / 2
            away[~(bodies["crashed"] | (bodies["kind"] == OBSTACLE))] = np.inf
            away[slot] = np.inf
            other = int(np.argmin(away))
        if other < 0:
            return None
        return 0 if bodies["kind"][other] == OBSTACLE else int(bodies["number"][other]) + 1

    @property
    def arrived(self) -> bool:
        """Whether the ego is at the end of the road."""
        return bool(is_at_end(self._flow.traffic(), self._slot))

    @property
    def world_from_ego(self) -> Pose:
        """The pose of the ego's rear axle on the ground, frame `world`."""
        ego = self._ego
        half = ego["length"] / 2
        place = np.array([[ego["x"] - half * ego["cos"], ego["y"] - half * ego["sin"]]])
        axle, yaw, _ = to_world(place, ego["heading"])
        return Pose.planar(float(axle[0, 0]), float(axle[0, 1]), float(yaw))

    @property
    def size(self) -> np.ndarray:
        """Length, width and height of the ego, (3,), metres."""
        return np.array(EGO.size)

    @property
    def speed_m_s(self) -> float:
        """Speed of the ego."""
        return float(self._ego["speed"])

    @property
    def desired_speed_m_s(self) -> float:
        """Speed that the ego wants on a free straight road."""
        return float(self._ego["target_speed"])

    @property
    def _slot(self) -> int:
        return int(np.flatnonzero(self._flow.bodies["number"] == self._stage.ego)[0])

    @property
    def _ego(self) -> np.void:
        ego: np.void = self._flow.bodies[self._slot]
        return ego

    def timeline(self, last_s: float | None = None) -> Timeline:
        """Return the motion so far, or that of the last seconds."""
        samples = None if last_s is None else round(last_s / STEP_S) + 1
        return self._recorder.timeline(STEP_S, self._style, last=samples)

    def true_tracks(self) -> Tracks:
        """Return all road users as tracks without errors, frame `world`."""
        bodies = self._flow.bodies
        rows = np.flatnonzero((bodies["kind"] != OBSTACLE) & (bodies["number"] != self._stage.ego))
        others, count = bodies[rows], len(rows)
        users = [self._flow.users[number] for number in others["number"]]
        courses = others["heading"] + others["slip"]
        motions = others["speed"][:, None] * np.column_stack([np.cos(courses), np.sin(courses)])
        places = np.column_stack([others["x"], others["y"]])
        centres, yaws, velocities = to_world(places, others["heading"], motions)
        sizes = np.array([user.size for user in users if user is not None]).reshape(-1, 3)
        return Tracks(
            others["number"] + 1,
            np.column_stack([centres, sizes[:, 2] / 2]),
            sizes,
            yaws,
            velocities if velocities is not None else np.zeros((count, 2)),
            np.zeros((count, 4, 4)),
            np.array([user.category for user in users if user is not None], np.int8),
            np.ones(count),
            np.full(count, TrackState.CONFIRMED, np.int8),
            "world",
            self.now_s,
        )

    def outlook(self, tracks: Tracks) -> Outlook:
        """Return what the ego knows of the road and believes of the others.

        tracks: frame `world`, at this instant. The ego's own state, the lanes and the obstacles are
            true; only other road users come from the tracks.
        """
        believed, ego_lanes = self._believed(tracks), self._ego_lanes
        if self._stage.right_of_way is not None:
            believed.bodies["hold"] = np.nan
            self._stage.right_of_way(believed)
        ego = believed.bodies[0]
        may_change, ego["lane_changes"] = bool(ego["lane_changes"]), False
        plan = believed.decide(STEP_S)[0].copy()
        following = DrivingCommand(float(ego["acceleration"]), ego_lanes.target)
        traffic = believed.traffic()
        gap_m, leader_speed_m_s = _leader(plan, believed.bodies)
        allowed_m_s = float(speed_allowed(traffic, 0))
        places = path_ahead(traffic, 0, PATH_POINTS, PATH_STEP_M)
        model = following
        if may_change:
            ego["lane_changes"] = True
            believed.decide(STEP_S)
            # The model may have gone over to the next road, where lanes have other numbers.
            target = int(ego["target"]) - ego_lanes.first
            model = DrivingCommand(
                float(ego["acceleration"]),
                target if 0 <= target < ego_lanes.lanes else ego_lanes.target,
            )
        return Outlook(
            lane=ego_lanes.lane,
            target_lane=ego_lanes.target,
            lanes=ego_lanes.lanes,
            allowed_speed_m_s=allowed_m_s,
            gap_m=gap_m,
            leader_speed_m_s=leader_speed_m_s,
            line_m=float(np.nan_to_num(ego["hold"], nan=np.inf)),
            path=to_world(places, np.zeros(len(places)))[0],
            model=model,
            following=following,
        )

    def step(self, command: DrivingCommand, *, is_new: bool = True) -> None:
        """Drive for one step of 0.05 s.

        is_new: whether the command is an answer to this instant, and not to an earlier one.
        The target lane stays if the command names one that does not exist, that is closed or that
        the ego may not change to. The acceleration is limited to what the ego can do.
        """
        ego, ego_lanes = self._ego, self._ego_lanes
        if is_new and ego["lane"] == ego["target"] and ego["timer"] > LANE_CHANGE_DELAY_S:
            ego["timer"] = 0.0  # The model considered a lane change at this step.
        target = ego_lanes.first + command.target_lane
        if 0 <= command.target_lane < ego_lanes.lanes and (
            command.target_lane == ego_lanes.lane
            or not self._flow.roads.arrays.lanes[target]["forbidden"]
        ):
            ego["target"] = target
        ego["acceleration"] = np.clip(
            command.acceleration_m_s2, -HARDEST_BRAKING_M_S2, HARDEST_ACCELERATION_M_S2
        )
        advance(self._stage)
        self.steps += 1
        self._recorder.tick()

    @property
    def _ego_lanes(self) -> _EgoLanes:
        """The lanes that the ego may use: all of its road, or only its own."""
        ego, arrays = self._ego, self._flow.roads.arrays
        if not ego["lane_changes"]:
            return _EgoLanes(int(ego["target"]), 1, 0, 0)
        road = arrays.roads[arrays.lanes[ego["lane"]]["road"]]
        first = int(road["first"])
        return _EgoLanes(
            first, int(road["count"]), int(ego["lane"]) - first, int(ego["target"]) - first
        )

    def _believed(self, tracks: Tracks) -> Flow:
        """Return the ego, the tracks and the obstacles as bodies on the road; the ego is first."""
        bodies = self._flow.bodies
        ego = copied(bodies, [self._slot])
        ego["commanded"] = False
        others = bodies_of(tracks)
        obstacles = copied(bodies, bodies["kind"] == OBSTACLE)
        flow = self._flow.with_bodies(joined([ego, others, obstacles]))
        find_lanes(flow.traffic(), 1, 1 + len(others), float(ego["heading"][0]))
        flow.bodies_changed()
        every_road = flow.add_route(range(len(flow.roads.arrays.roads)))
        drivers = flow.bodies[1 : 1 + len(others)]
        drivers["first_leg"], drivers["last_leg"] = every_road
        return flow


class _EgoLanes(NamedTuple):
    """The lanes that the ego may use.

    first: number of the first in `RoadArrays.lanes`. lanes: how many there are. lane, target: where
    the ego is and where it wants to be, counted from the first.
    """

    first: int
    lanes: int
    lane: int
    target: int


def bodies_of(tracks: Tracks) -> Bodies:
    """Return (N,) of `BODY` for tracks in frame `world`: road users who keep their speed.

    They head along their velocity or, if they are slow, along their yaw.
    """
    bodies = neutral_bodies(len(tracks))
    places, headings, velocities = from_world(tracks.centres[:, :2], tracks.yaws, tracks.velocities)
    speeds = np.hypot(*velocities.T)
    moving = speeds >= MOVING_M_S
    headings = np.where(moving, np.arctan2(velocities[:, 1], velocities[:, 0]), headings)
    people = np.isin(tracks.categories, _PEOPLE)
    bodies["kind"] = np.where(people, WALKER, DRIVER)
    bodies["number"] = -1
    bodies["x"], bodies["y"] = places.T
    bodies["heading"], bodies["speed"] = headings, speeds
    bodies["cos"], bodies["sin"] = np.cos(headings), np.sin(headings)
    bodies["length"], bodies["width"] = tracks.sizes[:, 0], tracks.sizes[:, 1]
    bodies["diagonal"] = np.hypot(bodies["length"], bodies["width"])
    bodies["commanded"] = True
    bodies["target_speed"] = speeds
    bodies["time_gap"], bodies["standstill_gap"] = TIME_GAP_S, STANDSTILL_GAP_M
    bodies["comfort"] = COMFORT_M_S2
    return bodies


@compiled()
def find_lanes(traffic: Traffic, first: int, last: int, ego_heading: float) -> None:
    """Set the lanes of tracks: the nearest ones, for drivers in the slots first to last - 1.

    The ego ignores bodies that face it, because oncoming drivers keep to their own lanes. It must
    not ignore a track whose direction is uncertain. So a slow driver against the direction of its
    lane is turned round and stands: its yaw may be off by half a turn, and its velocity has errors.
    People who face the ego are turned by a right angle.

    ego_heading: radians, highway-env's frame, as that of the bodies.
    """
    lanes = traffic.roads.lanes
    for slot in range(first, last):
        body = traffic.bodies[slot]
        if body.kind != DRIVER:
            if cos(body.heading - ego_heading) < 0.0:
                body.heading += pi / 2
                body.cos, body.sin = -body.sin, body.cos
            continue
        least, best_agrees = np.inf, True
        for number in range(len(lanes)):
            lane = lanes[number]
            point = lane_point(traffic, lane, slot, 0)
            beyond = max(point.along - lane.length, 0.0) + max(-point.along, 0.0)
            heading = heading_at(lane, min(max(point.along, 0.0), lane.length)).base
            agrees = cos(body.heading - heading) >= 0.0
            distance = abs(point.across) + beyond
            if not agrees and body.speed >= ONCOMING_M_S:
                distance += AGAINST_M
            if distance < least:
                least, best_agrees = distance, agrees
                body.lane = body.target = number
        if not best_agrees and body.speed < ONCOMING_M_S:
            body.heading += pi
            body.cos, body.sin, body.speed = -body.cos, -body.sin, 0.0


def _leader(plan: np.void, bodies: Bodies) -> tuple[float, float]:
    """Return the gap to the nearer leader on the own or the target lane, and its speed along it."""
    gap_m, speed_m_s = np.inf, 0.0
    for slot, gap, heading in (
        (plan["leader"], plan["gap"], plan["leader_heading"]),
        (plan["target_leader"], plan["target_gap"], plan["target_leader_heading"]),
    ):
        if slot >= 0 and gap < gap_m:
            leader = bodies[slot]
            gap_m = float(gap)
            speed_m_s = max(float(leader["speed"] * np.cos(leader["heading"] - heading)), 0.0)
    return gap_m, speed_m_s
