"""What is shipped is what the command writes, to the digit."""

import os
import re
import tomllib
from pathlib import Path

import pytest
from toy_kitti import write_kitti

from research.tracker_traits import main as fit
from roadscope.trackers import FOLDER, read_detector

KITTI = "kitti-pointrcnn.toml"
CONSISTENT = "fused?lidar=cluster-boxes&camera=network&fusion=consistent"
SENSED = {
    "roadscope.toml": ["--detector", "distance-l-shape?level=False"],
    "fused.toml": [
        "--scenarios",
        "street,town-crossing",
        "--rigs",
        "wide",
        "--seeds",
        "4",
        "--guess-existence",
        "--detector",
        CONSISTENT,
    ],
}
"""Files, and what the command is told."""
BY_NETWORK = "fused.toml"
"""A network's sums are rounded otherwise on other processors, and a score in a thousand lies on the
other side of a threshold."""


def shipped(name: str) -> str:
    return (FOLDER / name).read_text("utf-8")


@pytest.mark.slow
def test_the_command_writes_the_same_file_again(tmp_path):
    folder = write_kitti(tmp_path / "kitti")
    texts = []
    for name in ("one.toml", "other.toml"):
        fit([str(tmp_path / name), "--kitti", str(folder), "--sequences", "0000"])
        texts.append((tmp_path / name).read_text("utf-8"))
    assert texts[0] == texts[1]
    assert read_detector(str(tmp_path / "one.toml")).traits.surplus.min() >= 1


def test_every_file_says_where_it_comes_from():
    known = {path.name for path in FOLDER.glob("*.toml")}
    assert known == {KITTI, "unknown.toml", "unscaled.toml", *SENSED}
    for name in SENSED:
        first, last = map(int, re.findall(r"train seeds (\d+) to (\d+)", shipped(name))[0])
        assert 0 <= first <= last < 10_000, "none of them is one of validation or test"
    assert "KITTI tracking training sequences" in tomllib.loads(shipped(KITTI))["origin"]


@pytest.mark.slow
def test_what_was_learned_of_kitti_is_learned_again(tmp_path):
    folder = os.environ.get("ROADSCOPE_KITTI")
    if not folder:
        pytest.skip("ROADSCOPE_KITTI names no folder of KITTI tracking data")
    found = re.findall(r"\b\d{4}\b", tomllib.loads(shipped(KITTI))["origin"])
    if not all((Path(folder) / "label_02" / f"{name}.txt").is_file() for name in found):
        pytest.skip("not all sequences that it was learned from are there")
    fit([str(tmp_path / KITTI), "--kitti", folder, "--sequences", ",".join(found)])
    assert (tmp_path / KITTI).read_text("utf-8") == shipped(KITTI)


@pytest.mark.slow
@pytest.mark.parametrize("name", SENSED)
def test_what_was_learned_of_our_traffic_is_learned_again(name, tmp_path):
    fit([str(tmp_path / name), *SENSED[name]])
    again = (tmp_path / name).read_text("utf-8")
    if name == BY_NETWORK:
        assert_alike(tomllib.loads(again), tomllib.loads(shipped(name)))
    else:
        assert again == shipped(name)


def assert_alike(again, before):
    """Traits differ by no more than a few detections would make them."""
    assert again.keys() == before.keys()
    for name, section in before.items():
        if name == "origin":
            assert again[name] == section
            continue
        assert again[name].keys() == section.keys()
        for trait, value in section.items():
            assert again[name][trait] == pytest.approx(value, rel=0.05, abs=0.05), (name, trait)
