"""How far tracks are off recorded labels, and whether they know it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from toy_boxes import detections_of
from toy_kitti import write_kitti

from roadscope.benchmarks.recorded import kitti_scores
from roadscope.core import Tracks, TrackState
from roadscope.formats import read_kitti_sequence


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return read_kitti_sequence(write_kitti(tmp_path_factory.mktemp("kitti")), "0000")


def offset_tracks(sequence, off_m=0.3, turned=0.0, variance=0.045, backwards=False):
    """Tracks of the labelled objects, off along x, with this variance of x and of y."""
    records = []
    for truth in sequence.truths:
        boxes, n = detections_of(truth, off_m=off_m), len(truth)
        tracks = replace(
            Tracks.of(boxes, truth.ids + 100),
            yaws=truth.yaws + turned,
            velocities=truth.velocities,
            covariances=np.tile(variance * np.eye(4), (n, 1, 1)),
        )
        records.append(tracks.select(np.arange(n)[::-1]) if backwards else tracks)
    return records


@pytest.mark.parametrize("backwards", [False, True])
def test_errors_of_states_are_those_that_were_put_in(sequence, backwards):
    scores = kitti_scores(offset_tracks(sequence, turned=0.1, backwards=backwards), sequence)
    assert scores["position_rmse_m"].value == pytest.approx(0.3)
    assert scores["heading_rmse_deg"].value == pytest.approx(math.degrees(0.1))
    assert scores["heading_reversed"].value == 0
    assert scores["position_rmse_m"].n == scores["nees_position"].n > 30


@pytest.mark.parametrize(
    ("variance", "ratio", "within"), [(0.045, 1.0, 1.0), (0.0045, 10.0, 0.0), (1.8, 0.025, 0.0)]
)
def test_nees_says_whether_tracks_are_too_sure(sequence, variance, ratio, within):
    """0.3 m along x: 0.09 / variance, of two degrees of freedom."""
    scores = kitti_scores(offset_tracks(sequence, variance=variance), sequence)
    assert scores["nees_position"].value == pytest.approx(ratio)
    assert scores["nees_in_band"].value == within


def test_a_reversed_heading_is_distinguished_from_a_turned_one(sequence):
    scores = kitti_scores(offset_tracks(sequence, turned=np.pi), sequence)
    assert scores["heading_reversed"].value == 1


def test_without_a_covariance_there_is_no_nees(sequence):
    scores = kitti_scores(offset_tracks(sequence, variance=0.0), sequence)
    assert math.isnan(scores["nees_position"].value)
    assert math.isnan(scores["nees_in_band"].value)
    assert scores["position_rmse_m"].value == pytest.approx(0.3)


def test_without_tracks_there_are_no_errors(sequence):
    nothing = [Tracks.empty(truth.stamp_s, "world") for truth in sequence.truths]
    scores = kitti_scores(nothing, sequence)
    assert math.isnan(scores["position_rmse_m"].value)
    assert scores["mota_centre"].value == 0


def test_only_averages_over_recall_take_tentative_tracks(sequence):
    """Objects that are followed half the time for sure, the rest by unsure tracks."""
    sure, unsure = offset_tracks(sequence), offset_tracks(sequence)
    unsure = [
        replace(
            tracks,
            ids=tracks.ids + 1000,
            scores=np.full(len(tracks), 0.1),
            states=np.full(len(tracks), TrackState.TENTATIVE),
        )
        for tracks in unsure
    ]
    half = len(sure) // 2
    shown = sure[:half] + [tracks.sure for tracks in unsure[half:]]
    every = sure[:half] + unsure[half:]
    without, with_tentative = kitti_scores(shown, sequence), kitti_scores(every, sequence)
    changed = {
        name
        for name, score in with_tentative.items()
        if not np.array_equal(score.value, without[name].value, equal_nan=True)
    }
    assert changed == {"samota", "samota_3d", "samota_centre"}
    assert with_tentative["samota"].value > without["samota"].value
