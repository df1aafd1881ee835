import shutil
import tomllib
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from roadscope.benchmarks.train import (
    RECIPES,
    TrainingResult,
    read_pictures,
    split_episodes,
    train_camera,
)
from roadscope.core import Calibration as Mounting
from roadscope.core import CameraImage, Frame
from roadscope.detectors.camera import CameraDetector


class TrainingRun(NamedTuple):
    """A run of training, its folder of pictures, and the progress that it reported."""

    result: TrainingResult
    work: Path
    progress: list[tuple[str, int, int]]


def trained(folder: Path, work: Path) -> TrainingRun:
    progress: list[tuple[str, int, int]] = []
    result = train_camera(
        folder / "net", recipe="trial", work=work, progress=lambda *each: progress.append(each)
    )
    return TrainingRun(result, work, progress)


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> TrainingRun:
    folder = tmp_path_factory.mktemp("first")
    return trained(folder, folder / "work")


@pytest.mark.slow
def test_a_run_writes_weights_that_detect_and_their_record(first: TrainingRun) -> None:
    done = first.result
    assert {stage for stage, *_ in first.progress} == {"pictures", "training", "scores"}
    record = tomllib.loads(done.record.read_text("utf-8"))
    assert record["command"] == "roadscope train camera --recipe trial --seed 0 --jobs 1"
    assert record["precision"] in ("float32", "bfloat16")
    assert record["data"] == done.data_hash
    (validation,) = split_episodes(RECIPES["trial"]).validation
    objects = sum(int(each.eligible.sum()) for each in read_pictures(validation, first.work).labels)
    assert record["validation"]["objects"] == done.scores.ap50.n == objects > 0
    held_out = {f"held_out_{name}" for name in ("scenarios", "looks", "weathers", "faults")}
    assert {*held_out, "clear_days", "test", "test_clear_days"} < set(record)
    image = CameraImage(np.full((64, 64, 3), 99, np.uint8), np.eye(3), 0.0, "camera")
    CameraDetector(weights=str(done.weights)).detect(Frame(0.0, Mounting(), camera=image))


@pytest.mark.slow
def test_run_twice_nothing_is_done_twice(first: TrainingRun, tmp_path: Path) -> None:
    written = {path: path.stat().st_mtime_ns for path in first.work.iterdir()}
    again = trained(tmp_path, first.work)
    steps = RECIPES["trial"].steps
    assert [each for each in again.progress if each[0] != "scores"] == [("training", steps, steps)]
    assert written == {path: path.stat().st_mtime_ns for path in first.work.iterdir()}
    assert again.result.weights.read_bytes() == first.result.weights.read_bytes()


@pytest.mark.slow
def test_pictures_cut_short_are_taken_again(first: TrainingRun, tmp_path: Path) -> None:
    work = shutil.copytree(first.work, tmp_path / "work")
    pixels, labels = sorted(work.glob("*.npy"))[0], sorted(work.glob("*.npz"))[-1]
    for path in (pixels, labels):
        path.write_bytes(path.read_bytes()[:200])
    again = trained(tmp_path, work)
    assert ("pictures", 2, 2) in again.progress
    assert pixels.read_bytes() == (first.work / pixels.name).read_bytes()
    assert again.result.data_hash == first.result.data_hash
    assert again.result.weights.read_bytes() == first.result.weights.read_bytes()


def test_weights_are_not_written_under_another_ending(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"written as \.safetensors, not as \.pt: "):
        train_camera(tmp_path / "a.pt", recipe="trial")


def test_an_unknown_recipe_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no recipe .tiny.; known: full, "):
        train_camera(tmp_path / "a", recipe="tiny")
