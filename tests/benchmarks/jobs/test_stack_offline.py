"""What is told with all frames at hand is told by offline trackers only, and marked."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toy_boxes import detections, truth

from roadscope.benchmarks.jobs.stack import EntryError, offline, track, weighed
from roadscope.benchmarks.perceived import Perceived
from roadscope.core import Pose, Tracks, TrackState
from roadscope.trackers import TRACKERS
from roadscope.trackers.nearest import NearestTracker


class Online(NearestTracker):
    """Has a second pass, and does not call itself offline."""

    def rescored(self, history):
        return [Tracks.empty(tracks.stamp_s, tracks.frame) for tracks in history]


class Late(Online):
    """Tells nothing, with all frames at hand."""

    offline = True


class Whole(Late):
    """Takes tentative tracks for sure ones."""

    def rescored(self, history):
        sure = [np.full(len(tracks), TrackState.CONFIRMED, np.int8) for tracks in history]
        return [replace(tracks, states=s) for tracks, s in zip(history, sure, strict=True)]


class Short(Late):
    """Tells fewer frames."""

    def rescored(self, history):
        return list(history[1:])


class Nothing(Late):
    """Forgets to return."""

    def rescored(self, history):
        del history


class Swapped(Late):
    """Tells frames in the wrong order."""

    def rescored(self, history):
        return list(history[::-1])


HERE = Path(__file__)


def drive(ticks=20):
    """A car at 8 m/s in the world frame, an ego that stands."""
    stamps = 0.1 * np.arange(ticks)
    places = [[[10 + 8 * t, 3.0]] for t in stamps]
    return Perceived(
        tuple(detections(p, stamp_s=t) for p, t in zip(places, stamps, strict=True)),
        tuple(
            truth(p, stamp_s=t, world_from_ego=Pose.identity())
            for p, t in zip(places, stamps, strict=True)
        ),
        np.zeros(ticks), np.empty((0, 2)), np.zeros(ticks),
    )  # fmt: skip


def followed(spec):
    return track(spec, drive())[0]


def test_the_second_pass_is_run_for_offline_trackers_only():
    ours, late = f"{HERE}:Online?confirm_hits=3", f"{HERE}:Late?confirm_hits=3"
    assert (offline(ours), offline(late)) == (False, True)
    assert followed(ours) == followed("nearest?confirm_hits=3")
    assert sum(map(len, followed(ours))) == 18
    assert sum(map(len, followed(late))) == 0


def test_the_tentative_beginning_reaches_the_second_pass():
    assert [len(tracks) for tracks in followed(f"{HERE}:Whole?confirm_hits=3")] == [1] * 20


def test_tentative_tracks_are_told_only_where_they_are_wanted():
    spec = "nearest?confirm_hits=3"
    every = track(spec, drive(), unsure=True)[0]
    assert [len(tracks) for tracks in every] == [1] * 20
    assert [tracks.sure for tracks in every] == followed(spec)
    assert [weighed(name) for name in (spec, f"{HERE}:Late")] == [False, False]


def test_tentative_tracks_count_of_those_that_tell_how_likely_they_exist_and_leave_them():
    by_existence = {name for name in TRACKERS.installed() if weighed(name)}
    assert by_existence == {"jpda", "pmbm", "existence"}
    every = track("existence-offline", drive(), unsure=True)[0]
    assert every == followed("existence-offline")


def test_every_call_bears_its_share_of_the_second_pass(monkeypatch):
    monkeypatch.setattr("roadscope.benchmarks.jobs.stack.perf_counter", iter(range(99)).__next__)
    assert (track("existence", drive())[1] == 1000).all()
    monkeypatch.setattr("roadscope.benchmarks.jobs.stack.perf_counter", iter(range(99)).__next__)
    assert (track("existence-offline", drive())[1] == 1050).all()


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Short", "rescored returned 19 for 20 records"),
        ("Nothing", "rescored returned NoneType for 20 records"),
        ("Swapped", r"tracks are stamped 1\.9.* s, their frame is at 0\.0 s"),
    ],
)
def test_another_number_or_order_of_records_is_refused(name, said):
    with pytest.raises(EntryError, match=said):
        followed(f"{HERE}:{name}")
