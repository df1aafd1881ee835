import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_boxes import tracks, truth

from roadscope.benchmarks import Eligibility
from roadscope.benchmarks.metrics.tracking import score_tracks

RULE = Eligibility(range_m=(0.0, 60.0), min_returns=10)
A, B = [10.0, 0.0], [20.0, 0.0]


def score(reported_tracks, truths):
    return score_tracks(reported_tracks, truths, RULE.pairings(reported_tracks, truths))


def episode(rows):
    """Rows of ({object: position}, {track: position}) to truths and tracks."""
    truths = [truth(list(t.values()), ids=list(t)) for t, _ in rows]
    reported_tracks = [tracks(list(f.values()), list(f)) for _, f in rows]
    return reported_tracks, truths


def test_perfect_tracks() -> None:
    s = score(*episode([({1: A, 2: B}, {7: A, 8: B})] * 5))
    assert s.mota.value == s.idf1.value == s.mostly_tracked.value == 1.0
    assert s.hota.value == s.det_a.value == s.ass_a.value == s.loc_a.value == 1.0
    assert s.motp_m.value == s.id_switches.value == s.wrong_associations.value == 0.0
    assert s.fragmentations.value == s.mostly_lost.value == 0.0


def test_two_tracks_that_swap_objects() -> None:
    rows = [({1: A, 2: B}, {7: A, 8: B})] * 2 + [({1: A, 2: B}, {7: B, 8: A})] * 2
    s = score(*episode(rows))
    assert s.id_switches.value == 2
    assert s.wrong_associations.value == 2
    assert s.mota.value == 1 - 2 / 8
    assert s.idf1.value == 0.5
    # Every match shares 2 frames out of 4 + 4 - 2 with its track.
    assert s.ass_a.value == pytest.approx(1 / 3)
    assert s.hota.value == pytest.approx(math.sqrt(1 / 3))
    assert s.recall.value == s.precision.value == 1.0


def test_a_new_track_is_a_switch_but_no_wrong_association() -> None:
    s = score(*episode([({1: A}, {7: A}), ({1: A}, {8: A})]))
    assert s.id_switches.value == 1
    assert s.wrong_associations.value == 0


def test_a_track_that_goes_over_to_an_object_that_had_none() -> None:
    s = score(*episode([({1: A}, {7: A}), ({2: B}, {7: B})]))
    assert s.id_switches.value == 0
    assert s.wrong_associations.value == 1


def test_misses_false_alarms_and_fragments() -> None:
    rows = [({1: A}, {7: A}), ({1: A}, {9: B}), ({1: A}, {7: A}), ({1: A}, {7: A})]
    s = score(*episode(rows))
    assert s.mota.value == 1 - 2 / 4
    assert s.fragmentations.value == 1
    assert s.id_switches.value == 0
    assert s.recall.value == s.precision.value == 3 / 4
    assert s.mostly_tracked.value == 0.0


def test_a_frame_without_any_track_interrupts_nothing() -> None:
    s = score(*episode([({1: A}, {7: A}), ({1: A}, {}), ({1: A}, {7: A})]))
    assert s.fragmentations.value == 0
    assert s.recall.value == 2 / 3


def test_mostly_tracked_and_lost() -> None:
    rows = [({1: A, 2: B}, {7: A}) for _ in range(10)]
    s = score(*episode(rows))
    assert s.mostly_tracked.value == s.mostly_lost.value == 0.5


def test_a_match_continues_while_it_lies_within_the_gate() -> None:
    # In frame 2 track 8 is nearer to the object, but 7 had it and is near enough.
    near, far = [10.2, 0.0], [11.5, 0.0]
    s = score(*episode([({1: A}, {7: A}), ({1: A}, {7: far, 8: near})]))
    assert s.id_switches.value == 0
    assert s.motp_m.value == pytest.approx(0.75)


def test_identity_lasts_while_the_object_is_hidden() -> None:
    visible, hidden = truth([A], ids=[1]), truth([A], ids=[1], returns=0)
    same_identity = score([tracks([A], [7])] * 3, [visible, hidden, visible])
    assert same_identity.mota.value == 1.0
    assert same_identity.recall.n == 2
    lost = score([tracks([A], [i]) for i in (7, 7, 8)], [visible, hidden, visible])
    assert lost.id_switches.value == 1


def test_perfect_tracks_in_all_other_scores() -> None:
    s = score(*episode([({1: A, 2: B}, {7: A, 8: B})] * 50)).named()
    best = (
        "det_re",
        "det_pr",
        "ass_re",
        "ass_pr",
        "motp",
        "idp",
        "idr",
        "recall",
        "precision",
        "samota",
        "amota",
        "amotp",
        "amota_nuscenes",
        "inside_position",
        "inside_state",
    )
    assert [s[name].value for name in best] == pytest.approx([1.0] * len(best))
    none = (
        "ospa_m",
        "gospa_m",
        "partially_tracked",
        "heading_rmse_deg",
        "nees_position",
        "nees_state",
        "amotp_nuscenes_m",
    )
    assert [s[name].value for name in none] == [0.0] * len(none)
    assert math.isnan(s["heading_reversed"].value)  # Nothing moves.
    assert math.isnan(s["kept_through_occlusion"].value)
    assert math.isnan(s["reassociation_frames"].value)


def test_tracks_after_an_occlusion() -> None:
    visible, hidden = truth([A], ids=[1]), truth([A], ids=[1], returns=0)
    truths = [visible, hidden, hidden, visible, visible, visible, hidden, visible]
    ids = [[7], [7], [7], [], [7], [7], [], [8]]
    s = score([tracks([A] * len(i), i) for i in ids], truths)
    assert (s.kept_through_occlusion.value, s.kept_through_occlusion.n) == (0.5, 2)
    assert (s.reassociation_frames.value, s.reassociation_frames.n) == (0.5, 2)


def test_sets_of_tracks_and_objects() -> None:
    s = score(*episode([({1: A, 2: B}, {7: [10.0, 0.5]}), ({}, {})]))
    # Half a metre and one missing: over two objects, and in sum; then nothing at all.
    assert s.ospa_m.value == (0.5 + 2.0) / 2 / 2
    assert s.gospa_m.value == (0.5 + 1.0) / 2


def test_errors_of_states_and_consistency() -> None:
    """Unit covariances and an error of 3 m/s and 4 m/s."""
    there = truth([A], velocities=np.array([[10.0, 0.0]]), yaws=np.array([3.0]))
    s = score([tracks([[10.0, 0.6]], [7], velocities=np.array([[13.0, 4.0]]))], [there])
    assert s.position_rmse_m.value == pytest.approx(0.6)
    assert s.velocity_rmse_m_s.value == pytest.approx(5.0)
    assert s.heading_rmse_deg.value == pytest.approx(math.degrees(3.0))
    assert s.heading_reversed.value == 1.0
    assert s.nees_position.value == pytest.approx(0.36 / 2)
    assert s.nees_state.value == pytest.approx((0.36 + 25) / 4)
    assert (s.inside_position.value, s.inside_state.value) == (1.0, 0.0)


def test_any_similarity() -> None:
    """Half a length ahead: within 2 m but a third of the boxes only."""
    ahead = [12.0, 0.0]
    reported_tracks, truths = episode([({1: A}, {7: ahead})] * 3)
    pairings = RULE.pairings(reported_tracks, truths)
    assert score_tracks(reported_tracks, truths, pairings).mota.value == 1.0
    by_box = score_tracks(reported_tracks, truths, pairings, similarity="iou_3d")
    assert by_box.mota.value == -1.0
    loose = score_tracks(reported_tracks, truths, pairings, similarity="iou_bev", threshold=0.25)
    assert loose.mota.value == 1.0
    assert loose.motp.value == pytest.approx(2.5 / 6.5)
    assert loose.motp_m.value == 2.0


def test_an_empty_episode_has_no_mota() -> None:
    s = score([tracks([], [])], [truth([])])
    assert math.isnan(s.mota.value)
    assert math.isnan(s.idf1.value)


@given(st.integers(1, 6), st.integers(0, 4), st.integers(0, 4), st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_names_of_tracks_and_order_do_not_matter(frames, n, m, seed) -> None:
    rng = np.random.default_rng(seed)
    reported_tracks, truths, renamed = [], [], []
    names = rng.permutation(100)
    for _ in range(frames):
        truths.append(truth(rng.uniform(-5, 5, (m, 2)), ids=np.arange(m)))
        xy, ids, order = rng.uniform(-5, 5, (n, 2)), rng.permutation(8)[:n], rng.permutation(n)
        reported_tracks.append(tracks(xy, ids))
        renamed.append(tracks(xy[order], names[ids][order]))
    a, b = score(reported_tracks, truths).named(), score(renamed, truths).named()
    for name in a:
        assert a[name].value == pytest.approx(b[name].value, nan_ok=True), name
