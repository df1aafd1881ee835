"""A road network as arrays: lanes, roads, and which lanes lead to which."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from roadscope.envs.traffic.conversion import road_map
from roadscope.envs.traffic.road_maps import RoadMap

CURVE_LATERAL_M_S2 = 1.9
"""Lateral acceleration at which drivers take curves; chosen by hand."""
CONNECTED_M = 2.0
"""A lane leads to another one if its end is this close to the start of that one."""
STRAIGHT, SINE, CIRCULAR = 0, 1, 2
"""Kinds of lanes."""

LaneIndex = tuple[str, str, int]
"""A lane of highway-env: from node, to node, number from the left."""


class LaneRecord(Protocol):
    """A record of a lane in highway-env's frame; metres and radians.

    kind: `STRAIGHT`, `SINE` or `CIRCULAR`.
    x, y: start of a straight or sine lane, centre of a circular one.
    along_x, along_y, across_x, across_y: unit vectors of a straight lane.
    heading: of a straight lane. amplitude, pulsation, phase: of a sine lane.
    radius, start_phase, turn: of a circular lane; turn is 1 for clockwise, seen from above, or -1.
    centre: number of the centre of a circular lane in `RoadArrays.centres`, -1 for other lanes.
    speed_squared: squared speed that speed limit and curvature allow, m^2/s^2; inf without either.
    forbidden: whether drivers may not change to it and have to leave it, as a ramp that ends.
    road, number: the lane's road, and its number on it.
    box_x, box_y, half_x, half_y: centre and half sides of a box around the centre line.
    """

    kind: int
    x: float
    y: float
    along_x: float
    along_y: float
    across_x: float
    across_y: float
    heading: float
    length: float
    width: float
    amplitude: float
    pulsation: float
    phase: float
    radius: float
    start_phase: float
    turn: float
    centre: int
    speed_squared: float
    forbidden: bool
    road: int
    number: int
    box_x: float
    box_y: float
    half_x: float
    half_y: float


class RoadRecord(Protocol):
    """A record of a road.

    start, end: numbers of its nodes. first: number of its first lane. count: of its lanes.
    """

    start: int
    end: int
    first: int
    count: int


_KINDS = {"int": np.int64, "float": np.float64, "bool": np.bool_}


def record_type(protocol: type) -> np.dtype[Any]:
    """Return the structured type with the fields of a protocol."""
    fields = protocol.__annotations__.items()
    return np.dtype([(name, _KINDS[str(kind)]) for name, kind in fields])


LANE, ROAD = record_type(LaneRecord), record_type(RoadRecord)


class RoadArrays(NamedTuple):
    """A network for kernels.

    lanes: (L,) of `LANE`; roads: (R,) of `ROAD`.
    onward: (L, M) lanes that begin where a lane ends: one of each road, nearest first; then -1.
    exits: (L, M) roads that leave the node where a lane ends, in the network's order; then -1.
    sources: (L, P) lanes that end where a lane begins; then -1.
    centres: (C, 2) centres of circular lanes.
    """

    lanes: np.ndarray
    roads: np.ndarray
    onward: np.ndarray
    exits: np.ndarray
    sources: np.ndarray
    centres: np.ndarray


class Roads:
    """A network of highway-env: its lanes by index, as arrays and as a map. It never changes.

    has_sine_lanes: whether any lane is a sine lane, whose headings contain an arctangent.
    """

    def __init__(self, network: Any) -> None:
        self.network = network
        self.lane_numbers: dict[LaneIndex, int] = {
            index: number for number, index in enumerate(network.lanes_dict())
        }
        self._routes: dict[tuple[LaneIndex, str], list[int]] = {}
        self._road_numbers: dict[tuple[str, str], int] = {}
        for start, end, _ in self.lane_numbers:
            self._road_numbers.setdefault((start, end), len(self._road_numbers))
        self._nodes: dict[str, int] = {}
        for node in (node for road in self._road_numbers for node in road):
            self._nodes.setdefault(node, len(self._nodes))
        self.arrays = self._arrays()
        self.has_sine_lanes = bool((self.arrays.lanes["kind"] == SINE).any())

    @cached_property
    def map(self) -> RoadMap:
        """The lanes as polylines in the world's frame."""
        return road_map(self.network)

    def lane(self, index: LaneIndex) -> Any:
        """Return a lane of highway-env."""
        return self.network.get_lane(index)

    @property
    def road_names(self) -> list[tuple[str, str]]:
        """The nodes of each road, by number."""
        return list(self._road_numbers)

    def road_number(self, index: LaneIndex) -> int:
        """Return the number of a lane's road."""
        return self._road_numbers[index[:2]]

    def route(self, source: LaneIndex, goal: str) -> list[int]:
        """Return the roads from a lane to a node, the lane's own road first."""
        key = source, goal
        if key not in self._routes:
            nodes = self.network.shortest_path(source[1], goal)
            legs = itertools.pairwise(nodes)
            self._routes[key] = [self.road_number(source), *(self._road_numbers[x] for x in legs)]
        return self._routes[key]

    def _arrays(self) -> RoadArrays:
        centres: list[tuple[float, float]] = []
        lanes = np.zeros(len(self.lane_numbers), LANE)
        for record, index in zip(lanes, self.lane_numbers, strict=True):
            _describe(record, self.lane(index), centres)
            record["road"], record["number"] = self.road_number(index), index[2]
        graph, nodes = self.network.graph, self._nodes
        roads = [
            (nodes[a], nodes[b], self.lane_numbers[a, b, 0], len(graph[a][b]))
            for a, b in self._road_numbers
        ]
        return RoadArrays(
            lanes,
            np.array(roads, ROAD),
            self._table(self._onward),
            self._table(self._exits),
            self._table(self._sources),
            np.array(centres, np.float64).reshape(-1, 2),
        )

    def _table(self, numbers_of: Callable[[LaneIndex], list[int]]) -> np.ndarray:
        """Return (L, M) numbers of each lane, -1 where it has fewer than the others."""
        rows = [numbers_of(index) for index in self.lane_numbers]
        table = np.full((len(rows), max(map(len, rows)) + 1), -1, np.int64)
        for row, numbers in zip(table, rows, strict=True):
            row[: len(numbers)] = numbers
        return table

    def _onward(self, index: LaneIndex) -> list[int]:
        lane = self.lane(index)
        end = lane.position(lane.length, 0.0)
        nearest = []
        for to, lanes in self.network.graph.get(index[1], {}).items():
            distances = [float(np.linalg.norm(other.position(0.0, 0.0) - end)) for other in lanes]
            closest = int(np.argmin(distances))
            nearest.append((distances[closest], (index[1], to, closest)))
        return [self.lane_numbers[option] for _, option in sorted(nearest)]

    def _exits(self, index: LaneIndex) -> list[int]:
        return [self._road_numbers[index[1], to] for to in self.network.graph.get(index[1], {})]

    def _sources(self, index: LaneIndex) -> list[int]:
        start = self.lane(index).position(0.0, 0.0)
        return [
            self.lane_numbers[origin, index[0], i]
            for origin, roads in self.network.graph.items()
            for i, other in enumerate(roads.get(index[0], []))
            if np.linalg.norm(other.position(other.length, 0.0) - start) < CONNECTED_M
        ]


def greatest_curvature(lane: Any) -> float:
    """Return the largest curvature of a straight, sine or circular lane in 1/m."""
    from highway_env.road.lane import SineLane, StraightLane

    if isinstance(lane, SineLane):
        return float(lane.amplitude * lane.pulsation**2)
    return 0.0 if isinstance(lane, StraightLane) else 1.0 / float(lane.radius)


def _describe(record: Any, lane: Any, centres: list[tuple[float, float]]) -> None:
    """Write a lane of highway-env to a record, and its centre to a list if it has one."""
    from highway_env.road.lane import CircularLane, SineLane, StraightLane

    record["centre"] = -1
    if isinstance(lane, StraightLane):
        record["kind"] = SINE if isinstance(lane, SineLane) else STRAIGHT
        record["x"], record["y"] = lane.start
        record["along_x"], record["along_y"] = lane.direction
        record["across_x"], record["across_y"] = lane.direction_lateral
        record["heading"] = lane.heading
        if isinstance(lane, SineLane):
            record["amplitude"], record["pulsation"] = lane.amplitude, lane.pulsation
            record["phase"] = lane.phase
    elif isinstance(lane, CircularLane):
        record["kind"] = CIRCULAR
        record["x"], record["y"] = lane.center
        record["radius"], record["start_phase"] = lane.radius, lane.start_phase
        record["turn"] = lane.direction
        centre = float(lane.center[0]), float(lane.center[1])
        if centre not in centres:
            centres.append(centre)
        record["centre"] = centres.index(centre)
    else:
        raise TypeError(f"traffic knows straight, sine and circular lanes, not {type(lane)}")
    record["length"], record["width"] = lane.length, lane.width
    record["forbidden"] = lane.forbidden
    limit, curvature = lane.speed_limit or np.inf, greatest_curvature(lane)
    if curvature > 0:
        limit = min(limit, np.sqrt(CURVE_LATERAL_M_S2 / curvature))
    record["speed_squared"] = float(limit) ** 2
    count = 2 if record["kind"] == STRAIGHT else int(lane.length) + 2
    along = np.linspace(0.0, float(lane.length), count)
    points = np.array([lane.position(s, 0.0) for s in along])
    low, high = points.min(axis=0), points.max(axis=0)
    record["box_x"], record["box_y"] = (low + high) / 2
    record["half_x"], record["half_y"] = (high - low) / 2
