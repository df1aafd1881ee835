"""Noise models keep what they promise."""

import hashlib
import subprocess
import sys
from itertools import pairwise
from math import erf
from pathlib import Path

import numpy as np
import pytest
import toy_boxes
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.benchmarks import (
    CLUTTER_SIZE_M,
    NOISES,
    Eligibility,
    Episode,
    NoiseModel,
    NoisyDetections,
    detection_source,
    is_noise,
    made_from_truth,
)
from roadscope.benchmarks.nodes import oracle_detections
from roadscope.core import Detections, Pose, SpecError, Truth, wrap_angle

EPISODE = Episode("intersection", 10_000, "hdl32e")
RULE = Eligibility((5.0, 60.0), 5)
FRAMES, OBJECTS = 400, 40
QUIET = {"miss": 0, "clutter": 0, "position_m": 0, "size_m": 0, "yaw_deg": 0, "flip": 0}
"""Arguments of a noise model that makes no error."""


def truths(frames=FRAMES, objects=OBJECTS, hidden=0.0, returns=50) -> list[Truth]:
    """Cars on a grid, 7 m apart, within the range band; the ego turns and goes on."""
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.arange(-24, 25, 7.0), np.arange(-24, 25, 7.0)), -1)
    places = grid.reshape(-1, 2)
    places = places[np.hypot(*places.T) > 10.0][:objects]
    yaws = rng.uniform(-np.pi, np.pi, len(places))
    return [
        toy_boxes.truth(
            places,
            ids=np.arange(1, len(places) + 1),
            yaws=yaws,
            returns=returns,
            occluded_fraction=np.full(len(places), hidden),
            world_from_ego=Pose.from_euler(0.01 * t, 0.0, 0.0, yaw=0.1 * t),
            stamp_s=0.1 * t,
        )
        for t in range(frames)
    ]


def quiet(**changes: float | None) -> str:
    """Return the spec of a noise model that makes no error but those that are named."""
    arguments = (f"{name}={value}" for name, value in {**QUIET, **changes}.items())
    return f"noisy?{'&'.join(arguments)}"


def detect(spec: str, frames: list[Truth], episode: Episode = EPISODE) -> list[Detections]:
    noisy = NoisyDetections(NOISES.make(spec), episode, RULE)
    return [noisy.of(truth) for truth in frames]


def detected(reported: list[Detections], frames: list[Truth]) -> np.ndarray:
    """(T, N) bool, which objects have a detection; without noise of position."""
    box_differences = [
        f.centres[:, None, :2] - t.centres[None, :, :2]
        for f, t in zip(reported, frames, strict=True)
    ]
    return np.array([(np.abs(a).max(axis=-1) < 1e-9).any(axis=0) for a in box_differences])


def test_without_errors_it_is_the_oracle() -> None:
    frames = truths(3)
    for noisy, truth in zip(detect(quiet(), frames), frames, strict=True):
        true = oracle_detections(truth, RULE)
        for name in ("centres", "sizes", "categories"):
            np.testing.assert_array_equal(getattr(noisy, name), getattr(true, name))
        np.testing.assert_allclose(noisy.yaws, true.yaws, atol=1e-12)
        assert (noisy.frame, noisy.stamp_s) == ("world", true.stamp_s)


def test_objects_that_are_not_eligible_are_not_detected() -> None:
    assert sum(map(len, detect(quiet(), truths(5, returns=4)))) == 0


@pytest.mark.slow
@pytest.mark.parametrize("miss", [0.0, 0.2, 0.6])
@pytest.mark.parametrize("run", [None, 2.0, 6.0])
def test_misses_have_their_share_and_their_length(miss, run) -> None:
    frames = truths()
    missed = ~detected(detect(quiet(miss=miss, miss_run=run), frames), frames)
    length = run or 1 / (1 - miss)
    # Runs of mean L with share p are as informative as N p (1 - p) / L single draws or so.
    error = np.sqrt(max(miss * (1 - miss), 1e-12) * 2 * length / missed.size)
    assert missed.mean() == pytest.approx(miss, abs=5 * error)
    if miss:
        inner = missed[:, :].T
        runs = [r for row in inner for r in whole_runs(row)]
        assert np.mean(runs) == pytest.approx(length, rel=0.12)


def whole_runs(row: np.ndarray) -> list[int]:
    """Lengths of the runs of True that begin and end within the row."""
    edges = np.flatnonzero(np.diff(np.concatenate([[row[0]], row]).astype(int)))
    return [int(b - a) for a, b in pairwise(edges) if row[a]]


def test_the_hidden_are_missed_as_far_as_they_are_hidden_and_all_the_time() -> None:
    rates = []
    for hidden in (0.2, 0.8):
        frames = truths(2, hidden=hidden)
        detected_pairs = [
            detected(detect(quiet(occlusion=0.5), frames, Episode("merge", seed, "lux")), frames)
            for seed in range(60)
        ]
        rates.append(1 - np.mean(detected_pairs))
        assert all((two[0] == two[1]).all() for two in detected_pairs)
    assert rates[0] == pytest.approx(0.1, abs=0.035)
    assert rates[1] == pytest.approx(0.4, abs=0.05)


@pytest.mark.slow
def test_clutter_is_poisson_and_uniform_over_the_range_band() -> None:
    frames = truths(3000, objects=1)
    spec = "noisy?miss=0.999999&miss_run=none&clutter=3&size_m=0"
    counts, radii, angles = [], [], []
    for clutter, truth in zip(detect(spec, frames), frames, strict=True):
        offset = clutter.centres[:, :2] - truth.world_from_ego.translation[:2]
        counts.append(len(clutter))
        radii += np.hypot(*offset.T).tolist()
        angles += np.arctan2(offset[:, 1], offset[:, 0]).tolist()
    assert np.mean(counts) == pytest.approx(3.0, abs=0.16)
    assert np.var(counts) == pytest.approx(3.0, rel=0.15)
    near, far = RULE.range_m
    areas = (np.array(radii) ** 2 - near**2) / (far**2 - near**2)
    for values in (areas, np.array(angles) / (2 * np.pi) + 0.5):
        assert largest_gap(values) < 1.95 / np.sqrt(len(values))
    np.testing.assert_allclose(clutter.sizes, np.tile(CLUTTER_SIZE_M, (len(clutter), 1)))


def largest_gap(values: np.ndarray) -> float:
    """Kolmogorov's distance from uniform on 0 to 1; above 1.95 / sqrt(n) once in 1000."""
    steps = np.arange(len(values) + 1) / len(values)
    ordered = np.sort(values)
    return float(max((steps[1:] - ordered).max(), (ordered - steps[:-1]).max()))


def test_boxes_err_as_much_as_the_options_say() -> None:
    frames = truths()
    spec = "noisy?miss=0&clutter=0&position_m=0.3&size_m=0.1&yaw_deg=5&flip=0.2"
    frame_detections = detect(spec, frames)
    shift = np.concatenate(
        [f.centres - t.centres for f, t in zip(frame_detections, frames, strict=True)]
    )
    assert shift.std(axis=0) == pytest.approx([0.3, 0.3, 0.0], rel=0.03)
    assert shift.mean(axis=0) == pytest.approx([0.0] * 3, abs=0.012)
    assert np.corrcoef(shift[:, 0], shift[:, 1])[0, 1] == pytest.approx(0.0, abs=0.04)
    sizes = np.concatenate(
        [f.sizes - t.sizes for f, t in zip(frame_detections, frames, strict=True)]
    )
    assert sizes.std(axis=0) == pytest.approx([0.1] * 3, rel=0.03)
    turns = np.concatenate(
        [wrap_angle(f.yaws - t.yaws) for f, t in zip(frame_detections, frames, strict=True)]
    )
    flipped = np.abs(turns) > np.pi / 2
    assert flipped.mean() == pytest.approx(0.2, abs=0.016)
    assert np.degrees(turns[~flipped].std()) == pytest.approx(5.0, rel=0.04)


def test_scores_rank_and_are_probabilities_where_both_are_as_many() -> None:
    frames = truths(300)
    frame_detections = detect(quiet(clutter=40, score_gap=1.5), frames)
    true = np.concatenate([f.scores[:OBJECTS] for f in frame_detections])
    false = np.concatenate([f.scores[OBJECTS:] for f in frame_detections])
    assert len(false) == pytest.approx(len(true), rel=0.05)
    above = np.searchsorted(np.sort(false), true) / len(false)
    assert above.mean() == pytest.approx(0.5 + 0.5 * erf(1.5 / 2), abs=0.01)
    scores = np.concatenate([true, false])
    right = np.concatenate([np.ones(len(true)), np.zeros(len(false))])
    for low in (0.1, 0.3, 0.5, 0.7, 0.9):
        inside = (scores > low - 0.1) & (scores < low + 0.1)
        assert right[inside].mean() == pytest.approx(scores[inside].mean(), abs=0.03)
    assert set(detect(quiet(score_gap=0), frames[:1])[0].scores.tolist()) == {0.5}


@settings(max_examples=25, deadline=None)
@given(st.floats(0, 0.9), st.floats(0, 30), st.floats(0, 3), st.floats(0, 3), st.integers(0, 2**31))
def test_whatever_the_options_detections_are_proper_and_repeat(
    miss, clutter, position, size, seed
) -> None:
    model = NoiseModel(miss=miss, clutter=clutter, position_m=position, size_m=size)
    episode, frames = Episode("merge", seed, "lux"), truths(3, objects=9)
    one, other = (NoisyDetections(model, episode, RULE) for _ in range(2))
    for truth in frames:
        detections = one.of(truth)
        assert detections == other.of(truth)
        assert (detections.sizes > 0).all()


def test_one_slider_leaves_the_others_errors_alone() -> None:
    frames = truths(20)
    few, many = (detect(f"noisy?clutter=0&miss={miss}", frames) for miss in (0.1, 0.4))
    for some, more in zip(many, few, strict=True):
        centres = {tuple(row) for row in more.centres.tolist()}
        assert all(tuple(row) in centres for row in some.centres.tolist())


def test_episodes_differ() -> None:
    frames = truths(2)
    base = detect("noisy", frames)
    assert detect("noisy", frames, Episode("intersection", 10_001, "hdl32e")) != base
    assert detect("noisy", frames, Episode("merge", 10_000, "hdl32e")) != base
    assert detect("noisy", frames, Episode("intersection", 10_000, "lux", 3.0, "fog")) == base


def digest() -> str:
    frame_detections = detect("noisy-misses", truths(20))
    return hashlib.sha256(
        b"".join(f.centres.tobytes() + f.scores.tobytes() for f in frame_detections)
    ).hexdigest()


def test_the_same_bytes_in_another_process() -> None:
    here = Path(__file__).parent
    script = f"import sys; sys.path[:0] = [{str(here)!r}, {str(here.parent)!r}]\n"
    script += "from test_noisy import digest; print(digest())"
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={"PYTHONHASHSEED": "5"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == digest()


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("noisy?miss=1", "miss must be 0 or more and below 1, got 1"),
        ("noisy?miss=-0.1", "miss must be"),
        ("noisy?miss=0.8&miss_run=2", "miss_run must be none or at least 4 with miss=0.8, got 2"),
        ("noisy?clutter=nan", "clutter must be a number, got 'nan'"),
        ("noisy?flip=2", "flip must be in 0 to 1, got 2"),
        ("noisy?position_m=true", "position_m must be"),
    ],
)
def test_impossible_options_are_refused(spec, message) -> None:
    with pytest.raises(ValueError, match=message):
        NOISES.make(spec)


def test_unknown_options_are_named_with_what_there_is() -> None:
    with pytest.raises(SpecError, match=r"'misses'; its arguments: miss=0.1, miss_run=None, occ"):
        NOISES.make("noisy?misses=1")


def test_every_model_has_a_summary_and_is_no_plug_in() -> None:
    from roadscope.detectors import DETECTORS

    for name in NOISES:
        assert NOISES.summaries[name].endswith(".")
        assert name not in DETECTORS
        for spec in (name, f"{name}?miss=0.2"):
            assert made_from_truth(detection_source(spec))
            assert is_noise(detection_source(spec))
    assert made_from_truth(detection_source("oracle"))
    assert not made_from_truth(detection_source("pag"))
