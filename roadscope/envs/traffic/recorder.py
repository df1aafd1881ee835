"""Records highway-env's traffic at every physics sub-step."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from highway_env.road.regulation import RegulatedRoad
from highway_env.road.road import Road
from highway_env.vehicle.dynamics import BicycleVehicle
from highway_env.vehicle.objects import Landmark

from roadscope.envs.traffic.agent_road import AgentRoad
from roadscope.envs.traffic.conversion import ForeignEnvError, refuse_multi_agent, road_map
from roadscope.envs.traffic.mix import EGO, RoadUserBody, draw_body
from roadscope.envs.traffic.recording import (
    RecordedMotion,
    Samples,
    obstacles_of,
    tabulate,
    timeline_of,
)
from roadscope.envs.traffic.road_maps import RoadMap
from roadscope.envs.traffic.timeline import Timeline


class RecordedRoad(Road):  # type: ignore[misc]
    """A road of highway-env whose recorder records every step."""

    recorder: TrafficRecorder

    def step(self, dt: float) -> None:
        """Step the traffic, then record it."""
        super().step(dt)
        self.recorder.tick(self, dt)


class RecordedRegulatedRoad(RegulatedRoad):  # type: ignore[misc]
    """A regulated road whose recorder records every step."""

    recorder: TrafficRecorder

    def step(self, dt: float) -> None:
        """Step the traffic, then record it."""
        super().step(dt)
        self.recorder.tick(self, dt)


RECORDED = {Road: RecordedRoad, RegulatedRoad: RecordedRegulatedRoad, AgentRoad: AgentRoad}


@dataclass(frozen=True, slots=True)
class _RecordedVehicle:
    """Constant properties of a recorded vehicle.

    ahead_m: distance of its centre ahead of its rear axle.
    slides: whether it is one of highway-env's dynamic bicycle models, whose speed is along the
        heading and whose slip does not follow from the steering.
    """

    body: RoadUserBody
    ahead_m: float
    slides: bool


@dataclass(frozen=True, slots=True)
class RecordedStates:
    """N vehicles at one instant, in highway-env's frame and order; never changed.

    centres: (N, 2) metres. headings, steering: (N,) radians. speeds: (N,) m/s. crashed: (N,).
    """

    stamp_s: float
    ids: list[int]
    centres: np.ndarray
    headings: Sequence[float] | np.ndarray
    speeds: Sequence[float] | np.ndarray
    steering: Sequence[float] | np.ndarray
    crashed: Sequence[bool] | np.ndarray


class TrafficRecorder:
    """Records a timeline of a highway-env road; the ego is actor 0.

    seed: draws categories and sizes of vehicles that have none of their own; it never touches
        the environment's randomness.
    raw: whether the motion may be unphysical, as in foreign environments.
    """

    def __init__(
        self, *, seed: int | np.random.SeedSequence = 0, style: str = "bare", raw: bool = True
    ) -> None:
        self._seed = (
            seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
        )
        self._style = style
        self._raw = raw
        self._snapshots: list[RecordedStates] = []
        self._actors: list[_RecordedVehicle] = []
        self._road: Any = None
        self._map: RoadMap | None = None
        # Of the latest run of equal steps: its start, the length of a step, and their number.
        self._equal_steps: tuple[float, float, int] = (0.0, 0.0, 0)

    def attach(self, env: Any) -> None:
        """Start a new recording on the road of an environment that was just reset."""
        refuse_multi_agent(env)
        inner = env.unwrapped
        kind = type(inner.road)
        if kind in RECORDED:
            inner.road.__class__ = RECORDED[kind]
        elif kind not in RECORDED.values():
            raise ForeignEnvError(
                f"cannot record a {kind.__name__}; known: {', '.join(k.__name__ for k in RECORDED)}"
            )
        inner.road.recorder = self
        self.follow(inner.road, inner.vehicle)

    def follow(self, road: Any, ego: Any) -> None:
        """Start a new recording on a road; the caller calls `tick` after each step."""
        self._road, self._map = road, None
        self._snapshots, self._actors = [], []
        self._equal_steps = (0.0, 0.0, 0)
        for vehicle in road.vehicles:
            vars(vehicle).pop("actor_id", None)
        self._admit(ego)
        self._record(road, 0.0)

    def tick(self, road: Any, dt: float) -> None:
        """Record the road a time `dt` in seconds after the last record."""
        since_s, last_dt, count = self._equal_steps
        # Counting equal steps keeps stamps free of summed rounding.
        since_s, count = (since_s, count + 1) if dt == last_dt else (self.stamp_s, 1)
        self._equal_steps = (since_s, dt, count)
        self._record(road, since_s + count * dt)

    @property
    def road(self) -> Any:
        """The road that is recorded."""
        return self._road

    @property
    def stamp_s(self) -> float:
        """Seconds of physics since the start."""
        return self._snapshots[-1].stamp_s

    def timeline(self, last_s: float | None = None) -> Timeline:
        """Return the recording, or its last seconds (with at least one more sample before them)."""
        first = 0
        if last_s is not None:
            since_s = self.stamp_s - last_s
            first = bisect.bisect_right(self._snapshots, since_s, key=lambda s: s.stamp_s) - 1
        return self._assemble(self._snapshots[max(first, 0) :])

    def __deepcopy__(self, memo: dict[int, Any]) -> TrafficRecorder:
        """Copy the recorder, sharing the snapshots, which never change."""
        from copy import deepcopy

        twin = TrafficRecorder.__new__(TrafficRecorder)
        memo[id(self)] = twin
        vars(twin).update(vars(self))
        twin._snapshots = list(self._snapshots)
        twin._actors = list(self._actors)
        twin._road = deepcopy(self._road, memo)
        return twin

    def _record(self, road: Any, stamp_s: float) -> None:
        by_kernels = isinstance(road, AgentRoad)
        vehicles = road.outdated_vehicles if by_kernels else road.vehicles
        try:
            ids = [v.actor_id for v in vehicles]
        except AttributeError:
            ids = [self._admit(v) for v in vehicles]
        if by_kernels:
            self._snapshots.append(_states_of_cars(stamp_s, ids, road.cars))
            return
        self._snapshots.append(
            RecordedStates(
                stamp_s,
                ids,
                np.array([v.position for v in vehicles]),
                [v.heading for v in vehicles],
                [v.speed for v in vehicles],
                [v.action["steering"] for v in vehicles],
                [v.crashed for v in vehicles],
            )
        )

    def _admit(self, vehicle: Any) -> int:
        """Return the id of a vehicle; a new vehicle is given an id and a body."""
        actor_id = vars(vehicle).get("actor_id")
        if actor_id is not None:
            return int(actor_id)
        vehicle.actor_id = actor = len(self._actors)
        slides = isinstance(vehicle, BicycleVehicle)
        self._actors.append(
            _RecordedVehicle(self._body(vehicle, actor), float(vehicle.LENGTH) / 2, slides)
        )
        return actor

    def _body(self, vehicle: Any, actor: int) -> RoadUserBody:
        own: RoadUserBody | None = getattr(vehicle, "body", None)
        if own is not None or actor == 0:
            return own or EGO
        key = (*self._seed.spawn_key, actor)
        child = np.random.SeedSequence(self._seed.entropy, spawn_key=key)
        return draw_body("foreign", np.random.default_rng(child))

    def _assemble(self, snapshots: list[RecordedStates]) -> Timeline:
        ids = np.array(sorted({i for s in snapshots for i in s.ids}))
        actors = [self._actors[i] for i in ids]
        samples = Samples(
            rows=np.repeat(np.arange(len(snapshots)), [len(s.ids) for s in snapshots]),
            columns=np.searchsorted(ids, [i for s in snapshots for i in s.ids]),
            centres=np.concatenate([s.centres for s in snapshots]),
            states=np.concatenate(
                [np.array((s.headings, s.speeds, s.steering)).T for s in snapshots]
            ),
            crashed=np.concatenate([s.crashed for s in snapshots]),
        )
        present, crashed, centres, states = tabulate(
            samples, snapshots=len(snapshots), actors=len(ids)
        )
        states[:, [actor.slides for actor in actors], 2] = 0.0
        if self._map is None:
            self._map = road_map(self._road.network)
        motion = RecordedMotion(
            np.array([s.stamp_s for s in snapshots]), present, crashed, centres, states
        )
        return timeline_of(
            motion,
            ids,
            [actor.body for actor in actors],
            np.array([actor.ahead_m for actor in actors]),
            road=self._map,
            style=self._style,
            raw=self._raw,
            obstacles=self._obstacles(),
        )

    def _obstacles(self) -> np.ndarray:
        solid = [o for o in self._road.objects if o.solid and not isinstance(o, Landmark)]
        places = [(*o.position, o.heading, o.LENGTH, o.WIDTH) for o in solid]
        return obstacles_of(np.array(places, np.float64).reshape(-1, 5))


def _states_of_cars(stamp_s: float, ids: list[int], cars: np.ndarray) -> RecordedStates:
    centres = np.stack([cars["x"], cars["y"]], axis=-1)
    arrays = (cars[name].copy() for name in ("heading", "speed", "steering", "crashed"))
    return RecordedStates(stamp_s, ids, centres, *arrays)
