"""The usual body that has room for what is seen of a vehicle."""

from dataclasses import replace
from statistics import median

import numpy as np
import pytest

from roadscope.core import Category, Pose
from roadscope.detectors.moving import (
    OFFSETS,
    RIDER_M,
    TRIED,
    TWO_WHEELERS,
    Candidate,
    Chain,
    Sighting,
    usual,
)


def chain(length, width, height, count=3, seed=0):
    """Return a chain of a body that goes 12 m/s askew and shows some of its returns."""
    rng = np.random.default_rng(seed)
    direction = np.array([np.cos(0.4), np.sin(0.4)])
    made = Chain()
    for k in range(count):
        local = rng.uniform(-0.5, 0.5, (40, 2)) * [length, width]
        times, rise = rng.uniform(-0.04, 0.04, 40), rng.uniform(0.2, height, 40)
        places = (
            local @ np.array([direction, [-direction[1], direction[0]]])
            + (1.2 * k + 12 * times)[:, None] * direction
        )
        points = np.column_stack([places, rise])
        candidate = Candidate(points, np.arange(40), times, 0.0, np.zeros(2), np.zeros(3), 5.0)
        made.add(replace(Sighting.of(candidate, 0.1 * k, Pose.identity()), points=points))
    return made


def slow_spans(points, times_s, velocity):
    places = points[:, :2] - times_s[:, None] * velocity
    towards, best = np.arctan2(velocity[1], velocity[0]), (np.inf, 0.0, 0.0)
    for turn in towards + OFFSETS:
        u = np.cos(turn) * places[:, 0] + np.sin(turn) * places[:, 1]
        v = np.cos(turn) * places[:, 1] - np.sin(turn) * places[:, 0]
        along, across = np.ptp(u), np.ptp(v)
        if along * across < best[0]:
            best = along * across, along, across
    return *best[1:], points[:, 2].max()


def slow_usual(made):
    """Return the body and its length, one chain and one body after the other."""
    spans = [slow_spans(s.points, s.candidate.times_s, made.velocity) for s in made.sightings]
    along, across = median(s[0] for s in spans), median(s[1] for s in spans)
    top = max(s[2] for s in spans)
    for body in TRIED:
        if body in TWO_WHEELERS and top <= RIDER_M:
            continue
        sides = (along, body.length), (across, body.width), (top, body.height)
        if all(extent <= mean + 2 * spread for extent, (mean, spread) in sides):
            break
    return body, max(body.length[0], along)


def test_many_at_a_time_are_what_each_is_alone() -> None:
    rng = np.random.default_rng(1)
    made = [
        chain(*rng.uniform([0.3, 0.2, 0.6], [18.0, 3.0, 4.0]), count=1 + k % 4, seed=k)
        for k in range(60)
    ]
    usual_bodies = usual(made)
    for one, (body, (length, width, height)) in zip(made, usual_bodies, strict=True):
        expected, expected_length = slow_usual(one)
        assert body == expected
        assert length == pytest.approx(expected_length, abs=1e-12)
        assert (width, height) == (body.width[0], body.height[0])
    assert len({body for body, _ in usual_bodies}) >= 4


def test_two_wheelers_are_recognized_by_their_rider() -> None:
    kinds = [body.category for body, _ in usual([chain(1.6, 0.4, h) for h in (1.2, 1.8)])]
    assert kinds == [Category.CAR, Category.MOTORCYCLE]


def test_of_nothing_there_is_none() -> None:
    assert usual([]) == []
