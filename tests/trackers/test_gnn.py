import numpy as np
from filterpy.kalman import KalmanFilter
from tracked_scenes import boxes, identities, make, run

from roadscope.core import TrackState


def test_each_track_has_filterpys_filter():
    """Three targets and uneven ticks; the filter written out."""
    rng, stamps = np.random.default_rng(0), [0.0, 0.1, 0.2, 0.45, 0.5, 0.6]
    start, speed = np.array([[0.0, 0], [20, 5], [40, -9]]), np.array([[8.0, 1], [0, 0], [-5, 2]])
    tracker, filters = make("gnn"), None
    for before, stamp in zip([0.0, *stamps], stamps, strict=False):
        places = start + stamp * speed + 0.2 * rng.standard_normal((3, 2))
        tracks = tracker.update(boxes(places, stamp / 0.1), None)
        if filters is None:
            filters = [filter_of(place) for place in places]
            continue
        for kalman, place in zip(filters, places, strict=True):
            step(kalman, stamp - before, place)
        for k, kalman in enumerate(filters):
            row = np.flatnonzero(tracks.ids == k)[0]
            np.testing.assert_allclose(tracks.centres[row, :2], kalman.x[:2], atol=1e-9)
            np.testing.assert_allclose(tracks.velocities[row], kalman.x[2:], atol=1e-8)
            np.testing.assert_allclose(tracks.covariances[row], kalman.P, atol=1e-8)


def filter_of(place):
    kalman = KalmanFilter(dim_x=4, dim_z=2)
    kalman.x = np.array([*place, 0, 0])
    kalman.P = np.diag([0.09, 0.09, 225, 225])
    kalman.H, kalman.R = np.eye(2, 4), 0.09 * np.eye(2)
    return kalman


def step(kalman, dt, place):
    F = np.eye(4) + dt * np.eye(4, k=2)
    Q = 4 * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2))
    kalman.predict(F=F, Q=Q)
    kalman.update(place)


def test_the_assignment_is_optimal_where_a_greedy_one_leaves_a_detection():
    """Two cars jump ahead; the nearest pair of all is a wrong one."""
    episode = [boxes([(0, 0), (3, 0)], 0), boxes([(2, 0), (5.5, 0)], 1)]
    assert run(make("gnn"), episode)[-1].ids.tolist() == [0, 1]
    greedy = run(make("greedy", vehicle_gate_m=2.4), episode)[-1]
    assert 2 in greedy.ids


def test_an_uncertain_track_leaves_a_certain_one_its_detection():
    """A new track next to an old one, whose detection is a little off."""
    tracker = make("gnn")
    run(tracker, [boxes([(0, 0)], k) for k in range(20)])
    tracker.update(boxes([(0, 0), (1.6, 0)], 20), None)
    tracks = tracker.update(boxes([(0.9, 0)], 21), None)
    moved = dict(zip(tracks.ids.tolist(), tracks.centres[:, 0].tolist(), strict=True))
    assert moved[0] > 0.05


def test_a_detection_beyond_the_gate_starts_a_track():
    episode = [boxes([(0, 0)], k) for k in range(20)]
    assert identities(run(make("gnn"), [*episode, boxes([(0.8, 0)], 20)])) == {0}
    assert identities(run(make("gnn"), [*episode, boxes([(2.5, 0)], 20)])) == {0, 1}


def test_a_missed_track_coasts_and_comes_back():
    episode = [boxes([(k, 0)] if k < 5 or k >= 12 else [], k) for k in range(14)]
    tracks = run(make("gnn", shown_misses=3), episode)
    assert identities(tracks) == {0}
    states = [TrackState(each.states[0]).name.lower() for each in tracks]
    assert (
        states
        == ["tentative"] * 2
        + ["confirmed"] * 3
        + ["coasting"] * 3
        + ["tentative"] * 4
        + ["confirmed"] * 2
    )
