import tomllib
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from roadscope.benchmarks.train import (
    RECIPES,
    evaluate,
    held_out_episodes,
    read_pictures,
    store_pictures,
)
from roadscope.core import Calibration, CameraImage, Frame
from roadscope.detectors.camera import ARCHITECTURE, CAMERA_DETECTORS, SHIPPED, load


def test_shipped_weights_are_small_and_their_record_is_of_them() -> None:
    assert SHIPPED.stat().st_size < 5_000_000
    record = tomllib.loads(SHIPPED.with_suffix(".toml").read_text("utf-8"))
    assert record["weights"] == sha256(SHIPPED.read_bytes()).hexdigest()
    assert record["architecture"] == ARCHITECTURE
    assert record["command"].startswith("roadscope train camera")
    assert 0 < record["validation"]["ap50"] <= 1


def test_shipped_weights_load_and_detect_nothing_in_a_plain_image() -> None:
    network, calibration = load(SHIPPED)
    assert not network.training
    assert calibration.weights[:, 1].min() > 0
    grey = CameraImage(np.full((480, 640, 3), 120, np.uint8), np.eye(3), 0.0, "camera")
    boxes = CAMERA_DETECTORS.make("network").detect(Frame(0.0, Calibration(), camera=grey))
    assert (boxes.scores < 0.5).all()


@pytest.mark.slow
def test_the_weights_reach_what_their_record_says(tmp_path: Path) -> None:
    record = tomllib.loads(SHIPPED.with_suffix(".toml").read_text("utf-8"))["clear_days"]
    episodes = held_out_episodes(RECIPES["full"])["clear_days"]
    for episode in episodes:
        store_pictures(episode, tmp_path)
    scores = evaluate(SHIPPED, [read_pictures(episode, tmp_path) for episode in episodes])
    assert scores.ap50.n == record["objects"]
    for name in ("ap50", "ap50_16px", "detection_rate", "false_alarms"):
        # Other processors round otherwise: a box or two may lie on the other side of a threshold.
        assert getattr(scores, name).value == pytest.approx(record[name], abs=0.02), name
