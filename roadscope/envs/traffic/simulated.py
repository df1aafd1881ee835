"""Simulated scenarios: drivers on the roads of highway-env's environments.

Each scenario's function draws a `Stage` from a generator; `play` lets its traffic run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from roadscope.core.bounds import Bounds
from roadscope.envs.traffic.adversarial import CutIns, StepOut, StepOuts
from roadscope.envs.traffic.flow import HEAVY, DriverSetup, Flow
from roadscope.envs.traffic.flow_recorder import FlowRecorder
from roadscope.envs.traffic.inflow import Inflow, Outflow
from roadscope.envs.traffic.junction import Conflicts, Crossing, GiveWay, Hold
from roadscope.envs.traffic.mix import EGO, draw_body
from roadscope.envs.traffic.roads import LaneIndex, Roads
from roadscope.envs.traffic.timeline import Timeline
from roadscope.envs.traffic.walkers import Kerb, People

STEP_S = 0.05
"""Physics step: 20 Hz."""


@dataclass(frozen=True, slots=True)
class Stage:
    """A road with traffic on it, ready to be recorded.

    ego: its number.
    warm_up_s: simulated time before the recording begins.
    rules: called with the traffic before every step: inflow, removal, right of way.
    right_of_way: the rule that decides who waits at a line, if it needs no more than the states of
        the bodies: a driven ego then applies it to its tracks. None: such a rule is applied to the
        true traffic alone, like a traffic light.
    """

    flow: Flow
    ego: int
    warm_up_s: float = 0.0
    rules: tuple[Callable[[Flow], None], ...] = ()
    right_of_way: Callable[[Flow], None] | None = None


def play(stage: Stage, *, duration_s: float, style: str) -> Timeline:
    """Run the traffic at 20 Hz and return its timeline."""
    for _ in range(round(stage.warm_up_s / STEP_S)):
        advance(stage)
    recorder = FlowRecorder(stage.flow, stage.ego)
    for _ in range(round(duration_s / STEP_S)):
        advance(stage)
        recorder.tick()
    return recorder.timeline(STEP_S, style)


def advance(stage: Stage) -> None:
    """Apply the rules of a stage and simulate one step."""
    for rule in stage.rules:
        rule(stage.flow)
    stage.flow.step(STEP_S)


def network_of(
    env_class: Any, *, builder: str = "_make_road", config: Any = None, **arguments: Any
) -> Any:
    """Return the road that an environment class of highway-env builds, with no vehicle on it.

    The environment is never constructed: that would run its own traffic and, for intersections,
    change constants of highway-env's drivers for the whole process.
    """
    env = env_class.__new__(env_class)
    env.config = {**env_class.default_config(), **(config or {})}
    env._np_random = np.random.default_rng(0)
    env._np_random_seed = 0
    getattr(env, builder)(**arguments)
    return env.road


# Motorway -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class MotorwayTraffic:
    """Traffic on a straight motorway.

    desired_speed: m/s; drivers on lane i begin with 0.94 - 0.05 i times that, and on a free road
        want 0.9 to 1.3 times the speed they begin with.
    headway_s: mean time between two vehicles of a lane.
    reach_m: vehicles begin within this distance of the ego.
    length_m, ego_m: length of the road, and where the ego begins on it.
    """

    desired_speed: float
    headway_s: float
    reach_m: float
    lanes: int = 4
    length_m: float = 2400.0
    ego_m: float = 500.0


def motorway(rng: np.random.Generator) -> Stage:
    """Build four lanes of traffic at about 25 m/s."""
    return straight(rng, MotorwayTraffic(31.0, headway_s=1.35, reach_m=300.0))


def dense_motorway(rng: np.random.Generator) -> Stage:
    """Build four full lanes at about 12 m/s."""
    return straight(rng, MotorwayTraffic(16.0, headway_s=1.05, reach_m=150.0))


def cutting_in(rng: np.random.Generator) -> Stage:
    """Build a motorway at about 20 m/s, on which drivers cut in closely ahead of the ego."""
    stage = straight(rng, MotorwayTraffic(25.0, headway_s=1.3, reach_m=220.0))
    own_rng = np.random.default_rng(int(rng.integers(2**32)))
    return replace(stage, rules=(*stage.rules, CutIns(own_rng, stage.ego)))


def straight(rng: np.random.Generator, traffic: MotorwayTraffic) -> Stage:
    """Build a straight motorway."""
    flow = Flow(_motorway_roads(traffic))
    ego_lane = int(rng.integers(1, traffic.lanes - 1))
    ego = -1
    for lane in range(traffic.lanes):
        speed = traffic.desired_speed * (0.94 - 0.05 * lane)
        spacing_m = traffic.headway_s * speed + 8.0
        for along_m in _motorway_positions(rng, ego_lane == lane, spacing_m, traffic):
            is_ego = ego < 0 and lane == ego_lane and along_m == traffic.ego_m
            body = EGO if is_ego else draw_body("motorway", rng)
            if body.category in HEAVY and lane < traffic.lanes - 2:
                body = draw_body("parked", rng)
            desired_speed = speed * float(rng.uniform(0.9, 1.3))
            driver = DriverSetup(
                body, ("0", "1", lane), along_m, speed, desired_speed, lane_changes=True
            )
            number = flow.add_driver(driver.vary(rng))
            ego = number if is_ego else ego
    return Stage(flow, ego, warm_up_s=2.0)


@cache
def _motorway_roads(traffic: MotorwayTraffic) -> Roads:
    from highway_env.road.road import RoadNetwork

    network = RoadNetwork.straight_road_network(
        traffic.lanes, length=traffic.length_m, speed_limit=1.2 * traffic.desired_speed
    )
    return Roads(network)


def _motorway_positions(
    rng: np.random.Generator, with_ego: bool, spacing_m: float, traffic: MotorwayTraffic
) -> list[float]:
    """Draw where vehicles begin along a lane, around the ego's position."""
    middle, reach_m = traffic.ego_m, traffic.reach_m
    positions = [middle if with_ego else middle + float(rng.uniform(-0.5, 0.5)) * spacing_m]
    while positions[-1] < middle + reach_m:
        positions.append(positions[-1] + _centre_distance(rng, spacing_m))
    while positions[0] > middle - reach_m:
        positions.insert(0, positions[0] - _centre_distance(rng, spacing_m))
    return positions


def _centre_distance(rng: np.random.Generator, mean_m: float) -> float:
    """Draw a distance between centres; the longest vehicles are 16.5 m long."""
    return max(19.0, mean_m * float(rng.uniform(0.75, 1.35)))


# Merge --------------------------------------------------------------------------------------------

MERGE_SECTIONS = {
    "before_merge_length": 260,
    "converge_merge_length": 80,
    "parallel_merge_length": 160,
    "after_merge_length": 700,
}
MERGE_EGO_M = 215.0
"""Lengths of the sections of the road in metres, and where the ego begins; chosen by hand."""


def merge(rng: np.random.Generator) -> Stage:
    """Build two lanes at about 16 m/s and a ramp whose vehicles must merge before its end."""
    roads, obstacles = _merge_roads()
    flow = Flow(roads)
    ego = -1
    for lane, desired_speed in ((0, 18.0), (1, 16.0)):
        start = MERGE_EGO_M if lane else MERGE_EGO_M + float(rng.uniform(-15.0, 15.0))
        positions = [start]
        while positions[-1] < 390.0:
            positions.append(positions[-1] + float(rng.uniform(26.0, 42.0)))
        while positions[0] > 90.0:
            positions.insert(0, positions[0] - float(rng.uniform(26.0, 42.0)))
        for along_m in positions:
            is_ego = lane == 1 and along_m == MERGE_EGO_M
            driver = _merging(
                flow, rng, ("a", "b", lane), along_m, desired_speed=desired_speed, is_ego=is_ego
            )
            ego = driver if is_ego else ego
    for along_m in np.arange(100.0, 250.0, 35.0) + rng.uniform(-5.0, 5.0, 5):
        _merging(flow, rng, ("j", "k", 0), float(along_m), desired_speed=15.0)
    for obstacle in obstacles:
        flow.add_obstacle(obstacle)
    return Stage(flow, ego, rules=(Outflow(ego),))


@cache
def _merge_roads() -> tuple[Roads, list[Any]]:
    """Return the roads and the obstacles on them."""
    from highway_env.envs.merge_env import MergeGenericEnv

    built = network_of(MergeGenericEnv, config=MERGE_SECTIONS)
    return Roads(built.network), built.objects


def _merging(
    flow: Flow,
    rng: np.random.Generator,
    lane_index: LaneIndex,
    along_m: float,
    *,
    desired_speed: float,
    is_ego: bool = False,
) -> int:
    driver = DriverSetup(
        EGO if is_ego else draw_body("urban", rng),
        lane_index,
        along_m,
        0.9 * desired_speed,
        desired_speed * float(rng.uniform(0.95, 1.1)),
        lane_changes=not is_ego,
    )
    return flow.add_driver(driver.vary(rng))


# Roundabout ---------------------------------------------------------------------------------------

SIDES = "senw"
RING_ENTRIES = [(f"{side}es", f"{side}e", 0) for side in SIDES]
RING_SOURCES = [(f"{side}er", f"{side}es", 0) for side in SIDES]
RING_NODES = ["se", "ex", "ee", "nx", "ne", "wx", "we", "sx"]
OUTER_LANE = 1
LINE_RADIUS_M = 28.0
"""A waiting driver keeps the front this far from the middle; the outer lane ends at 26 m."""
RING_SPEED, BEND_SPEED = 9.0, 5.8
"""Desired speed of drivers and speed limit of bends, m/s. The ends of entries and exits do not
quite meet the ring, so drivers take them more slowly."""
EGO_RANK = 2
"""Number of drivers ahead of the ego on its road, at the roundabout and at the intersection."""


def roundabout(rng: np.random.Generator) -> Stage:
    """Build a roundabout with traffic from all sides at up to 9 m/s, all on the outer lane."""
    roads, rule = _roundabout_roads()
    flow = Flow(roads)
    inflow = Inflow(rng, RING_SOURCES, _ring_exit, "tight", RING_SPEED, headway_s=3.5)
    ego = inflow.line_up_all(flow, Bounds(2.0, 10.0), EGO_RANK)
    return Stage(flow, ego, warm_up_s=1.0, rules=(inflow, rule), right_of_way=rule)


@cache
def _roundabout_roads() -> tuple[Roads, GiveWay]:
    from highway_env.envs.roundabout_env import RoundaboutEnv
    from highway_env.road.lane import StraightLane

    network = network_of(RoundaboutEnv).network
    for lane in network.lanes_list():
        if type(lane) is not StraightLane:
            lane.speed_limit = BEND_SPEED
    roads = Roads(network)
    stop_lines = {entry: _stop_line_m(roads, entry) for entry in RING_ENTRIES}
    ring = {entry: _upstream(entry) for entry in RING_ENTRIES}
    return roads, GiveWay(roads, stop_lines, ring, 3.2)


def _ring_exit(rng: np.random.Generator, source: LaneIndex, length_m: float) -> str:
    """Draw an exit. The exit beside the entry is never drawn."""
    others = [side for side in SIDES if side != source[0][0]]
    return f"{others[int(rng.integers(len(others)))]}xr"


def _upstream(entry: LaneIndex) -> list[LaneIndex]:
    """Return the ring's outer lanes that lead to an entry, nearest first."""
    index = RING_NODES.index(entry[1])
    nodes = [RING_NODES[(index - k) % 8] for k in range(8)]
    return [(start, end, OUTER_LANE) for start, end in zip(nodes[1:], nodes[:-1], strict=True)]


def _stop_line_m(roads: Roads, entry: LaneIndex) -> float:
    """Return the metres before the end of an entry at which it comes within the line's radius."""
    lane = roads.lane(entry)
    along = np.linspace(0.0, lane.length, 200)
    radii = np.array([np.hypot(*lane.position(s, 0.0)) for s in along])
    return float(lane.length - along[radii > LINE_RADIUS_M].max())


# Intersection -------------------------------------------------------------------------------------

ARMS = [(f"o{corner}", f"ir{corner}", 0) for corner in range(4)]
ARM_SPEED = 8.0
"""Desired speed at the intersection, m/s."""
LINE_M = 3.0
"""Distance of the stop line from the end of a lane: highway-env moves a vehicle to the next lane
2.5 m before the end of its lane."""
LONGEST_TURNING_M = 6.5
"""Longer vehicles drive straight on: highway-env's turns have radii of 9 and 13 m."""
ANY_TURN, NO_LEFT_TURN = (1, 2, 2, 3), (2, 2, 2, 3)
"""Turns to draw from, as arms counter-clockwise: 1 is left, 2 straight on, 3 right. A turn that is
listed twice is twice as likely."""


def intersection(rng: np.random.Generator) -> Stage:
    """Build an intersection with traffic from all sides at up to 8 m/s."""
    roads, conflicts = _crossing_roads()
    flow = Flow(roads)
    inflow = Inflow(rng, ARMS, _any_arm, "urban", ARM_SPEED, headway_s=3.5)
    ego = inflow.line_up_all(flow, Bounds(8.0, 18.0), EGO_RANK)
    return Stage(flow, ego, warm_up_s=2.0, rules=(inflow, Crossing(conflicts)))


@cache
def _crossing_roads() -> tuple[Roads, Conflicts]:
    from highway_env.envs.intersection_env import IntersectionEnv

    roads = Roads(network_of(IntersectionEnv).network)
    return roads, Conflicts(roads, dict.fromkeys(ARMS, LINE_M))


def waiting(rng: np.random.Generator) -> Stage:
    """Build an intersection where the ego and the drivers opposite wait for crossing traffic."""
    roads, _ = _crossing_roads()
    flow = Flow(roads)
    inflow = Inflow(rng, ARMS, _arm_without_left_turn, "urban", ARM_SPEED, headway_s=2.6)
    ego = inflow.line_up_all(flow, Bounds(8.0, 14.0), ego_rank=0)
    # All drivers of the minor road, which is the ego's, stop at their lines.
    rule = Hold(roads, dict.fromkeys((ARMS[0], ARMS[2]), LINE_M))
    return Stage(flow, ego, warm_up_s=5.0, rules=(inflow, rule))


def _any_arm(rng: np.random.Generator, source: LaneIndex, length_m: float) -> str:
    """Draw a destination: straight on, left or right."""
    return _arm(rng, source, length_m, ANY_TURN)


def _arm_without_left_turn(rng: np.random.Generator, source: LaneIndex, length_m: float) -> str:
    """Draw a destination: straight on or right, never across oncoming traffic."""
    return _arm(rng, source, length_m, NO_LEFT_TURN)


def _arm(
    rng: np.random.Generator, source: LaneIndex, length_m: float, turns: tuple[int, ...]
) -> str:
    corner = int(source[0][1])
    turn = 2 if length_m > LONGEST_TURNING_M else int(rng.choice(turns))
    return f"o{(corner + turn) % 4}"


# Two-way roads and streets ------------------------------------------------------------------------

EGO_DIRECTION, ONCOMING_DIRECTION = ("a", "b", 1), ("b", "a", 0)
"""The two lanes of a two-way road."""
ROAD_M, ROAD_EGO_M, ROAD_SPEED, ROAD_SPACING_M = 1200.0, 160.0, 13.5, Bounds(22.0, 34.0)
STREET_M, STREET_EGO_M, STREET_SPEED, STREET_SPACING_M = 420.0, 110.0, 8.5, Bounds(22.0, 40.0)
"""Length, where the ego begins, desired speed in m/s, distances between centres."""
CROSSWALK_M = 12.0
"""People cross an arm of the intersection this far before its end."""


def two_way(rng: np.random.Generator) -> Stage:
    """Build one lane in each direction at about 13 m/s; nobody overtakes."""
    flow = Flow(_two_way_roads(ROAD_M))
    lanes = (EGO_DIRECTION, ONCOMING_DIRECTION)
    inflow = Inflow(rng, lanes, lambda *_: None, "urban", ROAD_SPEED, headway_s=2.6)
    ego = inflow.ego = inflow.place(flow, EGO_DIRECTION, ROAD_EGO_M, EGO)
    sections = (
        (EGO_DIRECTION, ROAD_EGO_M, ROAD_EGO_M + 260.0),
        (ONCOMING_DIRECTION, 10.0, ROAD_M - 20.0),
    )
    for lane_index, first, last in sections:
        for along_m in _positions(rng, first, last, ROAD_SPACING_M):
            inflow.place(flow, lane_index, along_m, draw_body("urban", rng))
    along_m = ROAD_EGO_M - float(rng.uniform(*ROAD_SPACING_M))
    while along_m > 10.0:
        inflow.place(flow, EGO_DIRECTION, along_m, draw_body("urban", rng))
        along_m -= float(rng.uniform(*ROAD_SPACING_M))
    return Stage(flow, ego, rules=(inflow,))


@cache
def _two_way_roads(length_m: float) -> Roads:
    from highway_env.envs.two_way_env import TwoWayEnv

    return Roads(network_of(TwoWayEnv, length=length_m).network)


def street(rng: np.random.Generator) -> Stage:
    """Build a street with one lane in each direction; people walk, wait, cycle and cross."""
    roads = _two_way_roads(STREET_M)
    flow = Flow(roads)
    lanes = (EGO_DIRECTION, ONCOMING_DIRECTION)
    inflow = Inflow(rng, lanes, lambda *_: None, "urban", STREET_SPEED, headway_s=5.0)
    ego = inflow.ego = inflow.place(flow, EGO_DIRECTION, STREET_EGO_M, EGO)
    for lane_index, first, last in (
        (EGO_DIRECTION, STREET_EGO_M, 380.0),
        (ONCOMING_DIRECTION, 20.0, 400.0),
    ):
        for along_m in _positions(rng, first, last, STREET_SPACING_M):
            inflow.place(flow, lane_index, along_m, draw_body("urban", rng))
    width_m = sum(float(roads.lane(lane).width_at(0.0)) for lane in lanes)
    for kerb in [Kerb(flow, lane_index, width_m) for lane_index in lanes]:
        _populate(kerb, rng)
    return Stage(flow, ego, warm_up_s=1.0, rules=(inflow, People(STEP_S)))


def stepping_out(rng: np.random.Generator) -> Stage:
    """Build a street in which people step out in front of the ego without looking."""
    roads = _two_way_roads(STREET_M)
    flow = Flow(roads)
    lanes = (EGO_DIRECTION, ONCOMING_DIRECTION)
    inflow = Inflow(rng, lanes, lambda *_: None, "urban", STREET_SPEED, headway_s=7.0)
    ego = inflow.ego = inflow.place(flow, EGO_DIRECTION, STREET_EGO_M, EGO)
    for along_m in _positions(rng, 20.0, 400.0, STREET_SPACING_M):
        inflow.place(flow, ONCOMING_DIRECTION, along_m, draw_body("urban", rng))
    width_m = sum(float(roads.lane(lane).width_at(0.0)) for lane in lanes)
    right, left = (Kerb(flow, lane_index, width_m) for lane_index in lanes)
    _populate(left, rng)
    waiting = {}
    along_m = STREET_EGO_M + float(rng.uniform(35.0, 50.0))
    while along_m < right.length_m - 40.0:
        waiting[right.wait(rng, along_m)] = StepOut.draw(rng)
        along_m += float(rng.uniform(30.0, 45.0))
    for along_m in rng.uniform(STREET_EGO_M, right.length_m - 30.0, 5):
        right.walk(rng, float(along_m), ends=Bounds(5.0, right.length_m - 5.0))
    rules = (inflow, People(STEP_S), StepOuts(ego, waiting))
    return Stage(flow, ego, warm_up_s=1.0, rules=rules)


def town_crossing(rng: np.random.Generator) -> Stage:
    """Build an intersection with people at all corners."""
    roads, conflicts = _crossing_roads()
    flow = Flow(roads)
    inflow = Inflow(rng, ARMS, _any_arm, "urban", ARM_SPEED, headway_s=4.5)
    ego = inflow.line_up_all(flow, Bounds(8.0, 18.0), EGO_RANK)
    for source in ARMS:
        kerb = Kerb(flow, source, 2 * float(roads.lane(source).width_at(0.0)))
        edge_m = kerb.length_m - CROSSWALK_M
        for along_m in rng.uniform(edge_m - 50.0, edge_m, 3):
            kerb.walk(rng, float(along_m), ends=Bounds(5.0, kerb.length_m - 2.0))
        kerb.cross(rng, edge_m, coming_m=float(rng.uniform(1.0, 14.0)))
        kerb.add_cyclist(rng, float(rng.uniform(edge_m - 60.0, edge_m - 25.0)), end_m=edge_m)
    rules = (inflow, Crossing(conflicts), People(STEP_S))
    return Stage(flow, ego, warm_up_s=2.0, rules=rules)


def _positions(
    rng: np.random.Generator, first: float, last: float, spacing_m: Bounds
) -> Iterator[float]:
    """Yield positions along a lane between the first and the last; each is drawn when needed."""
    along_m = first + float(rng.uniform(*spacing_m))
    while along_m < last:
        yield along_m
        along_m += float(rng.uniform(*spacing_m))


def _populate(kerb: Kerb, rng: np.random.Generator) -> None:
    """Add people on one side of a street."""
    ends = Bounds(5.0, kerb.length_m - 5.0)
    along_m = 20.0
    while along_m < kerb.length_m - 30.0:
        kerb.walk(rng, along_m, ends=ends)
        along_m += float(rng.uniform(10.0, 26.0))
    for crossing_m in rng.uniform(60.0, kerb.length_m - 60.0, 5):
        kerb.cross(rng, float(crossing_m), coming_m=float(rng.uniform(1.0, 12.0)))
    for start_m in rng.uniform(20.0, kerb.length_m - 120.0, 3):
        kerb.add_cyclist(rng, float(start_m), end_m=kerb.length_m - 5.0)


# Racetrack ----------------------------------------------------------------------------------------


def racetrack(rng: np.random.Generator) -> Stage:
    """Build two lanes in a loop of about 350 m, at 5 to 10 m/s; nobody changes lanes."""
    return _filled_track(rng, spacing_m=24.0, speeds=Bounds(8.0, 10.0))


def racetrack_loop(rng: np.random.Generator) -> Stage:
    """Build the racetrack with larger gaps, so that the ego completes a lap within 70 s."""
    return _filled_track(rng, spacing_m=36.0, speeds=Bounds(9.0, 11.0))


def _filled_track(rng: np.random.Generator, *, spacing_m: float, speeds: Bounds) -> Stage:
    roads, drivers = _racetrack_roads(), []
    for side in (0, 1):
        along_m = float(rng.uniform(5.0, spacing_m))
        for start, ends in roads.network.graph.items():
            for end, lanes in ends.items():
                length = float(lanes[side].length)
                while along_m < length - 1.0:
                    desired_speed = float(rng.uniform(*speeds))
                    body = draw_body("tight", rng)
                    driver = DriverSetup(body, (start, end, side), along_m, 4.5, desired_speed)
                    drivers.append(driver.vary(rng))
                    along_m += spacing_m * float(rng.uniform(0.85, 1.4))
                along_m -= length
    ego = int(rng.integers(len(drivers)))
    drivers[ego].set_body(EGO)
    flow = Flow(roads)
    numbers = [flow.add_driver(driver) for driver in drivers]
    return Stage(flow, numbers[ego], warm_up_s=3.0)


@cache
def _racetrack_roads() -> Roads:
    from highway_env.envs.racetrack_env import RacetrackEnv

    return Roads(network_of(RacetrackEnv).network)


# Car park -----------------------------------------------------------------------------------------

AISLE_END_M, AISLE_OFFSET_M = 50.0, 3.0
"""Half the length of the aisle, and how far each of its lanes lies from its middle."""
EAST, WEST = ("w", "e", 0), ("e2", "w2", 0)
"""The lanes of the aisle."""
OCCUPIED_SHARE = 0.75
"""Share of the spots that are taken; chosen by hand."""


def parking_lot(rng: np.random.Generator) -> Stage:
    """Build a car park with 28 spots, three quarters of them taken, and traffic at 3 m/s."""
    flow = Flow(_parking_roads())
    spots = [("a", "b", i) for i in range(14)] + [("b", "c", i) for i in range(14)]
    for spot in spots:
        if rng.random() < OCCUPIED_SHARE:
            along_m = 4.0 + float(rng.uniform(-0.6, 0.6))
            body, reverse = draw_body("parked", rng), bool(rng.random() < 0.3)
            flow.park(spot, along_m, body, reverse=reverse)
    ego = _driving_slowly(flow, rng, EAST, 18.0, is_ego=True)
    for lane_index, positions in ((EAST, (4.0, 36.0, 52.0)), (WEST, (8.0, 27.0, 46.0, 62.0))):
        for along_m in positions:
            if rng.random() < 0.8:
                _driving_slowly(flow, rng, lane_index, along_m + float(rng.uniform(-3.0, 3.0)))
    return Stage(flow, ego, rules=(Outflow(ego),))


@cache
def _parking_roads() -> Roads:
    from highway_env.envs.parking_env import ParkingEnv
    from highway_env.road.lane import LineType, StraightLane

    network = network_of(ParkingEnv, builder="_create_road").network
    end_m, offset_m = AISLE_END_M, AISLE_OFFSET_M
    no_lines = (LineType.NONE, LineType.NONE)
    east = StraightLane([-end_m, offset_m], [end_m, offset_m], line_types=no_lines)
    west = StraightLane([end_m, -offset_m], [-end_m, -offset_m], line_types=no_lines)
    network.add_lane(*EAST[:2], east)
    network.add_lane(*WEST[:2], west)
    return Roads(network)


def _driving_slowly(
    flow: Flow,
    rng: np.random.Generator,
    lane_index: LaneIndex,
    along_m: float,
    *,
    is_ego: bool = False,
) -> int:
    body = EGO if is_ego else draw_body("parked", rng)
    speed = float(rng.uniform(2.4, 3.4))
    route = [flow.roads.road_number(lane_index)]
    return flow.add_driver(
        DriverSetup(body, lane_index, along_m, speed, speed, route=route).vary(rng)
    )
