import numpy as np
import pytest

from roadscope.core import Category, Detections, Pose
from roadscope.trackers.clutter import FIRST_M2, Clutter, Scores
from roadscope.trackers.jpda import JpdaTracker
from roadscope.trackers.learned import FOLDER, learned
from roadscope.trackers.pmbm import PmbmTracker
from roadscope.trackers.ticks import Tick


def places(xy, t=0, score=0.5):
    xy = np.asarray(xy, float).reshape(-1, 2)
    n = len(xy)
    return Detections(
        np.column_stack([xy, np.full(n, 0.8)]), np.tile([4.5, 1.8, 1.5], (n, 1)), np.zeros(n),
        np.full(n, Category.CAR), np.full(n, score), "ego", 0.1 * t,
    )  # fmt: skip


@pytest.mark.parametrize("kind", [JpdaTracker, PmbmTracker])
@pytest.mark.parametrize(("a_tick", "most"), [(0.5, 2.2), (8.0, 1.3)])
def test_density_is_found_again_beside_real_ones(kind, a_tick, most):
    """Sparse clutter is thought denser: it has not been everywhere yet."""
    rng, tracker = np.random.default_rng(0), kind(traits="unknown")
    cars = np.array([[8.0 * k, 6.0 * (k % 4)] for k in range(-4, 5)])
    for t in range(150):
        false = rng.uniform(-40, 40, (rng.poisson(a_tick), 2))
        moved = cars + np.array([0.05 * t, 0.0])
        tracker.update(places(np.concatenate([moved, false]), t), None)
    assert 0.7 < tracker._clutter.density_m2 / (a_tick / 80**2) < most
    tracker.reset()
    assert tracker._clutter.density_m2 == FIRST_M2


@pytest.mark.parametrize("kind", [JpdaTracker, PmbmTracker])
def test_dense_clutter_is_not_told_for_long(kind):
    """As many false ones as real detectors make, with scores that say nothing."""
    rng, told = np.random.default_rng(1), {}
    for clutter_m2 in (None, 1e-4):
        tracker = kind(traits="unknown", clutter_m2=clutter_m2)
        counts = []
        for t in range(120):
            tracks = tracker.update(places(rng.uniform(-20, 20, (rng.poisson(8), 2)), t), None)
            counts.append(int((tracks.states > 0).sum()))
        told[clutter_m2] = sum(counts[60:])
    assert told[None] < 0.3 * told[1e-4]


def test_the_ground_that_counts_goes_with_the_ego():
    clutter, ahead = Clutter(), places([[12, 2]])
    for t in range(5):
        tick = Tick.after(None, ahead, Pose.planar(30.0 * t, 0.0, 0.3))
        clutter.seen(tick)
    assert clutter.cells == {(1, 0)}


def test_base_rates_are_taken_out_of_scores(tmp_path):
    """Two files of the same detector, one from where hardly anything was right."""
    text = (FOLDER / "unknown.toml").read_text("utf-8")
    assert Scores("unknown").shares(Tick.after(None, places([0, 0], 0, 0.7), None)) == [
        pytest.approx(0.7)
    ]
    rare = tmp_path / "rare.toml"
    rare.write_text(text.replace("score_offset = 0.0", "score_offset = -3.0"), "utf-8")
    told = Scores(str(rare)).shares(Tick.after(None, places([0, 0], 0, 0.7), None))[0]
    plain = 1 / (1 + np.exp(3 - np.log(0.7 / 0.3)))
    assert learned(str(rare)).score_offset[0] == -3
    assert plain < 0.11 < 0.3 < told
