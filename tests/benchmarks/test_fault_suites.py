"""Faults from a suite's key to what an entry gets to see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from roadscope import Episode, run_episode
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
from roadscope.benchmarks.boards import episodes

TINY = """
name = "tiny"
version = 1
rig = "lux"
scenarios = ["lu2018-occlusion"]
faults = ["clear", "fog:4", "night:1 + dropped-scans:5", "dropped-scans:5 + night:1"]
split = "validation"
seeds = [10_004]
duration_s = 0.8
[detection]
entries = ["pag"]
[tracking]
entries = ["nearest"]
detectors = ["pag"]
"""
EPISODE = Episode("lu2018-occlusion", 10_004, "lux", 0.8)


def test_a_suite_runs_every_episode_with_every_set_of_faults() -> None:
    suite = parse_suite(TINY, "x")
    assert suite.faults == ((), ("fog:4",), ("night:1", "dropped-scans:5"))
    conditions = ["clear", "fog:4", "night:1 + dropped-scans:5"]
    assert manifest(suite, 1)["faults"] == conditions
    assert [episode.condition for episode in episodes(suite)] == conditions
    jobs = [job for job in plan(suite, [], boards=["detection"]).jobs if job.entry == "pag"]
    assert len({job.key for job in jobs}) == 3
    assert len({timeline_path(job.episode) for job in jobs}) == 1


def test_a_suite_without_the_key_is_as_it_was() -> None:
    lines = [line for line in TINY.splitlines() if "faults" not in line]
    suite = parse_suite("\n".join(lines), "x")
    assert suite.faults == ((),)
    assert episodes(suite) == [EPISODE]
    assert "faults" not in EPISODE.spec()


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ('["fgo:1"]', r"x: faults: no fault 'fgo' \(did you mean 'fog'\?\); known: fog, rain"),
        ('["fog:9"]', "x: faults: fault 'fog:9': expected a severity 1 to 5"),
        ("[]", "x: faults"),
        ('"fog:1"', "x: faults.*fog:1"),
        ('["fog:1"]\nweathers = ["rain"]', "weathers and faults: choose one"),
    ],
)
def test_wrong_faults_are_refused(value: str, message: str) -> None:
    lines = [f"faults = {value}" if "faults" in line else line for line in TINY.splitlines()]
    with pytest.raises(SuiteError, match=message):
        parse_suite("\n".join(lines), "x")


def test_an_episode_is_sensed_with_its_faults() -> None:
    dropped = replace(EPISODE, faults=("dropped-scans:5",))
    assert dropped.traffic_spec() == EPISODE.traffic_spec()
    assert dropped.spec() != EPISODE.spec()
    assert dropped.spec() == replace(dropped, faults=(" dropped-scans:5",)).spec()
    assert dropped.spec() != replace(dropped, faults=("dropped-scans:4",)).spec()
    scans = [frame.lidar is not None for frame, _ in sensed(dropped)]
    assert 0 < np.mean(scans) < 1
    for faults, message in ((("hail:1",), "no fault 'hail'"), (("fog:7",), "a severity 1 to 5")):
        with pytest.raises(ValueError, match=message):
            check_episode(replace(EPISODE, faults=faults))
    with pytest.raises(ValueError, match="both say what is in the air"):
        check_episode(replace(EPISODE, weather="rain", faults=("fog:1",)))
    with pytest.raises(ValueError, match="both say what the light is"):
        check_episode(replace(EPISODE, light="dusk", faults=("night:1",)))


def test_entries_come_through_lost_scans_and_are_marked_down_for_them() -> None:
    clear, dropped = (
        run_episode(replace(EPISODE, faults=faults), detector="pag")
        for faults in ((), ("dropped-scans:5",))
    )
    assert np.isfinite(dropped.tracking["hota"].value)
    rates = [summary.detection["detection_rate"].value for summary in (clear, dropped)]
    assert rates[1] < rates[0]
    assert len(clear.detections.truths) == len(dropped.detections.truths)


def test_a_scan_that_is_lost_can_be_drawn() -> None:
    summary = run_episode(replace(EPISODE, faults=("dropped-scans:5",)), detector="pag")
    lost = [k for k, (frame, _) in enumerate(sensed(summary.episode)) if frame.lidar is None]
    pictures = RunPictures(summary)
    assert pictures.frame(lost[0]).shape == pictures.frame(len(pictures) // 2).shape
