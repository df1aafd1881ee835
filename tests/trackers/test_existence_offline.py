"""What was learned of each class serves the pass over finished tracks."""

import numpy as np

from roadscope.core import Category, Detections, Pose
from roadscope.trackers.existence_offline import ExistenceOfflineTracker
from roadscope.trackers.learned import learned
from roadscope.trackers.offline import rescored

DT, TICKS = 0.1, 60
KITTI = "kitti-pointrcnn"
SIZE = [0.8, 0.6, 1.8]


def way(kind, rng, ticks=TICKS):
    """States (T, 4) x, y, vx, vy of who wanders as was learned of the class."""
    traits = learned(KITTI)
    walk = np.array([traits.accelerate_m_s2[kind], traits.swerve_m_s2[kind]])
    steps = np.sqrt(DT) * walk * rng.standard_normal((ticks, 2))
    velocities = np.array([traits.cruise_m_s[kind], 0.0]) + np.cumsum(steps, axis=0)
    places = np.array([8.0, 3.0]) + np.cumsum(DT * velocities, axis=0)
    return np.hstack([places, velocities])


def errors(kind, rng, ranges_m):
    """Errors (T, 2) of places as was learned of the detector: part of them lasts."""
    traits, ticks = learned(KITTI), len(ranges_m)
    share, kept = traits.lasting[kind], np.exp(-DT / traits.lasting_s[kind])
    new, lasting = rng.standard_normal((2, ticks, 2))
    for k in range(1, ticks):
        lasting[k] = kept * lasting[k - 1] + np.sqrt(1 - kept**2) * lasting[k]
    sigma = np.array([traits.along_m[kind], traits.across_m[kind]])
    growth = 1 + traits.growth_per_m[kind] * ranges_m[:, None]
    return growth * sigma * (np.sqrt(share) * lasting + np.sqrt(1 - share) * new)


def seen(kind, places, t):
    n = len(places)
    return Detections(
        np.column_stack([places, np.full(n, 0.9)]), np.tile(SIZE, (n, 1)), np.zeros(n),
        np.full(n, kind), np.full(n, 0.999), "ego", DT * t,
    )  # fmt: skip


def told(kind, places):
    """A tracker and what it said of one object at (T, 2) places; nan where it is not seen."""
    tracker = ExistenceOfflineTracker(traits=KITTI)
    rows = [place[None][np.isfinite(place[:1])] for place in places]
    told = [tracker.update(seen(kind, row, t), Pose.identity()) for t, row in enumerate(rows)]
    return tracker, told


def off(history, truth):
    """Errors (K, 4) of states, and their covariances."""
    pairs = [(tracks, state) for tracks, state in zip(history, truth, strict=True) if len(tracks)]
    found = [np.append(t.centres[0, :2], t.velocities[0]) - state for t, state in pairs]
    return np.array(found), np.array([tracks.covariances[0] for tracks, _ in pairs])


def test_people_are_smoothed_as_people_move():
    """As far off as the covariances say; with one walk for all velocities are 0.13 m/s off."""
    rng, kind = np.random.default_rng(0), Category.PEDESTRIAN
    velocities, squares = [], []
    for _ in range(15):
        truth = way(kind, rng)
        places = truth[:, :2] + errors(kind, rng, np.hypot(*truth[:, :2].T))
        tracker, history = told(kind, places)
        found, spread = off(tracker.rescored(history), truth)
        velocities.append(found[:, 2:])
        solved = np.linalg.solve(spread, found[..., None])[..., 0]
        squares.append(np.einsum("ki,ki->k", found, solved) / 4)
    assert np.sqrt((np.concatenate(velocities) ** 2).mean()) < 0.12
    assert 0.5 < np.concatenate(squares).mean() < 1.2


def test_a_person_who_appears_where_no_one_on_foot_can_have_gone_is_another():
    """A car may have gone two metres aside in a second and a half: one walk for all joins them."""
    before = np.column_stack([8 + 0.12 * np.arange(20), np.full(20, 3.0)])
    gap = np.full((14, 2), np.nan)
    after = np.column_stack([8 + 0.12 * np.arange(34, 54), np.full(20, 5.0)])
    tracker, history = told(Category.PEDESTRIAN, np.concatenate([before, gap, after]))

    def known(records):
        return {int(i) for tracks in records for i in tracks.ids}

    assert known(tracker.rescored(history)) == {0, 1}
    assert known(rescored(history)) == {0}
