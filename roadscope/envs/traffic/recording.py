"""Timelines from samples of bodies in highway-env's frame."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from roadscope.envs.traffic.conversion import to_world
from roadscope.envs.traffic.mix import RoadUserBody
from roadscope.envs.traffic.timeline import Timeline

OBSTACLE_HEIGHT_M = 1.0
"""highway-env's obstacles are flat; a concrete barrier is about this high."""


class Samples(NamedTuple):
    """M samples of bodies, highway-env's frame; metres, radians, seconds.

    rows, columns: (M,) in a table of instants and actors. centres: (M, 2). states: (M, 3) heading,
    speed and steering. crashed: (M,) bool.
    """

    rows: np.ndarray
    columns: np.ndarray
    centres: np.ndarray
    states: np.ndarray
    crashed: np.ndarray


class RecordedMotion(NamedTuple):
    """Motion of A actors at K stamps, highway-env's frame; metres, radians, seconds.

    stamps_s: (K,). present, crashed: (K, A) bool. centres: (K, A, 2). states: (K, A, 3) heading,
    speed, steering.
    """

    stamps_s: np.ndarray
    present: np.ndarray
    crashed: np.ndarray
    centres: np.ndarray
    states: np.ndarray


def timeline_of(
    motion: RecordedMotion,
    ids: np.ndarray,
    bodies: list[RoadUserBody],
    ahead_m: np.ndarray,
    **settings: Any,
) -> Timeline:
    """Return the timeline of bodies whose centres are `ahead_m`, (A,), ahead of their rear axles.

    ids: (A,). settings: other fields of `Timeline`.
    """
    axles, yaws, speeds = rear_axles(motion.centres, motion.states, ahead_m)
    return Timeline(
        stamps_s=motion.stamps_s,
        ids=ids,
        categories=np.array([body.category for body in bodies], np.int8),
        sizes=np.array([body.size for body in bodies]),
        centre_ahead_m=ahead_m,
        present=motion.present,
        axles=axles,
        yaws=np.unwrap(yaws, axis=0),
        speeds=speeds,
        crashed=motion.crashed,
        **settings,
    )


def obstacles_of(places: np.ndarray) -> np.ndarray:
    """Return the obstacles of a timeline, (O, 6).

    places: (O, 5) x, y, heading, length and width in highway-env's frame.
    """
    centres, yaws, _ = to_world(places[:, :2], places[:, 2])
    heights = np.full(len(places), OBSTACLE_HEIGHT_M)
    return np.column_stack([centres, yaws, places[:, 3:], heights])


def rear_axles(
    centres: np.ndarray, states: np.ndarray, half_lengths: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (..., A, 2), yaws (..., A) and speeds (..., A) of rear axles, world frame.

    highway-env's bicycle turns about the box centre; its wheelbase is the vehicle's length, so
    the rear axle lies half a length behind, and along it the speed is that of the centre times
    the cosine of the slip angle that the last steering gave.

    centres: (..., A, 2) and states: (..., A, 3) heading, speed, steering, in highway-env's frame.
    half_lengths: (A,). Metres, radians, m/s.
    """
    heading, speed, steering = states[..., 0], states[..., 1], states[..., 2]
    slip = np.arctan(np.tan(steering) / 2)
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    axles, yaws, _ = to_world(centres - half_lengths[:, None] * direction, heading)
    return axles, yaws, speed * np.cos(slip)


def tabulate(
    samples: Samples, *, snapshots: int, actors: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return presence (K, A), crashes, centres (K, A, 2), and heading, speed, steering (K, A, 3).

    K is the number of snapshots, A that of actors.
    Where an actor is absent, its values are those of the nearest recorded sample.
    """
    shape = snapshots, actors
    present, crashed = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    centres, states = np.zeros((*shape, 2)), np.zeros((*shape, 3))
    at = samples.rows, samples.columns
    present[at], crashed[at] = True, samples.crashed
    centres[at], states[at] = samples.centres, samples.states
    fill, each = _nearest_recorded(present), np.arange(actors)
    return (_unbroken(present), crashed[fill, each], centres[fill, each], states[fill, each])


def _nearest_recorded(present: np.ndarray) -> np.ndarray:
    """Return (K, A) rows of the last recorded sample, or of the first before an actor appears."""
    rows = np.where(present, np.arange(len(present))[:, None], -1)
    last = np.maximum.accumulate(rows, axis=0)
    filled: np.ndarray = np.where(last < 0, present.argmax(axis=0), last)
    return filled


def _unbroken(present: np.ndarray) -> np.ndarray:
    """Return (K, A) presence without gaps, from the first to the last sample of each actor."""
    since = np.logical_or.accumulate(present, axis=0)
    until = np.logical_or.accumulate(present[::-1], axis=0)[::-1]
    both: np.ndarray = since & until
    return both
