"""Answers that come after the frame that they are for."""

from pathlib import Path

import numpy as np
import pytest
from toy_boxes import detections, truth

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs import stack
from roadscope.benchmarks.jobs.stack import EntryError, perceive, track
from roadscope.benchmarks.perceived import Perceived
from roadscope.core import Calibration, Detections, Frame, Pose

STAMPS = 0.1 * np.arange(6) + 0.05
SPEED = 10.0
EPISODE = Episode("motorway", 0, "hdl32e")


class LateBy:
    """Says in each frame that something stood at the ego's origin some frames ago."""

    def __init__(self, *, frames=2, until=99):
        self.frames, self.until = frames, until

    def reset(self):
        self.stamps = []

    def detect(self, frame):
        self.stamps.append(frame.stamp_s)
        if not self.frames < len(self.stamps) <= self.until:
            return Detections.empty(frame.stamp_s)
        return self._seen(self.stamps[-1 - self.frames])

    def _seen(self, stamp_s):
        seen = detections([[0.0, 0.0]], stamp_s=stamp_s)
        return Detections(
            seen.centres, seen.sizes, seen.yaws, seen.categories, seen.scores, "ego", stamp_s
        )


class Twice(LateBy):
    """Answers the first frame again and again."""

    def detect(self, frame):
        self.stamps.append(frame.stamp_s)
        return self._seen(self.stamps[0])


class Unknown(LateBy):
    """Answers for a moment at which there was no frame."""

    def detect(self, frame):
        return self._seen(frame.stamp_s - 0.04)


@pytest.fixture(autouse=True)
def drive(monkeypatch):
    """Six frames of an ego that drives ahead."""
    frames = [Frame(s, Calibration()) for s in STAMPS]
    truths = [
        truth([[50.0, 0.0]], stamp_s=s, world_from_ego=Pose.planar(SPEED * s, 0, 0)) for s in STAMPS
    ]
    monkeypatch.setattr(stack, "sensed", lambda _: zip(frames, truths, strict=True))
    monkeypatch.setattr(stack, "parked_owners", lambda _: set())
    monkeypatch.setattr(stack, "parked_centres", lambda *_: np.empty((0, 2)))


def perceived(plugin: str) -> Perceived:
    return perceive(f"{Path(__file__)}:{plugin}", EPISODE, Eligibility())


@pytest.mark.parametrize("late", [0, 1, 2])
def test_an_answer_belongs_to_the_frame_whose_stamp_it_bears(late) -> None:
    found = perceived(f"LateBy?frames={late}")
    answered = len(STAMPS) - late
    assert [len(d) for d in found.detections] == [1] * answered + [0] * late
    assert np.allclose([d.stamp_s for d in found.detections], STAMPS)
    assert {d.frame for d in found.detections} == {"world"}
    x = [d.centres[0, 0] for d in found.detections[:answered]]
    assert np.allclose(x, SPEED * STAMPS[:answered])


@pytest.mark.parametrize("late", [0, 1, 2])
def test_the_delay_is_known(late) -> None:
    found = perceived(f"LateBy?frames={late}")
    assert np.allclose(found.delays_s[: len(STAMPS) - late], 0.1 * late)
    assert found.answered == len(STAMPS) - late


def test_frames_never_answered_have_no_delay() -> None:
    found = perceived("LateBy?frames=2")
    assert np.isnan(found.delays_s[-2:]).all()
    assert found.answered == len(STAMPS) - 2


def test_an_empty_answer_leaves_its_frame_open_and_answers_it_all_the_same() -> None:
    found = perceived("LateBy?frames=1&until=3")
    assert [len(d) for d in found.detections] == [1, 1, 0, 0, 0, 0]
    assert np.allclose(found.delays_s, [0.1, 0.1, np.nan, 0, 0, 0], equal_nan=True)


def test_delays_are_read_back(tmp_path) -> None:
    found = perceived("LateBy?frames=2")
    found.save(tmp_path / "kept.npz")
    assert Perceived.load(tmp_path / "kept.npz") == found


def test_trackers_are_given_every_frame() -> None:
    tracks, calls_ms = track("nearest", perceived("LateBy?frames=2"))
    assert len(tracks) == len(calls_ms) == len(STAMPS)


def test_a_stamp_of_no_frame_is_refused_by_both_stamps() -> None:
    with pytest.raises(EntryError, match=r"stamped 0\.01.* s, their frame is at 0\.05 s"):
        perceived("Unknown")


def test_a_second_answer_for_a_frame_is_refused_by_both_frames() -> None:
    with pytest.raises(EntryError, match=r"two answers .* at 0\.05 s, .* in the frame at 0\.15"):
        perceived("Twice")
