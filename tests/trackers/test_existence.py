import numpy as np
import pytest
from slow_kalman import innovations, predicted, updated

from roadscope.core import Category, Detections, Pose, TrackState
from roadscope.trackers import learned
from roadscope.trackers.existence import ExistenceTracker
from roadscope.trackers.existence_kernels import (
    corrected,
    ellipses,
    hidden_shares,
    looked_at,
    moved_on,
)
from roadscope.trackers.existence_returns import both
from roadscope.trackers.kalman import Gaussians

DT = 0.1
CALIBRATED = "roadscope"


def beliefs(n, seed=0):
    rng = np.random.default_rng(seed)
    roots = rng.standard_normal((n, 4, 4))
    return Gaussians(
        rng.standard_normal((n, 4)), roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(4)
    )


def spreads(n, seed=1):
    rng = np.random.default_rng(seed)
    return ellipses(rng.uniform(-3, 3, n), rng.uniform(0.5, 2, n), rng.uniform(0.1, 0.4, n))


def scene(places, t, scores=0.95, yaws=0.0, category=Category.CAR):
    places = np.asarray(places, float).reshape(-1, 2)
    n = len(places)
    return Detections(
        np.column_stack([places, np.full(n, 0.8)]), np.tile([4.5, 1.8, 1.5], (n, 1)),
        np.full(n, yaws), np.full(n, category), np.full(n, scores), "ego", DT * t,
    )  # fmt: skip


def test_kernels_are_the_kalman_filter():
    before, wander, drift, errors = beliefs(7), spreads(7), spreads(7, 4), spreads(7, 2)
    F = np.eye(4) + DT * np.eye(4, k=2)
    Q = np.block([[wander * DT**3 / 3, wander * DT**2 / 2], [wander * DT**2 / 2, wander * DT]])
    Q[:, :2, :2] += drift * DT
    slow = predicted(before, F, Q)
    means, covariances = moved_on(before.means, before.covariances, wander, drift, DT)
    assert means == pytest.approx(slow.means)
    assert covariances == pytest.approx(slow.covariances)
    H, measured = np.eye(2, 4), np.random.default_rng(3).standard_normal((7, 2))
    innovation = innovations(slow, measured, H, errors)
    after = updated(slow, innovation, H, errors)
    means, covariances, distances = corrected(means, covariances, measured, errors)
    assert means == pytest.approx(after.means)
    assert covariances == pytest.approx(after.covariances)
    assert distances == pytest.approx(innovation.distances)


def slowly_looked_at(before, box, score, weight, climb, turn):
    """One target after another, axis and front told apart by hand."""
    (height, spread), (yaw, doubt), front, size, total = before
    gain, turn_gain = spread / (spread + climb), doubt / (doubt + turn)
    off = np.angle(np.exp(1j * (box[6] - yaw)))
    ahead = np.cos(off) >= 0
    off = off if ahead else np.angle(np.exp(1j * (off + np.pi)))
    front = 0.9 * front + (score if ahead else -score)
    yaw = yaw + turn_gain * off + (np.pi if front < 0 else 0.0)
    total = min(total, 1.0) + weight
    return (
        [height + gain * (box[2] - height), (1 - gain) * spread],
        [np.angle(np.exp(1j * yaw)), (1 - turn_gain) * doubt],
        abs(front), size + weight / total * (box[3:6] - size), total,
    )  # fmt: skip


def test_heights_headings_and_sizes_are_filtered_one_by_one():
    rng, n = np.random.default_rng(5), 40
    before = (
        rng.uniform(0.1, 1, (n, 2)), np.column_stack([rng.uniform(-3, 3, n), rng.uniform(0, 1, n)]),
        rng.uniform(0, 2, n), rng.uniform(1, 5, (n, 3)), rng.uniform(0.2, 3, n),
    )  # fmt: skip
    boxes, rest = rng.uniform(-3, 3, (n, 7)), rng.uniform(0.1, 1, (4, n))
    kept = [part.copy() for part in before]
    after = looked_at(before, (boxes, *rest), 1.0, 0.9)
    assert all(np.array_equal(part, old) for part, old in zip(before, kept, strict=True))
    for k in range(n):
        slow = slowly_looked_at([part[k] for part in before], boxes[k], *rest[:, k])
        for told, wanted in zip(after, slow, strict=True):
            assert told[k] == pytest.approx(wanted)


def test_ellipses_lie_along_the_heading():
    (found,) = ellipses(np.array([np.pi / 2]), np.array([2.0]), np.array([0.5]))
    assert found == pytest.approx(np.diag([0.25, 4.0]))


def test_only_nearer_ones_hide():
    boxes = np.array([[10, 0, 1, 2, 4, 2, 0.0], [20, 0, 1, 2, 4, 2, 0], [20, 30, 1, 2, 4, 2, 0]])
    every, eye = np.ones(3, bool), np.zeros(2)
    assert hidden_shares(boxes, every, every, eye).tolist() == [0, 1, 0]
    assert hidden_shares(boxes, ~every, every, eye).tolist() == [0, 0, 0]
    assert hidden_shares(boxes, every, ~every, eye).tolist() == [0, 0, 0]
    boxes[1, 1] = 4.0
    assert 0.2 < hidden_shares(boxes, every, every, eye)[1] < 0.8


def test_hiding_knows_no_seam_behind_the_eye():
    boxes = np.array([[-10, 0.1, 1, 2, 4, 2, 0.0], [-20, -0.1, 1, 2, 2, 2, 0]])
    both = np.ones(2, bool)
    assert hidden_shares(boxes, both, both, np.zeros(2)).tolist() == [0, 1]


def test_sure_detections_are_told_at_once_and_unsure_ones_later():
    sure = ExistenceTracker(traits=CALIBRATED).update(scene([10, 0], 0, scores=0.95), None)
    assert sure.states.tolist() == [TrackState.CONFIRMED]
    tracker = ExistenceTracker(traits=CALIBRATED)
    states = [int(tracker.update(scene([10, 0], t, scores=0.55), None).states[0]) for t in range(6)]
    assert states[0] == TrackState.TENTATIVE
    assert states[-1] == TrackState.CONFIRMED


def unknown_but(shipped, changed, folder):
    """The path of the traits `unknown` with one value of each class changed."""
    text = (learned.FOLDER / "unknown.toml").read_text("utf-8")
    assert shipped in text
    path = folder / "changed.toml"
    path.write_text(text.replace(shipped, changed), "utf-8")
    return str(path)


def test_who_was_seen_but_once_is_doubted_until_seen_again(tmp_path):
    told = []
    for traits in ("unknown", unknown_but("seen_once = 0.0", "seen_once = -1.5", tmp_path)):
        tracker = ExistenceTracker(traits=traits)
        scores = [tracker.update(scene([[10, 0]] if t != 1 else [], t), None).scores[0]
                  for t in range(4)]  # fmt: skip
        told.append(np.log(scores) - np.log1p(np.negative(scores)))
    assert told[1] - told[0] == pytest.approx([-1.5, -1.5, 0, 0])


def test_weak_clutter_is_never_told_however_long_it_stays():
    tracker = ExistenceTracker(traits=CALIBRATED)
    told = [tracker.update(scene([10, 0], t, scores=0.1), None) for t in range(40)]
    assert {int(s) for tracks in told for s in tracks.states} == {TrackState.TENTATIVE}


def existence_after_misses(parked_between):
    tracker, pose = ExistenceTracker(traits=CALIBRATED), Pose.identity()
    front = [[10, 0]] if parked_between else [[10, 20]]
    for t in range(10):
        tracker.update(scene([[20, 0], *front], t), pose)
    for t in range(10, 14):
        tracks = tracker.update(scene(front, t), pose)
    (far,) = np.flatnonzero(np.abs(tracks.centres[:, 0] - 20) < 1)
    return tracks.scores[far]


def test_what_must_be_hidden_is_not_missed():
    assert existence_after_misses(True) > 0.03 + existence_after_misses(False)


def test_who_is_missed_in_runs_but_comes_back_is_believed_in_ever_more():
    """Ten detections, four misses, and so on."""
    tracker, told, existence = ExistenceTracker(traits=CALIBRATED), [], []
    for t in range(21 * 14):
        tracks = tracker.update(scene([[10, 0]] if t % 14 < 10 else [], t), None)
        told.append(TrackState.TENTATIVE not in tracks.states)
        existence.append(tracks.scores[0])
    missed = np.reshape(existence, (21, 14))[:, 10:]
    assert (np.diff(missed, axis=0) > 0).all(), "from run to run"
    assert (np.diff(missed, axis=1) < 0).all(), "but less with every miss of one"
    assert missed[-1, 0] > 2 * missed[0, 0]
    assert sum(told[-14:]) > sum(told[:14])
    assert tracker._returns.missed.seen_again > 15


def test_both_is_the_product_of_probabilities():
    a, b = np.meshgrid(np.linspace(-8, 8, 9), np.linspace(-8, 8, 9))
    p = 1 / (1 + np.exp(-a)) / (1 + np.exp(-b))
    assert both(a, b) == pytest.approx(np.log(p / (1 - p)), abs=1e-6)


def test_identity_outlives_an_occlusion_of_a_second():
    tracker = ExistenceTracker(traits=CALIBRATED)
    ids = set()
    for t in range(40):
        seen = scene([[10 + 0.8 * t, 0]] if not 15 <= t < 25 else [], t)
        ids |= set(tracker.update(seen, None).ids.tolist())
    assert len(ids) == 1


def test_headings_outvote_a_detection_the_wrong_way_round():
    tracker = ExistenceTracker(traits=CALIBRATED)
    for t in range(12):
        tracks = tracker.update(scene([10, 0], t, yaws=0.1 if t != 6 else 0.1 - np.pi), None)
        assert tracks.yaws[0] == pytest.approx(0.1, abs=1e-9)


def test_pedestrians_and_cars_are_never_one():
    tracker = ExistenceTracker(traits=CALIBRATED)
    first = tracker.update(scene([10, 0], 0), None)
    second = tracker.update(scene([10, 0], 1, category=Category.PEDESTRIAN), None)
    assert len(first) == 1
    assert len(second) == 2


def test_traits_that_are_none_are_refused(tmp_path):
    with pytest.raises(ValueError, match="known: fused, kitti-pointrcnn, roadscope, unknown"):
        ExistenceTracker(traits="mine")
    shipped = (learned.FOLDER / "roadscope.toml").read_text()
    path = tmp_path / "mine.toml"
    path.write_text(shipped.replace("along_m", "long_m", 1))
    with pytest.raises(ValueError, match=r"positive number as along_m in \[car\]"):
        learned.learned(str(path))


@pytest.mark.parametrize("wrong", [{"coast_s": 0}, {"shown_probability": 1}, {"least_overlap": 1}])
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        ExistenceTracker(**wrong)


@pytest.mark.parametrize("sigma", [0.1, 0.8])
def test_covariances_follow_what_detections_err(sigma):
    """Squared errors of places over what tracks say of them, per degree of freedom.

    Below 1: of an unknown detector errors are taken to last, and here none does.
    """
    rng, tracker, told = np.random.default_rng(0), ExistenceTracker(traits="unknown"), []
    cars = np.array([[10.0 * k, 8.0 * (k % 5)] for k in range(20)])
    for t in range(80):
        truth = cars + np.array([0.8 * t, 0])
        tracks = tracker.update(scene(truth + sigma * rng.standard_normal((20, 2)), t), None)
        apart = np.linalg.norm(tracks.centres[:, None, :2] - truth, axis=2)
        row, column = np.nonzero(apart < 2.0)
        off = tracks.centres[row, :2] - truth[column]
        spread = tracks.covariances[row, :2, :2]
        told.append((off * np.linalg.solve(spread, off[..., None])[..., 0]).sum(axis=1) / 2)
    assert 0.06 < np.concatenate(told[40:]).mean() < 0.15


def test_newcomers_count_as_seen_again_only_if_soon():
    tracker = ExistenceTracker(traits=CALIBRATED)
    for t in range(8):
        tracker.update(scene([[10, 0]] if t in (0, 7) else [], t), None)
    born = tracker._returns.born
    assert (born.seen_again, born.lost) == (0, 1)


def test_surplus_widens_what_is_said_of_places_alone(tmp_path):
    told = []
    for traits in ("unknown", unknown_but("surplus = 4.0", "surplus = 16.0", tmp_path)):
        tracker = ExistenceTracker(traits=traits)
        for t in range(10):
            tracks = tracker.update(scene([10 + 0.5 * t, 0], t), None)
        told.append(tracks)
    one, other = told
    assert other.centres == pytest.approx(one.centres)
    assert other.covariances[:, :2, :2] == pytest.approx(4 * one.covariances[:, :2, :2])
    assert other.covariances[:, 2:, :] == pytest.approx(one.covariances[:, 2:, :])
    assert (np.linalg.eigvalsh(other.covariances) > 0).all()
