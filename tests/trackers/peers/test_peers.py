"""Trackers of other libraries; skipped where they are not installed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from toy_boxes import detections
from tracked_scenes import both, boxes, identities, run

import roadscope
from roadscope import TRACKERS, Category, Pose, TrackState
from roadscope.core import NotInstalledError, Requirement

PEERS = [name for name in TRACKERS if TRACKERS.resolve(name).requirement is not None]
CONFIRMED = TrackState.CONFIRMED
ROOT = Path(roadscope.__file__).parents[1]


@pytest.fixture(params=PEERS)
def peer(request):
    if TRACKERS.missing(request.param):
        pytest.skip(TRACKERS.missing(request.param))
    return TRACKERS.make(request.param)


def cars(ticks, speeds=(10.0, -8.0), scores=0.9):
    """Cars in lanes 4 m apart; the first one starts at 0."""
    lanes = 4.0 * np.arange(len(speeds))
    return [
        boxes(np.column_stack([0.1 * k * np.array(speeds), lanes]), k, scores) for k in range(ticks)
    ]


def test_six_of_three_libraries():
    assert len(PEERS) == 6
    assert {TRACKERS.resolve(name).requirement.distribution for name in PEERS} == {
        "norfair",
        "stonesoup",
        "trackers",
    }


def test_cars_are_confirmed_and_tracked_at_their_speed(peer):
    last = run(peer, cars(25))[-1]
    assert (last.states == CONFIRMED).all()
    order = np.argsort(last.centres[:, 1])
    np.testing.assert_allclose(last.centres[order, :2], [[24, 0], [-19.2, 4]], atol=0.3)
    np.testing.assert_allclose(last.velocities[order], [[10, 0], [-8, 0]], atol=0.5)


def test_a_gap_is_bridged(peer):
    frames = cars(30)
    gap = [d.select(np.zeros(len(d), bool)) if 12 <= k < 17 else d for k, d in enumerate(frames)]
    tracks = run(peer, gap)
    assert len(identities(tracks)) == 2
    assert all((each.states == TrackState.TENTATIVE).all() for each in tracks[12:17])
    assert (tracks[-1].states == CONFIRMED).all()


def test_what_appears_once_is_never_confirmed(peer):
    rng = np.random.default_rng(0)
    clutter = [boxes(rng.uniform(-200, 200, (2, 2)), k) for k in range(12)]
    # OC-SORT answers for whatever it sees in its first frames.
    assert not identities(run(peer, cars(6) + clutter[6:])[6:], CONFIRMED) - {0, 1}


def test_a_car_and_a_pedestrian_in_one_place_are_two(peer):
    scene = [
        both(boxes([[5.0, 0.0]], k), boxes([[5.2, 0.1]], k, category=Category.PEDESTRIAN))
        for k in range(8)
    ]
    last = run(peer, scene)[-1]
    assert sorted(last.categories.tolist()) == [Category.CAR, Category.PEDESTRIAN]
    assert sorted(last.sizes[:, 0].tolist()) == [0.6, 4.6]


def test_the_world_stands_still_while_the_ego_drives(peer):
    poses = [Pose.planar(1.2 * k, 0.0, 0.02 * k) for k in range(25)]
    scene = [d.moved(p.inverse(), "ego") for d, p in zip(cars(25), poses, strict=True)]
    last = run(peer, scene, poses)[-1]
    assert last.frame == "world"
    np.testing.assert_allclose(np.sort(last.velocities[:, 0]), [-8, 10], atol=0.5)


def test_two_in_one_process_are_independent(peer, request):
    other = TRACKERS.make(request.node.callspec.params["peer"])
    alone = run(peer, cars(10))
    peer.reset()
    together = []
    for d in cars(10):
        together.append(peer.update(d, None))
        other.update(boxes([[50.0, 50.0]], round(d.stamp_s / 0.1)), None)
    assert together == alone


@pytest.mark.parametrize("name", PEERS)
def test_a_missing_library_is_named(name, monkeypatch):
    monkeypatch.setattr(Requirement, "version", None)
    assert "is not installed: pip install" in TRACKERS.missing(name)
    with pytest.raises(NotInstalledError, match="is not installed: pip install"):
        TRACKERS.make(name)


HIDDEN = """
import importlib.metadata

version = importlib.metadata.version

def of_others(name):
    if name in DISTRIBUTIONS:
        raise importlib.metadata.PackageNotFoundError(name)
    return version(name)

importlib.metadata.version = of_others
"""
SUITE = """
name = "tiny"
version = 1
rig = "lux"
duration_s = 0.8
scenarios = ["lu2018-occlusion"]
split = "validation"
seeds = [10004]
[tracking]
entries = ["nearest"]
detectors = ["oracle"]
"""


@pytest.mark.slow
def test_a_missing_library_ends_no_run(tmp_path):
    """In all processes of a run, the plug-ins' own too."""
    distributions = sorted({TRACKERS.resolve(name).requirement.distribution for name in PEERS})
    hide = HIDDEN.replace("DISTRIBUTIONS", repr(distributions))
    (tmp_path / "sitecustomize.py").write_text(hide)
    (tmp_path / "tiny.toml").write_text(SUITE)
    entries = [part for name in PEERS for part in ("--entry", name)]
    command = [sys.executable, "-m", "roadscope", "leaderboard", "--suite", "tiny.toml", "--json"]
    path = os.pathsep.join([str(tmp_path), str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [*command, "--jobs", "1", *entries],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
    )
    # They were named, so the status says that they are not on the board.
    assert done.returncode == 1, done.stderr
    board = json.loads(done.stdout)
    assert {failure["entry"] for failure in board["failures"]} == set(PEERS)
    assert all("is not installed: pip install" in each["reason"] for each in board["failures"])
    ranks = {place["entry"]: place["rank"] for place in board["standings"]}
    assert ranks == {"nearest": 1} | dict.fromkeys(PEERS)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("norfair?vehicle_gate_m=0", "vehicle_gate_m must be positive"),
        ("norfair?confirm_hits=0", "confirm_hits must be a whole number from 1"),
        ("stonesoup-gnn?gate_share=1.0", "gate_share must lie between 0 and 1"),
        ("stonesoup-jpda?clutter_m2=0", "clutter_m2 must be positive"),
        ("roboflow-sort?pixels_per_m=0", "pixels_per_m must be positive"),
        ("roboflow-bytetrack?high_score=2", "high_score must lie in 0 to 1"),
        ("roboflow-oc-sort?least_overlap=0", "least_overlap must be positive"),
        ("roboflow-oc-sort?shown_misses=-1", "shown_misses must be a whole number from 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(spec, message):
    if TRACKERS.missing(spec):
        pytest.skip(TRACKERS.missing(spec))
    with pytest.raises(ValueError, match=message):
        TRACKERS.make(spec)


@pytest.mark.slow
def test_listing_loads_no_library():
    code = (
        "import sys; from roadscope.trackers import TRACKERS; TRACKERS.installed();"
        "print({'norfair', 'stonesoup', 'trackers', 'supervision', 'cv2'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_boxes_along_the_axes_hold_the_turned_ones():
    from roadscope.trackers._peers import upright_boxes

    turned_boxes = detections(
        [[1.0, 2.0]] * 3, yaws=[0.0, np.pi / 2, np.pi / 4], sizes=(4.0, 2.0, 1.5)
    )
    half = 3 / np.sqrt(2)
    expected = [[-1, 1, 3, 3], [0, 0, 2, 4], [1 - half, 2 - half, 1 + half, 2 + half]]
    np.testing.assert_allclose(upright_boxes(turned_boxes), expected, atol=1e-12)
