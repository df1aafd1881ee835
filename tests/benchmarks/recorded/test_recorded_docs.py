"""The page about recorded data says what readers read: its examples are a folder that works."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from roadscope.benchmarks import kitti_suite
from roadscope.benchmarks.formats import (
    CLASS_COLUMNS,
    CLASS_IDS,
    COLUMNS,
    DETECTION_COLUMNS,
    LABEL_COLUMNS,
    TYPE_NAMES,
    WORLD_COLUMNS,
    read_kitti_object_labels,
)
from roadscope.benchmarks.recorded import mot_suite, recordings_of
from roadscope.formats import KittiType, read_kitti_sequence

PAGE = Path(__file__).parents[3] / "docs" / "recorded-data.md"
BLOCKS = dict(re.findall(r"<!-- (.+?) -->\n```\w+\n(.*?)```", PAGE.read_text(), re.DOTALL))
FILES = {name.removeprefix("file "): b for name, b in BLOCKS.items() if name.startswith("file ")}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, content in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    return tmp_path


def test_columns_are_those_that_are_read() -> None:
    assert BLOCKS["columns of detections"].strip() == ",".join(DETECTION_COLUMNS)
    assert BLOCKS["columns of labels"].split() == list(LABEL_COLUMNS[:-1])
    kinds = [",".join(columns) for columns in (COLUMNS, CLASS_COLUMNS, WORLD_COLUMNS)]
    assert BLOCKS["columns of MOTChallenge"].splitlines() == kinds
    for name in TYPE_NAMES.values():
        assert name in PAGE.read_text()
    numbered = ", ".join(f"{k} {TYPE_NAMES[kind].lower()}" for k, kind in CLASS_IDS.items())
    assert f"`class` is {numbered}" in PAGE.read_text()


def test_example_of_kitti_is_read_as_the_page_says(folder: Path) -> None:
    assert [r.category for r in recordings_of(kitti_suite(folder))] == ["car"]
    sequence = read_kitti_sequence(folder, "0000")
    detections, boxed = sequence.detections[0], sequence.detection_rows[0]
    assert boxed.boxes[0].tolist() == [296.7, 161.8, 455.2, 292.4]
    assert boxed.scores[0] == 9.2
    assert detections.sizes[0].tolist() == [3.88, 1.63, 1.53]
    assert detections.centres[0] == pytest.approx([13.41, 4.55, -1.86 + 1.53 / 2])
    assert boxed.rotations_y[0] == -2.12
    assert boxed.alphas[0] == -1.79
    assert sequence.truths[0].ids.tolist() == [3]
    assert sequence.truths[0].centres[0] == pytest.approx(detections.centres[0])
    assert sequence.world_from_ego[1].translation == pytest.approx([0.9, 0, 0])


def test_example_of_object_labels_is_read(folder: Path) -> None:
    rows = read_kitti_object_labels(folder / "label_2" / "000000.txt")
    assert [TYPE_NAMES[KittiType(kind)] for kind in rows.types] == ["Car", "DontCare"]
    assert rows.bottoms[0].tolist() == [-0.65, 1.71, 46.70]


def test_example_of_motchallenge_is_read(folder: Path) -> None:
    suite = mot_suite(folder)
    assert [r.sequence for r in recordings_of(suite)] == ["MOT-toy"]
    recordings_of(suite)[0].check()
