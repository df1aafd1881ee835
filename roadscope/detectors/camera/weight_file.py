"""Files of the network's weights. They hold tensors and text only, so reading them runs no code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from roadscope.detectors.camera.calibration import BoxCalibration

if TYPE_CHECKING:
    from torch import Tensor

    from roadscope.detectors.camera.network import CentreNetwork

FOLDER = Path(__file__).parent / "weights"
SHIPPED = FOLDER / "network.safetensors"
ABOUT = "roadscope"
"""Entry of the file's metadata that holds everything but tensors."""
CALIBRATION = ("middles", "spreads", "weights")
"""Fields of a `BoxCalibration` in that entry, beside the architecture."""
PICKLED = (b"PK\x03\x04", b"\x80")
"""How the files of `torch.save` and plain pickles begin."""


class WeightsError(ValueError):
    """A file cannot be read, or has no weights of this network."""


def save(path: Path, network: CentreNetwork, calibration: BoxCalibration) -> None:
    """Write a network and the calibration of its scores."""
    from safetensors.torch import save as packed

    from roadscope.detectors.camera.network import ARCHITECTURE

    tensors = {k: v.detach().cpu().contiguous() for k, v in network.state_dict().items()}
    about = {
        "architecture": ARCHITECTURE,
        **{name: getattr(calibration, name).tolist() for name in CALIBRATION},
    }
    # A single entry: the order of several entries would change from file to file.
    path.write_bytes(packed(tensors, {ABOUT: json.dumps(about)}))


def load(path: Path | str) -> tuple[CentreNetwork, BoxCalibration]:
    """Read a network; `WeightsError` names the file and what is wrong with it."""
    from safetensors import SafetensorError, safe_open

    from roadscope.detectors.camera.network import ARCHITECTURE, CentreNetwork

    path = Path(path)
    _check_beginning(path)
    try:
        with safe_open(path, "pt") as file:
            about = _about(file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except SafetensorError as error:
        raise WeightsError(f"{path} is not a safetensors file: {error}") from error
    architecture = about.get("architecture")
    if architecture != ARCHITECTURE:
        raise WeightsError(f"{path}: expected architecture '{ARCHITECTURE}', got {architecture!r}")
    network = CentreNetwork()
    expected = network.state_dict()
    for name in sorted(set(expected) | set(tensors)):
        _check_tensor(path, name, expected, tensors)
    network.load_state_dict(tensors)
    return network.eval(), _calibration(path, about)


def _about(metadata: Mapping[str, str]) -> dict[str, Any]:
    try:
        about = json.loads(metadata.get(ABOUT, ""))
    except ValueError:
        return {}
    return about if isinstance(about, dict) else {}


def _check_beginning(path: Path) -> None:
    try:
        with path.open("rb") as file:
            start = file.read(4)
    except OSError as error:
        raise WeightsError(f"cannot read weights {path}: {error.strerror or error}") from error
    if start.startswith(PICKLED):
        raise WeightsError(
            f"{path} is a pickle, and reading it could run any code; expected a .safetensors file"
        )


def _check_tensor(
    path: Path, name: str, expected: Mapping[str, Tensor], tensors: Mapping[str, Tensor]
) -> None:
    kind, actual = (_kind(t[name]) if name in t else "none" for t in (expected, tensors))
    if kind != actual:
        raise WeightsError(f"{path}: tensor '{name}': expected {kind}, got {actual}")
    if not bool(tensors[name].isfinite().all()):
        raise WeightsError(f"{path}: tensor '{name}': expected finite numbers")


def _kind(tensor: Tensor) -> str:
    return f"{str(tensor.dtype).removeprefix('torch.')} {tuple(tensor.shape)}"


def _calibration(path: Path, about: Mapping[str, Any]) -> BoxCalibration:
    try:
        return BoxCalibration(**{name: np.array(about[name], float) for name in CALIBRATION})
    except KeyError as error:
        raise WeightsError(
            f"{path} has no calibration of its scores: no {error}; weights of an older version "
            "have to be trained again"
        ) from error
    except (TypeError, ValueError) as error:
        raise WeightsError(f"{path}: cannot read the calibration of its scores: {error}") from error
