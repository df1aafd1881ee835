"""Scripted scenarios: all motion is in closed form, drawn from the seed.

Each function takes the scenario's name, a seed and a duration in seconds (None: the scenario's own)
and returns the traffic.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.bounds import Bounds
from roadscope.envs.traffic.course import PEAK, winding
from roadscope.envs.traffic.mix import EGO, HEAVY_TRUCKS, MOTORCYCLES, RoadUserBody
from roadscope.envs.traffic.script import (
    REACH_M,
    Actor,
    Carriageways,
    Change,
    Lane,
    Reach,
    ScriptedMotion,
    StraightRoad,
    WindingRoad,
    any_car,
    any_van,
    times_until,
)
from roadscope.envs.traffic.timeline import Timeline

STANDING = ScriptedMotion(0.0, 0.0, 0.0)
EGO_SPEED_VARIATION_M_S = 0.8
"""Largest variation of the ego's speed; chosen by hand."""
TOWN_LIMIT_M_S = 22.0
"""A cold start below this speed is in town, above it on a motorway; chosen by hand."""

CUT_IN_LANE_M = 3.5
"""Width of the lanes in `cut_ins`."""
CUT_IN_ROAD = StraightRoad((CUT_IN_LANE_M, 0.0, -CUT_IN_LANE_M), CUT_IN_LANE_M, "motorway")

OCCLUSION_LANE_M = 3.6
OCCLUSION_LANES_M = (0.0, OCCLUSION_LANE_M, 2 * OCCLUSION_LANE_M, 3 * OCCLUSION_LANE_M + 1.0)
"""The lanes of the ego, of the lorry, of the overtakers and, behind a gap, of oncoming traffic."""
OCCLUSION_ROAD = StraightRoad(OCCLUSION_LANES_M, OCCLUSION_LANE_M, "motorway")
OVERTAKERS, ONCOMING = 4, 4
"""Numbers of overtaking and of oncoming cars."""

CONVOY_LANE_M, CONVOY_BEHIND_M = 3.4, 110.0
PLATOON_LANE_M, PLATOON_REACH_M = 3.6, Reach(130.0, 130.0)
JAM_REACH_M = Reach(170.0, 170.0)
QUEUE_M = 22.0
"""Longest queue before and behind a standing ego."""
PULL_M_S2, TOWN_M_S = 1.6, 14.0
"""Peak acceleration from rest, and the speed up to which it is used; beyond that speed the
acceleration is as gentle. Chosen by hand."""


def cut_ins(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive on the middle lane of three while others cut in.

    Two cars ahead change sides and pass each other at 5 m; a van overtakes and cuts in; a
    motorcycle pulls out from behind the ego and passes on the right; one more car overtakes.
    """
    rng = _generator(seed)
    times = _times(duration_s, 12.0)
    ego = ScriptedMotion(0.0, 0.0, float(rng.uniform(12.0, 15.0)))
    start, duration = float(rng.uniform(0.5, 1.5)), float(rng.uniform(4.3, 5.0))
    near = float(rng.uniform(22.0, 26.0))
    far = near + float(rng.uniform(10.5, 12.5))
    lanes = CUT_IN_LANE_M
    to_right = _beside(ego, rng, near, lanes, Change(start, duration, -2 * lanes))
    to_left = _beside(ego, rng, far, -lanes, Change(start, duration, 2 * lanes))
    actors = [
        Actor(ego, EGO),
        Actor(to_right, any_car(rng)),
        Actor(to_left, any_car(rng)),
        Actor(_cutting_in(ego, rng), any_van(rng)),
        Actor(_pulling_out(ego, rng), RoadUserBody(Category.MOTORCYCLE, MOTORCYCLES[2])),
        Actor(_overtaking(ego, rng), any_car(rng)),
        Actor(_beside(ego, rng, float(rng.uniform(-40.0, -34.0)), 0.0), any_car(rng)),
        Actor(_beside(ego, rng, float(rng.uniform(-32.0, -26.0)), -lanes), any_van(rng)),
    ]
    return CUT_IN_ROAD.timeline(actors, times)


def _beside(
    ego: ScriptedMotion,
    rng: np.random.Generator,
    ahead_m: float,
    left_m: float,
    *lane_changes: Change,
) -> ScriptedMotion:
    """Return a motion as fast as the ego's."""
    left_m += float(rng.uniform(-0.2, 0.2))
    return ScriptedMotion(ahead_m, left_m, ego.speed, lane_changes=lane_changes)


def _cutting_in(ego: ScriptedMotion, rng: np.random.Generator) -> ScriptedMotion:
    """Overtake on the left, move to the ego's lane as soon as there is space, slow down."""
    faster, behind = float(rng.uniform(6.0, 7.5)), float(rng.uniform(18.0, 24.0))
    passed_s = (behind + 7.5) / faster
    return ScriptedMotion(
        -behind,
        CUT_IN_LANE_M,
        ego.speed + faster,
        (Change(passed_s, 3.0, 0.3 - faster),),
        (Change(passed_s, 3.5, -CUT_IN_LANE_M),),
    )


def _pulling_out(ego: ScriptedMotion, rng: np.random.Generator) -> ScriptedMotion:
    """Follow the ego, change to the right lane and pass."""
    behind, start = float(rng.uniform(9.0, 12.0)), float(rng.uniform(1.0, 2.0))
    left_m = float(rng.uniform(-0.4, 0.4))
    return ScriptedMotion(
        -behind,
        left_m,
        ego.speed,
        (Change(start + 1.0, 3.0, float(rng.uniform(2.5, 3.5))),),
        (Change(start, 3.0, -CUT_IN_LANE_M + 0.3),),
    )


def _overtaking(ego: ScriptedMotion, rng: np.random.Generator) -> ScriptedMotion:
    """Stay on the left, slower than the van that cuts in, behind the car that changes to there."""
    start_m = float(rng.uniform(-48.0, -42.0))
    speed = ego.speed + float(rng.uniform(5.0, 5.8))
    return ScriptedMotion(start_m, CUT_IN_LANE_M, speed, (Change(8.0, 3.0, -5.0),))


def long_occlusion(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive beside a lorry while others pass behind it, in both directions.

    From the ego's roof the lorry hides about 35 m of the overtakers' lane: they are hidden for 2 to
    6 s, two at once, and change their speed meanwhile.
    """
    rng = _generator(seed)
    times = _times(duration_s, 12.0)
    ego = ScriptedMotion(0.0, 0.0, float(rng.uniform(11.0, 13.0)))
    beside = ScriptedMotion(
        float(rng.uniform(-7.5, -4.5)),
        OCCLUSION_LANE_M + _lateral_offset(rng),
        ego.speed + float(rng.uniform(-0.3, 0.3)),
    )
    lorry = RoadUserBody(Category.TRUCK, HEAVY_TRUCKS[0])
    follower = ScriptedMotion(beside.x_m - float(rng.uniform(12.0, 16.0)), beside.y_m, beside.speed)
    leader = ScriptedMotion(float(rng.uniform(20.0, 28.0)), _lateral_offset(rng), ego.speed)
    actors = [Actor(ego, EGO), Actor(beside, lorry), Actor(follower, any_car(rng))]
    actors += [Actor(leader, any_van(rng)), *_overtakers(rng, ego), *_oncoming(rng)]
    return OCCLUSION_ROAD.timeline(actors, times)


def _overtakers(rng: np.random.Generator, ego: ScriptedMotion) -> list[Actor]:
    """Return a row of cars that brake or accelerate together while the first two are hidden."""
    speed = ego.speed + float(rng.uniform(7.0, 10.0))
    start, duration = float(rng.uniform(3.0, 4.0)), float(rng.uniform(2.0, 3.0))
    change = Change(start, duration, float(rng.uniform(-3, 2)))
    x_m, row = float(rng.uniform(-42.0, -34.0)), []
    for _ in range(OVERTAKERS):
        motion = ScriptedMotion(x_m, 2 * OCCLUSION_LANE_M + _lateral_offset(rng), speed, (change,))
        row.append(Actor(motion, any_car(rng)))
        x_m -= float(rng.uniform(13.0, 22.0))
    return row


def _oncoming(rng: np.random.Generator) -> list[Actor]:
    speed, x_m, row = -float(rng.uniform(10.0, 13.0)), float(rng.uniform(40.0, 60.0)), []
    for _ in range(ONCOMING):
        motion = ScriptedMotion(x_m, OCCLUSION_LANES_M[-1] + _lateral_offset(rng), speed)
        row.append(Actor(motion, any_car(rng)))
        x_m += float(rng.uniform(25.0, 60.0))
    return row


def _lateral_offset(rng: np.random.Generator) -> float:
    return float(rng.uniform(-0.25, 0.25))


class PullAway(NamedTuple):
    """How a vehicle accelerates from standstill: when, up to which speed in m/s, how strongly."""

    start_s: float
    speed: float
    peak_m_s2: float


def convoy_pull_away(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Stand 2 to 4 s in an inner lane of three or four, then drive 250 to 450 m in 40 s.

    An articulated lorry or a rigid one stands on each side, more than half of the others are vans,
    lorries and buses. All lanes pull away within a second of each other, to speeds that differ by
    a few per cent. So the surroundings of the ego move with it, while the roadside, of which little
    is visible, does not.
    """
    rng = _generator(seed)
    times = _times(duration_s, 40.0)
    count = int(rng.integers(3, 5))
    ego_lane = int(rng.integers(1, count - 1))
    lanes = tuple(
        Lane((ego_lane - i) * CONVOY_LANE_M, "convoy", Bounds(1.5, 3.5), Bounds(0.2, 0.9))
        for i in range(count)
    )
    start_s, speed = float(rng.uniform(2.0, 4.0)), float(rng.uniform(9.0, 14.0))
    peak_m_s2, front_m = float(rng.uniform(0.9, 1.4)), float(rng.uniform(25.0, 90.0))
    reach = Reach(CONVOY_BEHIND_M, front_m)
    ego = Actor(_pulling_away(rng, PullAway(start_s, speed, peak_m_s2), 0.0, times[-1]), EGO)
    actors = [ego, *lanes[ego_lane].around(rng, ego, reach)]
    for lane in _other_lanes(lanes, ego_lane):
        later, faster = float(rng.uniform(-0.5, 0.5)), float(rng.uniform(0.95, 1.05))
        start = PullAway(start_s + later, speed * faster, peak_m_s2)
        beside = _pulling_away(rng, start, float(rng.uniform(-9.0, 1.0)), times[-1])
        lorry = RoadUserBody(Category.TRUCK, HEAVY_TRUCKS[int(rng.integers(2))])
        actors += lane.filled(rng, beside, reach, lorry)
    radius_m = speed**2 / float(rng.uniform(0.5, 1.2))
    course = winding(rng, Bounds(-CONVOY_BEHIND_M, speed * times[-1]), radius_m)
    return WindingRoad(course, lanes, CONVOY_LANE_M, "urban").timeline(actors, times)


def _pulling_away(
    rng: np.random.Generator, start: PullAway, x_m: float, until_s: float
) -> ScriptedMotion:
    """Return a motion from standstill up to a speed, which then stays almost constant."""
    duration = PEAK * start.speed / start.peak_m_s2
    motion = ScriptedMotion(x_m, 0.0, 0.0, (Change(start.start_s, duration, start.speed),))
    return motion.with_varying_speed(rng, Bounds(start.start_s + duration, until_s), 0.4)


def platoon(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive 18 to 27 m/s in an inner lane of three or four, with gaps of 10 to 18 m.

    All speeds vary together by up to 1 m/s; each vehicle's speed also varies alone by up to
    0.12 m/s, depending on the seed. More than half are vans, lorries and buses. The ego drives 540
    to 810 m in 30 s.
    """
    rng = _generator(seed)
    times = _times(duration_s, 30.0)
    count = int(rng.integers(3, 5))
    ego_lane = int(rng.integers(1, count - 1))
    lanes = tuple(
        Lane((ego_lane - i) * PLATOON_LANE_M, "convoy", Bounds(10.0, 18.0)) for i in range(count)
    )
    speed, variation_m_s = float(rng.uniform(18.0, 27.0)), float(rng.uniform(0.0, 0.12))
    interval_s = Bounds(-2.0, float(times[-1]))
    ego = Actor(ScriptedMotion(0.0, 0.0, speed).with_varying_speed(rng, interval_s, 1.0), EGO)
    others = lanes[ego_lane].around(rng, ego, PLATOON_REACH_M)
    for lane in _other_lanes(lanes, ego_lane):
        beside = ScriptedMotion(
            float(rng.uniform(-12.0, 4.0)), 0.0, speed, ego.motion.speed_changes
        )
        others += lane.filled(rng, beside, PLATOON_REACH_M)
    actors = [ego]
    for other in others:
        motion = other.motion.with_varying_speed(rng, interval_s, variation_m_s)
        actors.append(Actor(motion, other.body))
    end_m, radius_m = (speed + 1.0) * times[-1], speed**2 / float(rng.uniform(0.5, 1.2))
    course = winding(rng, Bounds(-PLATOON_REACH_M.behind, end_m), radius_m)
    return WindingRoad(course, lanes, PLATOON_LANE_M, "motorway").timeline(actors, times)


def cold_start(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive 15 to 35 m/s, by seed, from the first scan on: 375 to 875 m in 25 s.

    Two or three lanes in each direction, vehicles about 1.3 s behind one another, those to the left
    faster and those to the right slower; up to 22 m/s in town, above on a motorway.
    """
    rng = _generator(seed)
    times = _times(duration_s, 25.0)
    until, speed = float(times[-1]), float(rng.uniform(15.0, 35.0))
    style = "urban" if speed < TOWN_LIMIT_M_S else "motorway"
    count = int(rng.integers(2, 4))
    carriageways = Carriageways(count, int(rng.integers(count)), style, oncoming=count)
    actors = _flow(rng, carriageways, speed, until, faster_m_s=Bounds(1.5, 3.0))
    radius_m = speed**2 / rng.uniform(0.5, 1.2)
    course = winding(rng, Bounds(-REACH_M, (speed + 1) * until), radius_m)
    return carriageways.road(course, style).timeline(actors, times)


def barriers(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive 15 to 28 m/s on a motorway between noise walls: 450 to 840 m in 30 s.

    Two or three lanes, by seed with three oncoming ones beside; the walls, 3.5 m high and 4.5 m
    off, are straight or bend gently, and only a few signs distinguish positions.
    """
    rng = _generator(seed)
    count, oncoming = int(rng.integers(2, 4)), 3 * int(rng.integers(2))
    ego_lane = int(rng.integers(count))
    carriageways = Carriageways(count, ego_lane, "motorway", oncoming=oncoming, median_m=2.0)
    return _between_walls(rng, carriageways, Bounds(15.0, 28.0), "barriers", duration_s)


def tunnel(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive 14 to 25 m/s through a tunnel of two or three lanes: 420 to 750 m in 30 s.

    Walls 1 m off and a ceiling 5 m up, all smooth; lamps under the ceiling every 12 m or more and
    niches every 100 m or so are all that changes along it. Scenes begin and end inside: there are
    no portals.
    """
    rng = _generator(seed)
    count = int(rng.integers(2, 4))
    carriageways = Carriageways(count, int(rng.integers(count)), "motorway")
    return _between_walls(rng, carriageways, Bounds(14.0, 25.0), "tunnel", duration_s)


def _between_walls(
    rng: np.random.Generator,
    carriageways: Carriageways,
    speeds: Bounds,
    style: str,
    duration_s: float | None,
) -> Timeline:
    times = _times(duration_s, 30.0)
    until, speed = float(times[-1]), float(rng.uniform(*speeds))
    actors = _flow(rng, carriageways, speed, until, faster_m_s=Bounds(1.0, 2.5))
    radius_m = speed**2 / float(rng.uniform(0.3, 1.0))
    course = winding(rng, Bounds(-REACH_M, (speed + 1) * until), radius_m)
    return carriageways.road(course, style).timeline(actors, times)


def _flow(
    rng: np.random.Generator,
    carriageways: Carriageways,
    speed: float,
    until: float,
    *,
    faster_m_s: Bounds,
) -> list[Actor]:
    """Return the ego at a speed and traffic on all lanes.

    faster_m_s: by how much each lane is faster than the next one to its right.
    """
    motion = ScriptedMotion(0.0, 0.0, speed)
    ego = Actor(motion.with_varying_speed(rng, Bounds(-2.0, until), EGO_SPEED_VARIATION_M_S), EGO)
    actors = [
        ego,
        *carriageways.lanes[carriageways.ego_lane].around(rng, ego, Reach(REACH_M, REACH_M)),
    ]
    for i, lane in enumerate(carriageways.lanes):
        if i != carriageways.ego_lane:
            same_direction = i < carriageways.count
            step = (
                (carriageways.ego_lane - i) * float(rng.uniform(*faster_m_s))
                if same_direction
                else 0.0
            )
            actors += carriageways.stream(
                rng, lane, lane_speed=speed + step, ego_speed=speed, until_s=until
            )
    return actors


def standing_in_traffic(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Stand all the time, as if to turn off, while others pass at 7 to 14 m/s on both sides.

    One lane of the ego's direction to the right, one or none to the left, then two oncoming ones;
    up to three wait before and behind the ego. A street with houses, trees and parked cars.
    """
    rng = _generator(seed)
    ego_lane = int(rng.integers(2))
    carriageways = Carriageways(
        ego_lane + 2, ego_lane, "urban", oncoming=2, gaps_m=Bounds(3.0, 22.0), median_m=0.3
    )
    return _standing(rng, carriageways, Bounds(7.0, 14.0), "urban", duration_s)


def standing_barriers(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Stand on the right of a motorway between noise walls while others pass at 10 to 28 m/s.

    Two or three lanes of the ego's direction to its left, by seed also three oncoming ones; up to
    three stand before and behind the ego. Only a few signs distinguish positions.
    """
    rng = _generator(seed)
    ego_lane, oncoming = int(rng.integers(2, 4)), 3 * int(rng.integers(2))
    carriageways = Carriageways(ego_lane + 1, ego_lane, "motorway", oncoming=oncoming, median_m=2.0)
    return _standing(rng, carriageways, Bounds(10.0, 28.0), "barriers", duration_s)


def _standing(
    rng: np.random.Generator,
    carriageways: Carriageways,
    speeds: Bounds,
    style: str,
    duration_s: float | None,
) -> Timeline:
    times = _times(duration_s, 30.0)
    ego, fastest = Actor(STANDING, EGO), float(rng.uniform(*speeds))
    queue = replace(
        carriageways.lanes[carriageways.ego_lane], gaps_m=Bounds(1.5, 4.0), mix="parked"
    )
    reach = Reach(float(rng.uniform(0.0, QUEUE_M)), float(rng.uniform(0.0, QUEUE_M)))
    actors = [ego, *queue.around(rng, ego, reach)]
    for lane in _other_lanes(carriageways.lanes, carriageways.ego_lane):
        speed = max(fastest * float(rng.uniform(0.75, 1.0)), speeds.low)
        actors += carriageways.stream(
            rng, lane, lane_speed=speed, ego_speed=0.0, until_s=float(times[-1])
        )
    course = winding(rng, Bounds(-REACH_M, REACH_M), fastest**2)
    return carriageways.road(course, style).timeline(actors, times)


def stop_and_go(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Stand and drive up to 6 to 11 m/s in turn, in two to four full lanes: 190 to 300 m in 60 s.

    Waves run backwards through each lane, vehicles react 0.9 to 1.4 s after the one ahead; each
    lane has its own waves, so that now one lane and now another creeps past the ego.
    """
    rng = _generator(seed)
    times = _times(duration_s, 60.0)
    count = int(rng.integers(2, 5))
    ego_lane = int(rng.integers(count))
    carriageways = Carriageways(
        count, ego_lane, "motorway", gaps_m=Bounds(2.0, 5.0), delays_s=Bounds(0.9, 1.4)
    )
    ego = Actor(_waves(rng, 0.0, float(times[-1])), EGO)
    actors = [ego, *carriageways.lanes[ego_lane].around(rng, ego, JAM_REACH_M)]
    for lane in _other_lanes(carriageways.lanes, ego_lane):
        beside = _waves(rng, float(rng.uniform(-8.0, 8.0)), float(times[-1]))
        actors += lane.filled(rng, beside, JAM_REACH_M)
    radius_m = float(rng.uniform(500.0, 900.0))
    course = winding(rng, Bounds(-JAM_REACH_M.behind, 11.0 * times[-1]), radius_m)
    return carriageways.road(course, "motorway").timeline(actors, times)


def _waves(rng: np.random.Generator, x_m: float, until_s: float) -> ScriptedMotion:
    """Drive, stand, drive on; waves began before the recording and end after it."""
    margin_s = 40.0
    start, changes = -margin_s + float(rng.uniform(0.0, 15.0)), []
    first = speed = float(rng.uniform(6.0, 11.0))
    while start < until_s + margin_s:
        braking_s = PEAK * speed / float(rng.uniform(1.0, 2.2))
        changes.append(Change(start, braking_s, -speed))
        start += braking_s + float(rng.uniform(1.5, 5.0))
        speed = float(rng.uniform(6.0, 11.0))
        accelerating_s = PEAK * speed / float(rng.uniform(0.9, 1.6))
        changes.append(Change(start, accelerating_s, speed))
        start += accelerating_s + float(rng.uniform(0.0, 6.0))
    motion = ScriptedMotion(0.0, 0.0, first, tuple(changes))
    now = float(motion.positions(np.zeros(1))[0, 0])
    return ScriptedMotion(x_m - now, 0.0, first, tuple(changes))


def empty_motorway(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive alone at 18 to 28 m/s on two or three lanes in each direction, between rails and trees.

    Odd seeds stand for 2 to 4 s and pull away, and reach that after 20 to 30 s; even ones are at
    speed from the first scan on.
    """
    return _alone(seed, Bounds(18.0, 28.0), "motorway", duration_s)


def empty_street(_name: str, seed: int, duration_s: float | None = None) -> Timeline:
    """Drive alone at 8 to 14 m/s past houses, trees and parked cars.

    It starts as in `empty_motorway`.
    """
    return _alone(seed, Bounds(8.0, 14.0), "urban", duration_s)


def _alone(seed: int, speeds: Bounds, style: str, duration_s: float | None) -> Timeline:
    rng = _generator(seed)
    times = _times(duration_s, 30.0)
    until, speed = float(times[-1]), float(rng.uniform(*speeds))
    motion, steady_s, start = ScriptedMotion(0.0, 0.0, speed), -2.0, float(rng.uniform(2.0, 4.0))
    if seed % 2:
        town_speed = min(speed, TOWN_M_S)
        duration = PEAK * town_speed / PULL_M_S2
        changes = [Change(start, duration, town_speed)]
        if speed > town_speed:
            changes.append(Change(start + duration / 2, duration, speed - town_speed))
        motion = ScriptedMotion(0.0, 0.0, 0.0, tuple(changes))
        steady_s = changes[-1].start_s + changes[-1].duration_s
    count = int(rng.integers(2, 4))
    carriageways = Carriageways(count, int(rng.integers(count)), style, oncoming=count)
    motion = motion.with_varying_speed(rng, Bounds(steady_s, until), EGO_SPEED_VARIATION_M_S)
    radius_m = speed**2 / rng.uniform(0.5, 1.2)
    course = winding(rng, Bounds(-REACH_M, (speed + 1) * until), radius_m)
    return carriageways.road(course, style).timeline([Actor(motion, EGO)], times)


def _other_lanes(lanes: tuple[Lane, ...], ego_lane: int) -> tuple[Lane, ...]:
    """Return all lanes but the ego's."""
    return lanes[:ego_lane] + lanes[ego_lane + 1 :]


def _generator(seed: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed))


def _times(duration_s: float | None, usual_s: float) -> np.ndarray:
    return times_until(usual_s if duration_s is None else duration_s)
