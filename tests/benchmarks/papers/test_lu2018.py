"""The experiments run through; what they show is in the figures, not asserted here."""

from dataclasses import replace

import numpy as np
import pytest

from roadscope.benchmarks.papers import lu2018, lu2018_scene
from roadscope.benchmarks.papers.lu2018_clutter import majority
from roadscope.benchmarks.papers.lu2018_follow import NOBODY, follow
from roadscope.benchmarks.papers.lu2018_scene import KINDS, film
from roadscope.core import Detections
from roadscope.envs.traffic.lu2018 import SCRIPTS

SEED = 12345
"""Outside the seeds of the published figures."""


@pytest.fixture(scope="module")
def take():
    return film(lu2018.TWO, SEED)


def truth_as_detections(take):
    for frame, truth in zip(take.frames, take.truths, strict=True):
        seen = truth.lidar_returns >= 1
        n = int(seen.sum())
        boxes = Detections(
            truth.centres[seen], truth.sizes[seen], truth.yaws[seen], truth.categories[seen],
            np.ones(n), "world", frame.stamp_s,
        )  # fmt: skip
        yield boxes.moved(truth.world_from_ego.inverse(), "ego")


def test_frame_k_has_the_stamp_k_periods(take):
    assert len(take.frames) == take.script.frames == 190
    stamps = [frame.stamp_s for frame in take.frames]
    assert np.allclose(stamps, 0.08 * np.arange(1, 191), atol=1e-9)


def test_forced_misses_take_every_return_of_the_target_and_no_other(take):
    number = np.array([int((truth.sources == 1).sum()) for truth in take.truths])
    assert np.flatnonzero(number == 0).tolist() == [101, 147, 171, 176]
    for frame, truth in zip(take.frames, take.truths, strict=True):
        assert len(frame.lidar) == len(truth.sources)
        assert truth.lidar_returns[truth.ids == 1] == (truth.sources == 1).sum()
    assert (take.truths[101].sources == 2).sum() > 0


def test_kinds_follow_the_sources(take):
    for truth, cloud, kinds in zip(take.truths, take.clouds, take.kinds, strict=True):
        sources = truth.sources[cloud.rows]
        assert np.array_equal(kinds == KINDS.index("target"), sources >= 0)
        assert np.isin(kinds[sources <= -2], [2, 3]).all()
    assert {int(k) for kinds in take.kinds for k in kinds} >= {0, 2, 3}


@pytest.mark.parametrize("experiment", lu2018.LOOKS)
@pytest.mark.parametrize("tracker", lu2018.TRACKERS.values())
def test_perfect_detections_show_the_events_of_the_paper(experiment, tracker):
    """With boxes from truth the scripts' own frames come out: the measures are right."""
    take = film(experiment, SEED)
    found = lu2018.LOOKS[experiment](take, follow(take, list(truth_as_detections(take)), tracker))
    for (name, quantity), figure in lu2018.PAPER.items():
        if name == experiment and not quantity.startswith("RMS"):
            assert found[quantity] == figure, quantity
    errors = [value for key, value in found.items() if "measurement minus truth" in key]
    assert np.allclose(errors, 0, atol=1e-9)


def test_the_track_that_took_the_detection_counts_not_the_one_that_is_near(take):
    """A filter is opened for a detection outside the gate while the old one coasts nearby."""
    boxes = list(truth_as_detections(take))
    jumped = [
        replace(b, centres=b.centres + (np.array([1.5, 0, 0]) if k >= 60 else 0.0))
        for k, b in enumerate(boxes)
    ]
    followed = follow(take, jumped, "nearest?frame=ego&gate_m=1.0")
    before, after = followed.ids[0, 59], followed.ids[0, 60]
    assert NOBODY not in (before, after)
    assert before != after
    assert np.allclose(followed.estimated[0, 60], followed.measured[0, 60])


def test_majority_leaves_outliers_out():
    labels, kinds = np.array([0, 0, 0, 1, -1, -1]), np.array([2, 2, 0, 3, 1, 1])
    assert majority(labels, kinds).tolist() == [2, 3]
    assert majority(np.array([-1]), np.array([0])).size == 0


def test_reproduce_gives_every_figure_of_the_paper_an_ours(monkeypatch):
    monkeypatch.setattr(lu2018, "FIRST_SEED", SEED)
    monkeypatch.setattr(lu2018, "DETECTED", ("pag", "distance"))
    monkeypatch.setattr(lu2018, "TRACKED", ("pag",))
    monkeypatch.setattr(lu2018, "NOISES", {"half noise": 0.5})
    done = []
    rows = lu2018.reproduce(1, lambda *progress: done.append(progress))
    assert done == [(1, 1)]
    named = {(row.experiment, row.quantity) for row in rows if row.paper is not None}
    assert named == set(lu2018.PAPER)
    assert all(row.ours is not None for row in rows if row.paper is not None)
    assert {row.method for row in rows} == {
        "pag + nearest", "pag + nearest-q", "pag", "distance",
        *(f"clustering {name}" for name in lu2018.CLUSTERINGS),
    }  # fmt: skip
    units = {lu2018.unit_of(row.quantity): row.quantity for row in rows}
    assert set(units) == {"m", "frame", "share", "1/scan", "count"}


def test_no_seeds_are_refused():
    with pytest.raises(ValueError, match="at least one seed is needed, got 0"):
        lu2018.reproduce(0)


def test_scripts_are_the_experiments():
    assert set(lu2018.LOOKS) == set(SCRIPTS)
    assert lu2018_scene.lux().lidar.stamp_s(0) == pytest.approx(0.08)
    quiet, usual = lu2018_scene.lux(0.5).lidar.spec, lu2018_scene.lux().lidar.spec
    assert quiet.range_noise_m == usual.range_noise_m / 2
