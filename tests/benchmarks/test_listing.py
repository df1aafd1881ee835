"""What can be named is described."""

import json
import os
import shutil
import subprocess
import sys
import tomllib
from importlib import resources

import pytest
from rich.console import Console

from roadscope.benchmarks import KINDS, SUITES, SuiteError, name_table, names_of
from roadscope.benchmarks.boards import BOARDS
from roadscope.benchmarks.recorded import KITTI, MOT
from roadscope.detectors import DETECTORS
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.envs.sensors import FAULTS, WEATHERS
from roadscope.fusion import FUSIONS
from roadscope.trackers import TRACKERS


@pytest.mark.parametrize(
    "ours", [DETECTORS, TRACKERS, CAMERA_DETECTORS, FUSIONS], ids=lambda ours: ours.kind
)
def test_every_registered_name_of_ours_and_no_other_has_a_line_of_its_own(ours):
    names = [name for name in ours.names() if ours.resolve(name).ours]
    assert list(ours.summaries) == names
    assert len(set(ours.summaries.values())) == len(names)


@pytest.mark.parametrize("kind", ["detectors", "trackers", "camera-detectors", "fusions"])
def test_each_takes_one_line_of_an_ordinary_terminal(kind):
    names = names_of(kind)
    console = Console(width=80, record=True, file=None, quiet=True)
    assert len(console.render_lines(name_table(kind, names))) == len(names) + 1


@pytest.mark.parametrize(
    ("right", "wrong", "words"),
    [
        ("\nlidar =", "\nlidra =", ("boards", "lidra")),
        ("version =", "versoin =", ("'versoin'", "'version'")),
    ],
)
def test_a_wrong_key_in_the_file_of_recorded_data_is_refused(
    right, wrong, words, tmp_path, monkeypatch
):
    copied = shutil.copytree(
        resources.files("roadscope.benchmarks") / "suites", tmp_path / "suites"
    )
    file = copied / f"{KITTI}.toml"
    file.write_text(file.read_text().replace(right, wrong))
    monkeypatch.setattr(resources, "files", lambda package: tmp_path)
    with pytest.raises(SuiteError) as caught:
        names_of("suites")
    assert all(each in str(caught.value) for each in (str(file), *words))


@pytest.mark.parametrize("name", [KITTI, MOT])
def test_recorded_data_has_entries_for_boards_that_exist(name):
    file = resources.files("roadscope.benchmarks") / "suites" / f"{name}.toml"
    assert set(tomllib.loads(file.read_text())["boards"]) <= set(BOARDS)


@pytest.mark.parametrize("kind", KINDS)
def test_everything_is_described(kind):
    assert all(text.strip() for _, text in names_of(kind))


@pytest.mark.parametrize(
    ("kind", "known", "name", "message"),
    [
        ("weathers", WEATHERS, "fog-3", "visibility 120 m"),
        ("weathers", WEATHERS, "rain-2", "10 mm/h"),
        ("faults", FAULTS, "clock-offset", "clock-offset:5 are 5, 10, 25, 50, 100 ms"),
    ],
)
def test_every_weather_and_fault_is_listed_with_its_numbers(kind, known, name, message):
    listed = dict(names_of(kind))
    assert list(listed) == list(known)
    assert message in listed[name]


def test_stages_say_nothing_of_the_shapes_of_their_answers():
    assert [text for _, text in names_of("stages") if "(N" in text or "int64" in text] == []


def test_suites_of_recorded_data_say_what_they_need():
    suite_descriptions = dict(names_of("suites"))
    assert {*SUITES, KITTI, MOT} == set(suite_descriptions)
    assert "--kitti DIR" in suite_descriptions[KITTI]
    assert "--mot DIR" in suite_descriptions[MOT]


THEIRS = """
class Theirs:
    '''Finds nothing.

    Whatever it is given.
    '''
"""
POINTS = """
[roadscope.detectors]
whole = theirs:Theirs
set = theirs:Theirs?gate_m=2
broken = theirs:Nobody
"""


def test_a_plug_in_of_another_package_is_described_by_its_class(tmp_path):
    info = tmp_path / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(POINTS)
    (tmp_path / "theirs.py").write_text(THEIRS)
    done = subprocess.run(
        [sys.executable, "-m", "roadscope", "list", "detectors", "--json"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])},
        capture_output=True,
        text=True,
        check=True,
    )
    descriptions = json.loads(done.stdout)["detectors"]
    assert descriptions["whole"] == "Finds nothing."
    assert descriptions["set"] == "Finds nothing. (gate_m=2)"
    assert descriptions["broken"].startswith("cannot be loaded: no class 'Nobody'")
