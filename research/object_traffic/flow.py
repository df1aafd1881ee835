"""A highway-env road that finds neighbours for all vehicles at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.road.road import Road

from research.object_traffic.driving import Driver
from research.object_traffic.lanes import along_direction, coordinates
from roadscope.envs.traffic.lane_geometry import LOOK_AHEAD_M
from roadscope.envs.traffic.neighbours import MARGIN_M


class FlowRoad(Road):  # type: ignore[misc]
    """A road for `Driver`s of any size.

    Leaders are searched along the route, also beyond the end of a lane, with true widths. Lane
    coordinates are computed for all bodies together, once for each step and lane.
    """

    def __init__(self, network: Any, rng: np.random.Generator) -> None:
        super().__init__(network=network, np_random=rng)
        self._next: dict[Any, list[Any]] = {}
        self._previous: dict[Any, list[Any]] = {}
        self.now_s = 0.0
        self.refresh()

    def refresh(self) -> None:
        """Collect positions, sizes and speeds of all bodies; to be called after they moved."""
        bodies = self.vehicles + self.objects
        for slot, body in enumerate(bodies):
            body.slot = slot
        self.bodies = bodies
        self.positions = np.array([b.position for b in bodies]).reshape(-1, 2)
        self.lengths = np.array([b.LENGTH for b in bodies])
        self.widths = np.array([b.WIDTH for b in bodies])
        headings = np.array([b.heading for b in bodies], np.float64)
        self.directions = np.stack([np.cos(headings), np.sin(headings)], axis=-1)
        half = self.lengths[:, None] / 2 * self.directions
        self._points = np.concatenate(
            [self.positions, self.positions + half, self.positions - half]
        )
        self.velocities = np.array([b.velocity for b in bodies]).reshape(-1, 2)
        self._coordinates: dict[Any, tuple[np.ndarray, np.ndarray]] = {}
        self._changing: dict[Any, list[int]] = {}
        for vehicle in self.vehicles:
            self._note_change(vehicle)

    def lane_coordinates(self, lane_index: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return the lane coordinates of every body, metres.

        Two arrays (3, B): along the lane and across it; rows are centre, front and rear.
        """
        if lane_index not in self._coordinates:
            along, across = coordinates(self.network.get_lane(lane_index), self._points)
            self._coordinates[lane_index] = along.reshape(3, -1), across.reshape(3, -1)
        return self._coordinates[lane_index]

    def along(self, vehicle: Any, lane_index: Any) -> float:
        """Return the longitudinal lane coordinate of a vehicle's centre, metres."""
        return float(self.lane_coordinates(lane_index)[0][0, vehicle.slot])

    def act(self) -> None:
        """Let every driver decide in turn; each knows the decisions of those before it."""
        self.refresh()
        for vehicle in self.vehicles:
            vehicle.act()
            self._note_change(vehicle)

    def step(self, dt: float) -> None:
        """Move all vehicles, update their lanes, and check close pairs for collisions."""
        for vehicle in self.vehicles:
            vehicle.step(dt)
        self.now_s += dt
        self.refresh()
        for vehicle in self.vehicles:
            if isinstance(vehicle, Driver):
                self._update_lane(vehicle)
        for i, j in self._close_pairs(dt):
            self.bodies[i].handle_collisions(self.bodies[j], dt)

    def next_lane(self, lane_index: Any, route: Any = None) -> Any:
        """Return the next lane along a route, or None at the end of the road."""
        if route and route[-1][:2] == lane_index[:2]:
            return None
        options = self._next_lanes(lane_index)
        legs = [leg[:2] for leg in route or () if leg[:2] != lane_index[:2]]
        if legs:
            options = [option for option in options if option[:2] == legs[0]]
        return options[0] if options else None

    def lanes_ahead(self, vehicle: Any, lane_index: Any) -> list[tuple[Any, float]]:
        """Return the lanes ahead with the distance in metres to the start of each."""
        start, lanes = -self.along(vehicle, lane_index), []
        route = list(vehicle.route) if vehicle.route else None
        while lane_index is not None and start < LOOK_AHEAD_M:
            lanes.append((lane_index, start))
            start += float(self.network.get_lane(lane_index).length)
            if route and route[0][:2] == lane_index[:2]:
                route = route[1:] or route
            lane_index = self.next_lane(lane_index, route)
        return lanes

    def leader(self, vehicle: Any, lane_index: Any) -> tuple[float, float] | None:
        """Return the bumper-to-bumper gap in metres and the speed of the vehicle ahead, m/s."""
        for index, start in self.lanes_ahead(vehicle, lane_index):
            lane = self.network.get_lane(index)
            along, _ = self.lane_coordinates(index)
            points = self._in_path(index, vehicle) & (along > -1.0) & (along < lane.length + 3.0)
            points &= (start + along[0] > 0.0) & ~self._is_oncoming(vehicle)
            points[:, vehicle.slot] = False
            if points.any():
                nearest = np.where(points, along, np.inf).min(axis=0)
                slot = int(nearest.argmin())
                heading = lane.heading_at(float(along[0, slot]))
                ahead = np.array([np.cos(heading), np.sin(heading)])
                gap = start + nearest[slot] - vehicle.LENGTH / 2
                return float(gap), max(float(along_direction(self.velocities[slot], ahead)), 0.0)
        return None

    def neighbour_vehicles(self, vehicle: Any, lane_index: Any = None) -> tuple[Any, Any]:
        """Return the vehicles ahead and behind, on a lane and on the lanes that lead to it."""
        lane_index = lane_index or vehicle.lane_index
        here = self.along(vehicle, lane_index)
        segments = [(lane_index, 0.0)]
        following = self.next_lane(lane_index, vehicle.route)
        if following is not None:
            segments.append((following, float(self.network.get_lane(lane_index).length)))
        segments += [
            (i, -float(self.network.get_lane(i).length)) for i in self._previous_lanes(lane_index)
        ]
        ahead, behind = (np.inf, None), (-np.inf, None)
        for index, start in segments:
            along = self.lane_coordinates(index)[0][0]
            length = float(self.network.get_lane(index).length)
            mask = (
                self._in_path(index, vehicle).any(axis=0) & (along >= -1.0) & (along < length + 1.0)
            )
            mask[vehicle.slot] = False
            offset_m = np.where(mask, along + start - here, np.nan)
            front, rear = (
                np.where(offset_m >= 0, offset_m, np.inf),
                np.where(offset_m < 0, offset_m, -np.inf),
            )
            if front.min() < ahead[0]:
                ahead = (front.min(), self.bodies[int(front.argmin())])
            if rear.max() > behind[0]:
                behind = (rear.max(), self.bodies[int(rear.argmax())])
        return ahead[1], behind[1]

    def _is_oncoming(self, vehicle: Any) -> np.ndarray:
        """Return (B,) whether a body faces a vehicle, so that it keeps to its side of the road."""
        ahead = np.array([np.cos(vehicle.heading), np.sin(vehicle.heading)])
        facing: np.ndarray = along_direction(self.directions, ahead) < -0.7
        return facing

    def _in_path(self, lane_index: Any, vehicle: Any) -> np.ndarray:
        """Return (3, B) whether a body blocks a vehicle on that lane, or changes to that lane."""
        _, across = self.lane_coordinates(lane_index)
        inside: np.ndarray = np.abs(across) < (self.widths + vehicle.WIDTH) / 2 + MARGIN_M
        for slot in self._changing.get(lane_index, ()):
            inside[:, slot] = True
        return inside

    def _note_change(self, vehicle: Any) -> None:
        """Record that a vehicle changes lanes, so that vehicles on the target lane know."""
        target, lane_index = vehicle.target_lane_index, vehicle.lane_index
        if target != lane_index and target[:2] == lane_index[:2]:
            self._changing.setdefault(target, []).append(vehicle.slot)

    def _update_lane(self, vehicle: Driver) -> None:
        """Set the lane of a vehicle: the nearest of the target lane and those beside it."""
        target = vehicle.target_lane_index
        best, least = target, np.inf
        for index in self.network.all_side_lanes(target):
            across = abs(float(self.lane_coordinates(index)[1][0, vehicle.slot]))
            if across < least - 1e-9:
                best, least = index, across
        if not vehicle.enable_lane_change:
            best = target
        vehicle.lane_index, vehicle.lane = best, self.network.get_lane(best)

    def _close_pairs(self, dt: float) -> list[tuple[int, int]]:
        """Return pairs of bodies that may touch, in order; at least one is a vehicle."""
        radii = np.hypot(self.lengths, self.widths) / 2
        speeds = np.hypot(self.velocities[:, 0], self.velocities[:, 1])
        distances = np.linalg.norm(self.positions[:, None] - self.positions[None], axis=-1)
        near = distances <= radii[:, None] + radii[None] + speeds[:, None] * dt + 0.1
        rows, columns = np.nonzero(np.triu(near, 1))
        movers = len(self.vehicles)
        return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if i < movers]

    def _next_lanes(self, lane_index: Any) -> list[Any]:
        """Return the lanes that begin where a lane ends: one of each road, nearest first."""
        if lane_index not in self._next:
            lane = self.network.get_lane(lane_index)
            end = lane.position(lane.length, 0.0)
            nearest = []
            for to, lanes in self.network.graph.get(lane_index[1], {}).items():
                distances = [
                    float(np.linalg.norm(other.position(0.0, 0.0) - end)) for other in lanes
                ]
                closest = int(np.argmin(distances))
                nearest.append((distances[closest], (lane_index[1], to, closest)))
            self._next[lane_index] = [option for _, option in sorted(nearest)]
        return self._next[lane_index]

    def _previous_lanes(self, lane_index: Any) -> list[Any]:
        """Return the lanes that end where a lane begins."""
        if lane_index not in self._previous:
            start = self.network.get_lane(lane_index).position(0.0, 0.0)
            self._previous[lane_index] = [
                (origin, lane_index[0], i)
                for origin, roads in self.network.graph.items()
                for i, other in enumerate(roads.get(lane_index[0], []))
                if np.linalg.norm(other.position(other.length, 0.0) - start) < 2.0
            ]
        return self._previous[lane_index]
