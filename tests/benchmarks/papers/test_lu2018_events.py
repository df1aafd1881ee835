import numpy as np
import pytest

from roadscope.benchmarks.papers import lu2018_events as events
from roadscope.benchmarks.papers.lu2018_follow import NOBODY, Following
from roadscope.envs.traffic.lu2018 import Event, Script


def following(detected, ids, wrong_m=0.0, stray=None):
    """Two targets 20 m ahead; measured where '1', followed by the track of that digit, '.' none.

    stray: per frame, the tracks that took clutter.
    """
    seen = np.array([[c == "1" for c in row] for row in detected])
    known = np.array([[NOBODY if c == "." else int(c) for c in row] for row in ids])
    truth = np.tile(np.array([[[20.0, 0.0]], [[20.0, 4.0]]]), (1, seen.shape[1], 1))
    measured = np.where(seen[..., None], truth + np.array([wrong_m, 0]), np.nan)
    estimated = np.where((known != NOBODY)[..., None], truth + np.array([0, wrong_m]), np.nan)
    strays = tuple(frozenset(s) for s in stray) if stray else (frozenset(),) * truth.shape[1]
    return Following(truth, measured, estimated, known, strays)


def test_errors_by_axis_over_detected_frames():
    found = events.errors(following(["1101", "0000"], ["0000", "...."], wrong_m=0.3), 1)
    assert found["RMS of estimate minus measurement, object 1, ahead (paper's y)"] == pytest.approx(
        0.3
    )
    assert found["RMS of estimate minus truth, object 1, ahead (paper's y)"] == 0
    assert found["RMS of estimate minus truth, object 1, left (paper's x)"] == pytest.approx(0.3)
    assert found["RMS of measurement minus truth, object 1, left (paper's x)"] == 0
    never = events.errors(following(["1101", "0000"], ["0000", "...."]), 2)
    assert np.isnan(list(never.values())).all()


def test_coming_and_going():
    found = following(["0011100", "0000000"], ["..222..", "......."])
    assert events.first_tracked(found, 1) == 3
    assert events.lost_after(found, 1) == 6
    assert events.lost_after(found, 1, last=4) == 5
    assert events.first_tracked(found, 2) == 8
    assert events.lost_after(found, 2) == 1


@pytest.mark.parametrize(
    ("detected", "ids", "frame", "at_once", "kept"),
    [
        ("110011", "000000", 5, 1, 1),
        ("110001", "000000", 6, 0, 1),
        ("110011", "00..33", 7, 0, 0),
        ("110011", "00..30", 6, 0, 0),
        ("110011", "000300", 5, 1, 1),
        ("110000", "000000", 7, 0, 0),
        ("000011", "....00", 7, 0, 0),
    ],
    ids=["at once", "late", "new", "old after new", "another meanwhile", "never", "unknown before"],
)
def test_return_to_the_old_track(detected, ids, frame, at_once, kept):
    found = following([detected, "000000"], [ids, "......"])
    event = Event(1, "hidden", 3, 4)
    assert events.found_again(found, 1, event.first) == frame
    assert events.found_at_once(found, 1, event) == at_once
    assert events.kept_through(found, 1, event) == kept


def test_natural_misses_leave_out_forced_ones_and_what_lies_outside():
    script = Script("x", 8, (Event(1, "missed", 4, 4), Event(2, "missed", 1, 1)))
    found = following(["01001010", "00000000"], ["........", "........"])
    assert events.natural_misses(found, 1, script) == 2
    assert events.natural_misses(found, 2, script) == 0


def test_a_track_that_changes_its_target_is_a_wrong_association():
    crossed = following(["1111", "1111"], ["0011", "1100"])
    assert events.wrong_associations(crossed) == 2
    assert events.identity_changes(crossed) == 2
    renewed = following(["1111", "1111"], ["0022", "1111"])
    assert events.wrong_associations(renewed) == 0
    assert events.identity_changes(renewed) == 1
    gap = following(["1001", "1111"], ["0..0", "1111"])
    assert events.wrong_associations(gap) == events.identity_changes(gap) == 0
    coasting = following(["1100", "0000"], ["0000", "..00"])
    assert events.wrong_associations(coasting) == 0


def test_a_targets_track_on_clutter_is_counted_once_a_time():
    stray = [(), (0,), (0,), (), (0, 5)]
    followed = following(["10010", "00000"], ["00000", "....."], stray=stray)
    # Frame 2, going on in 3, and frame 5 after the target was taken up again in 4.
    assert events.clutter_associations(followed) == 2
