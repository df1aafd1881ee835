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
"""The arguments of the command for each shipped file."""
ALIKE = ("along_m", "across_m", "yaw_rad", "lasting", "yaw_lasting", "surplus")
"""Traits that a single seed determines well enough, of classes with many objects."""
MOST = 0.15
"""By how much they may differ: the first of the four seeds differs by 0.11."""


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
def test_shipped_kitti_traits_can_be_learned_again(tmp_path):
    folder = os.environ.get("ROADSCOPE_KITTI")
    if not folder:
        pytest.skip("ROADSCOPE_KITTI names no folder of KITTI tracking data")
    sequence_names = re.findall(r"\b\d{4}\b", tomllib.loads(shipped(KITTI))["origin"])
    if not all((Path(folder) / "label_02" / f"{name}.txt").is_file() for name in sequence_names):
        pytest.skip("not all sequences that it was learned from are there")
    fit([str(tmp_path / KITTI), "--kitti", folder, "--sequences", ",".join(sequence_names)])
    assert (tmp_path / KITTI).read_text("utf-8") == shipped(KITTI)


@pytest.mark.slow
def test_what_was_learned_of_our_traffic_is_learned_again(tmp_path):
    name = "roadscope.toml"
    fit([str(tmp_path / name), *SENSED[name]])
    assert (tmp_path / name).read_text("utf-8") == shipped(name)


@pytest.mark.slow
def test_one_seed_of_fused_detections_teaches_much_the_same(tmp_path):
    """All four, which take four minutes, are learned again at a release."""
    name = "fused.toml"
    fit([str(tmp_path / name), *SENSED[name], "--seeds", "1"])
    of_all = tomllib.loads(shipped(name))
    of_one = tomllib.loads((tmp_path / name).read_text("utf-8"))
    assert max(difference(of_one[kind], of_all[kind]) for kind in ("car", "pedestrian")) < MOST


def test_traits_of_another_detector_are_others():
    fused, clusters = (tomllib.loads(shipped(name)) for name in ("fused.toml", "roadscope.toml"))
    assert difference(clusters["car"], fused["car"]) > 2 * MOST


def difference(traits, others):
    """Return by which share the traits differ most that one seed tells."""
    return max(abs(traits[name] / others[name] - 1) for name in ALIKE)
