import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from roadscope.detectors.camera import (
    ARCHITECTURE,
    TERM_COUNT,
    BoxCalibration,
    CentreNetwork,
    WeightsError,
    load,
    save,
)


def about(**changes: object) -> dict[str, str]:
    worth = {"middles": [0] * 9, "spreads": [1] * 9, "weights": [[0] * TERM_COUNT] * 3}
    sound = {"architecture": ARCHITECTURE, **worth}
    return {"roadscope": json.dumps({**sound, **changes})}


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    drawn = np.random.default_rng(0).uniform(0.1, 2, (3, TERM_COUNT)).round(4)
    network, worth = CentreNetwork(), BoxCalibration(np.arange(9) / 8, np.arange(1, 10), drawn)
    save(tmp_path / "a.safetensors", network, worth)
    again, same = load(tmp_path / "a.safetensors")
    for name in ("middles", "spreads", "weights"):
        assert np.array_equal(getattr(same, name), getattr(worth, name))
    for name, tensor in network.state_dict().items():
        assert torch.equal(tensor, again.state_dict()[name])


def test_pickles_are_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "evil.safetensors"
    torch.save(CentreNetwork().state_dict(), path)
    with pytest.raises(WeightsError, match=r"evil\.safetensors is a pickle"):
        load(path)


def test_other_files_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "b.safetensors"
    with pytest.raises(WeightsError, match="cannot read weights"):
        load(path)
    path.write_bytes(b"what is this, a poem?")
    with pytest.raises(WeightsError, match="not a safetensors file"):
        load(path)


def test_another_architecture_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.safetensors"
    save_file({"x": torch.zeros(2)}, path)
    with pytest.raises(WeightsError, match=f"expected architecture '{ARCHITECTURE}', got None"):
        load(path)
    save_file({"x": torch.zeros(2)}, path, {"roadscope": "no table"})
    with pytest.raises(WeightsError, match="expected architecture"):
        load(path)
    save_file({"x": torch.zeros(2)}, path, about())
    with pytest.raises(WeightsError, match="tensor '"):
        load(path)


def test_tensors_that_are_no_weights_are_refused(tmp_path: Path) -> None:
    path, sound = tmp_path / "t.safetensors", CentreNetwork().state_dict()
    name = "out.bias"
    for wrong, words in (
        (sound[name].half(), r"expected float32 \(48,\), got float16 \(48,\)"),
        (sound[name] * float("nan"), "expected finite numbers"),
        (sound[name][:3].clone(), r"got float32 \(3,\)"),
    ):
        save_file({**sound, name: wrong}, path, about())
        with pytest.raises(WeightsError, match=rf"tensor '{name}': .*{words}|{words}"):
            load(path)


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [{"middles": None}, {"spreads": [1] * 8 + [-1]}, {"weights": [1, 2]}, {"middles": ["x"] * 9}],
)
def test_scores_without_worth_are_refused(tmp_path: Path, change: dict[str, object]) -> None:
    path = tmp_path / "d.safetensors"
    save_file(CentreNetwork().state_dict(), path, about(**change))
    with pytest.raises(WeightsError, match=r"d\.safetensors"):
        load(path)


def test_the_same_weights_are_the_same_bytes(tmp_path: Path) -> None:
    network = CentreNetwork()
    for name in "ab":
        save(tmp_path / f"{name}.safetensors", network, BoxCalibration())
    first, second = ((tmp_path / f"{name}.safetensors").read_bytes() for name in "ab")
    assert first == second
