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
    kept = answers(f"LateBy?frames={late}")
    answered = len(truths) - late
    assert [len(d) for d in kept.detections] == [1] * answered + [0] * late
    stamps = np.array([truth.stamp_s for truth in truths])
    assert np.allclose([d.stamp_s for d in kept.detections], stamps)
    assert {d.frame for d in kept.detections} == {"world"}
    for detections, truth in zip(kept.detections[:answered], truths, strict=False):
        assert np.allclose(detections.centres[0], truth.world_from_ego.translation)
    assert np.allclose(kept.delays_s[:answered], stamps[late:] - stamps[:answered])
    assert np.isnan(kept.delays_s[answered:]).all()
    assert kept.answered == answered


def test_an_empty_answer_leaves_its_frame_open_and_answers_it_all_the_same(truths) -> None:
    kept = answers("LateBy?frames=1&until=3")
    count = len(truths)
    assert [len(d) for d in kept.detections] == [1, 1] + [0] * (count - 2)
    late_s = truths[1].stamp_s - truths[0].stamp_s
    delays_s = [late_s, late_s, np.nan] + [0.0] * (count - 3)
    assert np.allclose(kept.delays_s, delays_s, equal_nan=True)


def test_what_is_kept_is_read_back_whole_and_reaches_trackers_frame_by_frame() -> None:
    kept = answers("LateBy?frames=2")
    file = BytesIO()
    kept.save(file)
    file.seek(0)
    assert EpisodeDetections.load(file) == kept
    tracks = track(TRACKERS.resolve("nearest"), kept)
    assert len(tracks.tracks) == len(tracks.times.wall_ms) == len(kept.truths)


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
