"""Answers that come after the frame that they are for."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from roadscope import DETECTORS, TRACKERS, Episode
from roadscope.benchmarks import Eligibility, EpisodeDetections, RunOptions, sensed
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.nodes import DetectionNode, track
from roadscope.core import Truth

PLUGINS = Path(__file__).with_name("late_detectors.py")
EPISODE = Episode("lu2018-three-vehicles", 10_000, "lux", 0.6)


@pytest.fixture(scope="module")
def truths() -> list[Truth]:
    truths = [truth for _, truth in sensed(EPISODE)]
    assert len(truths) > 4
    assert np.ptp([truth.world_from_ego.translation[0] for truth in truths]) > 1.0
    return truths


def answers(plugin: str) -> EpisodeDetections:
    source = DETECTORS.resolve(f"{PLUGINS}:{plugin}")
    return DetectionNode(source, EPISODE, Eligibility()).compute(RunOptions())


@pytest.mark.parametrize("late", [0, 1, 2])
def test_an_answer_belongs_to_the_frame_whose_stamp_it_has(truths, late) -> None:
    recorded = answers(f"LateBy?frames={late}")
    answered = len(truths) - late
    assert [len(d) for d in recorded.detections] == [1] * answered + [0] * late
    stamps = np.array([truth.stamp_s for truth in truths])
    assert np.allclose([d.stamp_s for d in recorded.detections], stamps)
    assert {d.frame for d in recorded.detections} == {"world"}
    for detections, truth in zip(recorded.detections[:answered], truths, strict=False):
        assert np.allclose(detections.centres[0], truth.world_from_ego.translation)
    assert np.allclose(recorded.delays_s[:answered], stamps[late:] - stamps[:answered])
    assert np.isnan(recorded.delays_s[answered:]).all()
    assert recorded.answered == answered


def test_an_empty_answer_leaves_its_frame_open_and_answers_it_all_the_same(truths) -> None:
    recorded = answers("LateBy?frames=1&until=3")
    count = len(truths)
    assert [len(d) for d in recorded.detections] == [1, 1] + [0] * (count - 2)
    late_s = truths[1].stamp_s - truths[0].stamp_s
    delays_s = [late_s, late_s, np.nan] + [0.0] * (count - 3)
    assert np.allclose(recorded.delays_s, delays_s, equal_nan=True)


def test_stored_answers_are_read_back_whole_and_reach_trackers_frame_by_frame() -> None:
    recorded = answers("LateBy?frames=2")
    file = BytesIO()
    recorded.save(file)
    file.seek(0)
    assert EpisodeDetections.load(file) == recorded
    tracks = track(TRACKERS.resolve("nearest"), recorded)
    assert len(tracks.tracks) == len(tracks.times.wall_ms) == len(recorded.truths)


def test_a_stamp_of_no_frame_is_refused_by_both_stamps(truths) -> None:
    stamp_s = truths[0].stamp_s
    with pytest.raises(PluginError, match=r"late_detectors\.py:Unknown: ") as caught:
        answers("Unknown")
    assert f"{stamp_s:.6g} s" in str(caught.value)
    assert f"{stamp_s - 0.01:.6g} s" in str(caught.value)


def test_a_second_answer_for_a_frame_is_refused_by_both_frames(truths) -> None:
    with pytest.raises(PluginError, match="two answers") as caught:
        answers("Twice")
    for truth in truths[:2]:
        assert f"{truth.stamp_s:.6g} s" in str(caught.value)
