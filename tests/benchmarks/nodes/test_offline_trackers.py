"""What is answered with all frames at hand counts of offline trackers only, and is marked."""

from pathlib import Path

import numpy as np
import pytest
from toy_boxes import detections, truth

from roadscope import TRACKERS
from roadscope.benchmarks import EpisodeDetections
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.nodes import is_offline, scores_tentative_tracks, track

PLUGINS = Path(__file__).with_name("offline_trackers.py")


def drive(ticks=20) -> EpisodeDetections:
    """Return a car at 8 m/s in the world frame, and an ego that stands."""
    stamps = 0.1 * np.arange(ticks)
    places = [[[10 + 8 * t, 3.0]] for t in stamps]
    return EpisodeDetections.recorded(
        [detections(p, stamp_s=t) for p, t in zip(places, stamps, strict=True)],
        [truth(p, stamp_s=t) for p, t in zip(places, stamps, strict=True)],
    )


def own(name: str) -> str:
    return f"{PLUGINS}:{name}?confirm_hits=3"


def tracks_of(text: str, **options):
    return track(TRACKERS.resolve(text), drive(), **options).tracks


def test_the_second_pass_is_run_for_offline_trackers_only() -> None:
    online, late = own("Online"), own("Late")
    assert [is_offline(TRACKERS.resolve(text)) for text in (online, late)] == [False, True]
    assert tracks_of(online) == tracks_of("nearest?confirm_hits=3")
    assert sum(map(len, tracks_of(online))) == 18
    assert sum(map(len, tracks_of(late))) == 0


def test_the_tentative_beginning_reaches_the_second_pass() -> None:
    assert [len(tracks) for tracks in tracks_of(own("Whole"))] == [1] * 20


def test_tentative_tracks_stay_only_where_they_are_wanted() -> None:
    spec = "nearest?confirm_hits=3"
    every = tracks_of(spec, tentative=True)
    assert [len(tracks) for tracks in every] == [1] * 20
    assert tuple(tracks.sure for tracks in every) == tracks_of(spec)
    assert not scores_tentative_tracks(TRACKERS.resolve(spec))
    assert not scores_tentative_tracks(TRACKERS.resolve(own("Late")))


def test_tentative_tracks_count_of_those_that_say_how_likely_they_exist_and_leave_them() -> None:
    weighed = {
        name for name in TRACKERS.installed() if scores_tentative_tracks(TRACKERS.resolve(name))
    }
    assert weighed == {"jpda", "pmbm", "existence"}
    every = tracks_of("existence-offline", tentative=True)
    assert every == tracks_of("existence-offline")


def test_every_call_has_its_share_of_the_second_pass() -> None:
    times = track(TRACKERS.resolve(own("Slow")), drive()).times
    assert times.wall_ms.min() >= 400 / 20
    assert np.median(times.processor_ms) < 400 / 20


@pytest.mark.parametrize(
    ("name", "words"),
    [("Short", ["19", "20"]), ("Nothing", ["NoneType", "sequence"]), ("Swapped", ["1.9 s", "0 s"])],
)
def test_another_number_or_order_of_records_is_refused(name, words) -> None:
    with pytest.raises(PluginError, match=f"{name}.*: ") as caught:
        tracks_of(own(name))
    assert not [word for word in words if word not in str(caught.value)]
