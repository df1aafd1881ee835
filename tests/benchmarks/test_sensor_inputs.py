"""What fusions get when scans, images or the calibration are not as they should be."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from node_answers import detections_of, fusions_of
from toy_sensors import TINY

from roadscope import Episode
from roadscope.benchmarks import (
    LIDAR_ALONE,
    image_rows,
    image_rows_of_scans,
    parse_suite,
    pictures,
    sensing_of,
)
from roadscope.benchmarks.boards import episodes
from roadscope.fusion import LIMIT_S


@pytest.fixture(scope="module")
def suite():
    return parse_suite(TINY, "tiny")


def test_images_of_scans_are_the_nearest_of_all(suite) -> None:
    episode = episodes(suite)[0]
    every = image_rows(episode, 0.0)
    rows = image_rows_of_scans(episode, 0.2)
    assert set(rows) < set(every)
    lidar = detections_of("distance", episode, suite.eligibility)
    stamps = np.array([p.truth.stamp_s for p in pictures(episode, tuple(every), pixels=False)])
    for k, row in zip(range(0, len(lidar.truths), 2), rows, strict=True):
        assert abs(stamps[row] - lidar.truths[k].stamp_s) == pytest.approx(
            np.abs(stamps - lidar.truths[k].stamp_s).min()
        )


def test_where_an_image_is_lost_the_nearest_that_arrives_is_used(suite) -> None:
    instead = 0
    for severity, seed in product(range(1, 6), suite.seeds):
        episode = Episode("street", seed, "li2021", 1.2, faults=(f"blackout:{severity}",))
        sensing, every = sensing_of(episode), image_rows(episode, 0.0)
        stamps = np.array([sensing.rig.camera.stamp_s(k) for k in every])
        lost = np.array([sensing.image_lost(k) is not None for k in every])
        rows = image_rows_of_scans(episode, 0.0)
        left = [k for k in rows if not lost[k]]
        for scan_s in np.arange(sensing.rig.lidar.stamp_s(0), 1.1, 0.08):
            gaps = np.abs(stamps - scan_s)
            # The nearest, lost or not, tells what is to be found.
            assert gaps[rows].min() == gaps.min()
            least = gaps[~lost].min(initial=np.inf)
            if least <= LIMIT_S:
                assert gaps[left].min() == least
                instead += least > gaps.min()
    assert instead


def test_pixels_or_none_the_truth_of_images_is_the_same(suite) -> None:
    for episode in episodes(suite)[2:]:
        with_pixels, without = (
            list(pictures(episode, (0, 4, 8, 12), pixels=drawn)) for drawn in (True, False)
        )
        for one, other in zip(with_pixels, without, strict=True):
            assert one.truth == other.truth
            assert one.frame.stamp_s == other.frame.stamp_s
            assert (one.frame.camera is None) == (other.frame.camera is None)


@pytest.mark.slow
def test_a_scan_or_an_image_that_is_lost_leaves_the_other_sensor(suite) -> None:
    lossy = replace(suite, faults=(("dropped-scans:5", "blackout:5"),), seeds=(10007, 10009))
    sensors = set()
    for episode in episodes(lossy):
        moments = fusions_of("fused?camera=noisy-camera&fusion=union", episode, suite.eligibility)
        lost = [sensing_of(episode).scan_lost(row) for row in moments.rows.tolist()]
        for is_lost, fused, targets in zip(lost, moments.fused, moments.targets, strict=True):
            sensors.add((bool(fused.by_lidar.any()), bool(fused.by_camera.any())))
            assert not (is_lost and fused.by_lidar.any())
            # What was to be found does not depend on what failed.
            assert targets.eligible.any()
    assert {(False, True), (True, False), (True, True)} <= sensors


@pytest.mark.slow
def test_a_black_image_is_none_and_speaks_against_nothing(suite) -> None:
    dark = 0
    for seed in (10015, 10034):
        episode = Episode("street", seed, "wide", 1.2, faults=("blackout:5",))
        sensing, every = sensing_of(episode), image_rows(episode, 0.0)
        lost = [sensing.image_lost(k) for k in every]
        stamps = np.array([sensing.rig.camera.stamp_s(k) for k in every])
        mean, alone = (
            fusions_of(
                f"fused?camera=noisy-camera&fusion={name}",
                episode,
                suite.eligibility,
                alone=one_sensor,
            ).fused
            for name, one_sensor in (("weighted-boxes", ""), ("union", LIDAR_ALONE))
        )
        for averaged, lidar in zip(mean, alone, strict=True):
            near = np.abs(stamps - lidar.stamp_s) <= LIMIT_S + 1e-9
            if {lost[k] for k in np.flatnonzero(near)} == {"black"} and len(lidar):
                # What a camera that looked did not see would count half.
                assert averaged.scores.max() > lidar.scores.max() / 2 + 1e-9
                dark += 1
    assert dark


def test_an_error_of_the_calibration_is_believed(suite) -> None:
    matrices = []
    for faults in ((), ("extrinsic-error:5",)):
        (episode, *_) = episodes(replace(suite, faults=(faults,)))
        sensing = sensing_of(episode)
        matrices.append(sensing.calibration.pose("camera").matrix)
        moments = fusions_of("fused?camera=oracle&fusion=image-first", episode, suite.eligibility)
        matrices.append(np.array([f.by_lidar.sum() for f in moments.fused]).sum())
    true, joined, off, separate = matrices
    assert not np.allclose(true, off)
    assert separate < joined
