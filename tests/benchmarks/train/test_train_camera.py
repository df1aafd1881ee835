import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toy_pictures import toy_pictures

from roadscope.benchmarks.train import RECIPES, crops, pictures, train_camera
from roadscope.core import Calibration as Mounting
from roadscope.core import CameraImage, Frame
from roadscope.detectors.camera import CameraDetector


@pytest.fixture(autouse=True)
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "render", lambda episode: toy_pictures(episode.seed, 2))
    monkeypatch.setattr(crops, "CROP_SIZES", (pictures.PixelSize(96, 128),))
    small = replace(RECIPES["trial"], steps=3, pixels=2 * 96 * 128)
    monkeypatch.setitem(RECIPES, "trial", small)


@pytest.mark.slow
def test_a_run_writes_weights_that_detect_and_their_record(tmp_path: Path) -> None:
    stages: set[str] = set()
    done = train_camera(
        tmp_path / "net",
        recipe="trial",
        work=tmp_path / "work",
        progress=lambda stage, *_: stages.add(stage),
    )
    assert stages == {"pictures", "training", "scores"}
    record = tomllib.loads(done.record.read_text("utf-8"))
    assert record["command"] == "roadscope train camera --recipe trial --seed 0 --jobs 1"
    assert record["precision"] in ("float32", "bfloat16")
    assert record["data"] == done.data_hash
    assert record["validation"]["objects"] == done.scores.ap50.n == 12
    held_out = {f"held_out_{name}" for name in ("scenarios", "looks", "weathers", "faults")}
    assert {*held_out, "clear_days", "test", "test_clear_days"} < set(record)
    image = CameraImage(np.full((64, 64, 3), 99, np.uint8), np.eye(3), 0.0, "camera")
    CameraDetector(weights=str(done.weights)).detect(Frame(0.0, Mounting(), camera=image))


@pytest.mark.slow
def test_run_twice_nothing_is_done_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = train_camera(tmp_path / "a", recipe="trial", work=tmp_path / "work")
    monkeypatch.setattr(pictures, "render", None)
    monkeypatch.setattr(crops, "batch", None)
    again = train_camera(tmp_path / "b", recipe="trial", work=tmp_path / "work")
    assert again.weights.read_bytes() == first.weights.read_bytes()


@pytest.mark.slow
def test_pictures_cut_short_are_taken_again(tmp_path: Path) -> None:
    first = train_camera(tmp_path / "a", recipe="trial", work=tmp_path / "work")
    for ending in ("npy", "npz"):
        path = sorted((tmp_path / "work").glob(f"*.{ending}"))[0]
        path.write_bytes(path.read_bytes()[:200])
    again = train_camera(tmp_path / "b", recipe="trial", work=tmp_path / "work")
    assert again.weights.read_bytes() == first.weights.read_bytes()


def test_weights_are_not_written_under_another_ending(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"written as \.safetensors, not as \.pt: "):
        train_camera(tmp_path / "a.pt", recipe="trial")


def test_an_unknown_recipe_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no recipe .tiny.; known: full, "):
        train_camera(tmp_path / "a", recipe="tiny")
