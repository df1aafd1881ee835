import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import pytest

from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.metrics import MARKS_M
from roadscope.benchmarks.report import draw_curves, has_curves, save_all
from roadscope.benchmarks.results import Results, Row, Standing

PANELS = board_named("odometry").by_distance
ENTRIES = [f"odometry-{k}" for k in range(12)]


def curve(entry, metric, drift):
    """Drift at each distance; none is as long as the last."""
    rows = {mark: (drift * mark, drift * mark / 2, drift * mark * 2, 5) for mark in MARKS_M}
    rows[MARKS_M[-1]] = None, None, None, 0
    return [
        Row("odometry", entry, metric, *figures, "%", "lower", "distance", str(mark))
        for mark, figures in rows.items()
    ]


PARTS = tuple(
    row
    for k, entry in enumerate(ENTRIES)
    for metric in PANELS
    for row in curve(entry, metric, 0.01 * (k + 1))
)
ROWS = tuple(Row("odometry", entry, "t_rel", 1.0, 0.5, 2.0, 5, "%", "lower") for entry in ENTRIES)
PLACES = tuple(Standing("odometry", entry, None, 1, 1, 2) for entry in ENTRIES)
RESULTS = Results({"suite": "tiny"}, ROWS, (), PARTS, PLACES)


def texts(path):
    words = ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")
    return ["".join(word.itertext()) for word in words]


def test_every_entry_has_its_name_and_every_axis_too(tmp_path) -> None:
    draw_curves(RESULTS, tmp_path / "drift.svg")
    labels = texts(tmp_path / "drift.svg")
    assert [word for word in labels if word in ENTRIES] == ENTRIES
    assert set(PANELS.values()) <= set(labels)
    assert labels.count("distance driven (m)") == len(PANELS)
    # No drive is as long as the last mark.
    assert labels.count("400") == len(PANELS)
    assert "800" not in labels


def test_the_legend_of_many_entries_is_whole(tmp_path) -> None:
    entries = [f"odometry-{k}" for k in range(30)]
    parts = tuple(row for e in entries for metric in PANELS for row in curve(e, metric, 0.1))
    rows = tuple(replace(ROWS[0], entry=entry) for entry in entries)
    places = tuple(Standing("odometry", entry, None, 1, 1, 2) for entry in entries)
    path = tmp_path / "drift.svg"
    draw_curves(Results({"suite": "tiny"}, rows, (), parts, places), path)
    root = ElementTree.parse(path).getroot()
    height = float(root.attrib["viewBox"].split()[3])
    lowest = max(
        float(number.split()[-1].rstrip(")"))
        for word in root.iter("{http://www.w3.org/2000/svg}text")
        if word.text in entries
        for number in re.findall(r"translate\(([^)]*)\)", word.attrib.get("transform", ""))
        or [word.attrib["y"]]
    )
    assert lowest < height


def test_the_same_results_give_the_same_bytes(tmp_path) -> None:
    one, other = tmp_path / "one.svg", tmp_path / "other.svg"
    draw_curves(RESULTS, one)
    draw_curves(RESULTS, other)
    assert one.read_bytes() == other.read_bytes()
    draw_curves(replace(RESULTS, parts=PARTS[:-7]), other)
    assert one.read_bytes() != other.read_bytes()


@pytest.mark.parametrize("ending", ["png", "pdf"])
def test_other_formats_go_by_the_ending(tmp_path, ending) -> None:
    draw_curves(RESULTS, tmp_path / f"drift.{ending}")
    start = {"png": b"\x89PNG", "pdf": b"%PDF"}[ending]
    assert (tmp_path / f"drift.{ending}").read_bytes().startswith(start)


def test_it_is_saved_beside_the_odometry_board_alone(tmp_path) -> None:
    assert save_all(RESULTS, tmp_path)[-1] == tmp_path / "drift.svg"
    others = tuple(replace(row, board="detection", by="range") for row in PARTS)
    assert not has_curves(
        replace(RESULTS, rows=(replace(ROWS[0], board="detection"),), parts=others)
    )
    unknown = tuple(replace(row, value=None, low=None, high=None) for row in PARTS)
    assert not has_curves(replace(RESULTS, parts=unknown))


@pytest.mark.parametrize(
    "name",
    ["we$\\foo$.py:Mine", "_mine.py:Mine", "\x1b[31m.py:Mine", "/".join(["folder"] * 40) + ":Mine"],
)
def test_a_name_of_any_kind_is_in_the_legend(tmp_path, name) -> None:
    parts = tuple(row for metric in PANELS for row in curve(name, metric, 0.1))
    place = Standing("odometry", name, None, 1, 1, 2)
    row = Row("odometry", name, "t_rel", 1.0, 0.5, 2.0, 5, "%", "lower")
    draw_curves(Results({"suite": "tiny"}, (row,), (), parts, (place,)), tmp_path / "drift.svg")
    assert "".join(texts(tmp_path / "drift.svg")).endswith(name.replace("\x1b", "?"))
