import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from roadscope.core import Calibration, CameraImage, Frame, RecordError
from roadscope.detectors.camera import (
    CAMERA_DETECTORS,
    BlankImageWarning,
    CameraDetector,
    CentreNetwork,
    WeightsError,
    fastest,
    save,
)
from roadscope.detectors.camera import BoxCalibration as Worth


def frame_of(pixels: np.ndarray | None, stamp_s: float = 0.5) -> Frame:
    image = None if pixels is None else CameraImage(pixels, np.eye(3), stamp_s, "front")
    return Frame(stamp_s, Calibration(), camera=image)


def noise(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)


@pytest.fixture(scope="module")
def eager(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights that see something everywhere."""
    torch.manual_seed(1)
    network = CentreNetwork()
    with torch.no_grad():
        network.out.bias[:3] = 1.0
        network.out.weight[:3] = torch.randn_like(network.out.weight[:3])
    path = tmp_path_factory.mktemp("weights") / "eager.safetensors"
    save(path, network, Worth())
    return path


@pytest.mark.sampled(1)
@pytest.mark.parametrize("size", [(480, 640), (96, 128), (101, 77), (960, 1280), (33, 2000)])
def test_images_of_any_size_give_boxes_inside(eager: Path, size: tuple[int, int]) -> None:
    boxes = CameraDetector(weights=str(eager)).detect(frame_of(noise(*size)))
    assert len(boxes)
    assert boxes.stamp_s == 0.5
    assert boxes.boxes.min() >= 0
    assert (boxes.boxes[:, 2:] <= (size[1], size[0])).all()
    assert (np.diff(boxes.scores) <= 0).all()


def test_it_says_the_same_twice(eager: Path) -> None:
    detector, frame = CameraDetector(weights=str(eager)), frame_of(noise(96, 128))
    first = detector.detect(frame)
    detector.reset()
    assert detector.detect(frame) == first


def test_a_frame_without_image_is_refused() -> None:
    for name in CAMERA_DETECTORS.names():
        with pytest.raises(RecordError, match="the frame has no image"):
            CAMERA_DETECTORS.make(name).detect(frame_of(None))


def test_a_tiny_image_is_refused(eager: Path) -> None:
    with pytest.raises(RecordError, match="at least 32 x 32 pixels is needed, got 40 x 16"):
        CameraDetector(weights=str(eager)).detect(frame_of(noise(16, 40)))


def test_a_black_image_brings_a_warning_where_detect_is_called() -> None:
    for name in CAMERA_DETECTORS.names():
        detector = CAMERA_DETECTORS.make(name)
        with pytest.warns(
            BlankImageWarning, match=r"'front' at 0\.500 s: the image is b"
        ) as warning_records:
            assert len(detector.detect(frame_of(np.full((64, 64, 3), 3, np.uint8)))) == 0
        assert warning_records[0].filename == __file__


def test_the_faster_precision_is_taken_where_asked_for() -> None:
    assert CameraDetector(precision="auto").precision == fastest("cpu")
    assert CameraDetector(precision="auto", device="cuda").precision == "bfloat16"
    assert CameraDetector().precision == "float32"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"min_score": 0.0}, "min_score must lie"),
        ({"precision": "int4"}, "no precision 'int4'; known: auto, float32, bfloat16"),
        ({"threads": 0}, "threads must be at least 1"),
        ({"device": "tpu"}, "no device 'tpu'; known: cpu, cuda"),
        ({"device": "cuda:7x"}, "no device 'cuda:7x'; known: cpu, cuda"),
    ],
)
def test_wrong_arguments_are_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        CameraDetector(**arguments)  # type: ignore[arg-type]


def test_a_device_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    with pytest.raises(ValueError, match=r"no device 'cuda:1' here; there is: cpu"):
        CameraDetector(device="cuda:1").detect(frame_of(noise(64, 64)))


def test_missing_weights_are_named() -> None:
    with pytest.raises(WeightsError, match="nowhere"):
        CameraDetector(weights="nowhere.safetensors").detect(frame_of(noise(64, 64)))


def test_torch_waits_for_the_first_image() -> None:
    code = (
        "import sys; from roadscope.detectors.camera import CAMERA_DETECTORS as d;"
        "d.make('network'); assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_blobs_are_found_where_colour_stands_out() -> None:
    pixels = np.full((120, 160, 3), 90, np.uint8)
    pixels[80:100, 40:80] = (200, 30, 30)
    pixels[64:112, 120:132] = (20, 20, 200)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        boxes = CAMERA_DETECTORS.make("colour-blobs").detect(frame_of(pixels))
    assert sorted(boxes.boxes.tolist()) == [[40, 80, 80, 100], [120, 64, 132, 112]]
    assert sorted(boxes.categories.tolist()) == [0, 6]


def test_a_graphics_card_has_full_precision_during_a_detection_only(
    eager: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    convolutions: Any = torch.backends.cudnn.conv  # type: ignore[attr-defined]
    before, precisions = convolutions.fp32_precision, []
    answers = CentreNetwork.answers

    def noted(network: CentreNetwork, pixels: torch.Tensor) -> torch.Tensor:
        precisions.append(convolutions.fp32_precision)
        return answers(network, pixels)

    monkeypatch.setattr(CentreNetwork, "answers", noted)
    CameraDetector(weights=str(eager)).detect(frame_of(noise(64, 64)))
    assert precisions == ["ieee"]
    assert convolutions.fp32_precision == before != "ieee"


@pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no CUDA device")
def test_a_graphics_card_says_the_same(eager: Path) -> None:
    frame = frame_of(noise(96, 128))
    here, there = (
        CameraDetector(weights=str(eager), device=device).detect(frame)
        for device in ("cpu", "cuda")
    )
    assert len(here) == len(there) > 0
    np.testing.assert_allclose(np.sort(here.scores), np.sort(there.scores), atol=1e-4)
