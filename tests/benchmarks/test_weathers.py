"""Weather from a suite's key to what an entry gets to see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from roadscope import Episode, leaderboard, run_episode
from roadscope.benchmarks import (
    RunPictures,
    SuiteError,
    check_episode,
    manifest,
    parse_suite,
    plan,
    sensed,
    timeline_path,
)
from roadscope.core import WEATHER

TINY = """
name = "tiny"
version = 1
rig = "lux"
scenarios = ["lu2018-occlusion"]
weathers = ["clear", "rain", "fog-4", "fog-4"]
split = "validation"
seeds = 2
duration_s = 0.5
[detection]
entries = ["pag"]
"""
EPISODE = Episode("lu2018-occlusion", 10_000, "lux", 0.5)


def test_a_suite_runs_every_episode_in_every_weather() -> None:
    suite = parse_suite(TINY, "x")
    assert suite.weathers == ("clear", "rain-3", "fog-4")
    assert manifest(suite, 1)["weathers"] == ["clear", "rain-3", "fog-4"]
    jobs = [job for job in plan(suite, [], boards=["detection"]).jobs if job.entry == "pag"]
    assert [(job.episode.seed, job.episode.weather) for job in jobs] == [
        (seed, weather) for seed in (10_000, 10_001) for weather in suite.weathers
    ]
    assert len({job.key for job in jobs}) == 6
    assert len({timeline_path(job.episode) for job in jobs}) == 2


def test_a_suite_is_clear_by_default() -> None:
    lines = [line for line in TINY.splitlines() if "weathers" not in line]
    assert parse_suite("\n".join(lines), "x").weathers == ("clear",)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ('["fgo"]', r"x: weathers: .*'fgo'.*'fog'.*clear, rain-1"),
        ("[]", "x: weathers"),
        ('"fog"', "x: weathers.*'fog'"),
        ("[3]", r"x: weathers.*3"),
    ],
)
def test_wrong_weathers_are_refused(value: str, message: str) -> None:
    with pytest.raises(SuiteError, match=message):
        parse_suite(TINY.replace('["clear", "rain", "fog-4", "fog-4"]', value), "x")


def test_an_episode_is_sensed_in_its_weather() -> None:
    fog = replace(EPISODE, weather="fog-4")
    assert EPISODE.traffic_spec() == fog.traffic_spec()
    assert fog.spec() != EPISODE.spec()
    assert fog.spec() == replace(fog, weather="fog-4").spec()
    assert replace(fog, weather="rain").spec() == replace(fog, weather="rain-3").spec()
    shares = []
    for episode in (EPISODE, fog):
        sources = np.concatenate([truth.sources for _, truth in sensed(episode)])
        shares.append((sources == WEATHER).mean())
    assert shares[0] == 0
    assert shares[1] > 0.5
    with pytest.raises(ValueError, match="no weather 'hail'; known: clear"):
        check_episode(replace(EPISODE, weather="hail"))


def test_one_recording_of_the_traffic_serves_all_weathers(tmp_path) -> None:
    stages = []
    results = leaderboard(
        parse_suite(TINY.replace("seeds = 2", "seeds = [10_077]"), "x"),
        out_dir=tmp_path,
        progress=lambda stage, _, total: stages.append((stage, total)),
    )
    assert ("traffic", 1) in stages
    assert results.row("detection", "pag", "failed_episodes").value == 0


def test_a_stack_runs_in_fog_and_is_drawn_in_it() -> None:
    summary = run_episode(replace(EPISODE, weather="fog-4"))
    clear = run_episode(EPISODE)
    assert summary.detections.truths[0].lidar_returns.sum() < (
        clear.detections.truths[0].lidar_returns.sum()
    )
    in_fog, in_clear_air = (RunPictures(each).frame(0) for each in (summary, clear))
    assert not np.array_equal(in_fog, in_clear_air)
