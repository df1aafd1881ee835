"""The contract kit: what it says of plug-ins that break one promise each, and of good ones."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import roadscope
from roadscope import SpecError
from roadscope.__main__ import app
from roadscope.benchmarks.isolation import sandbox_available
from roadscope.testing import ContractItem, Item, PromiseError, check, contract_items

HERE = Path(__file__).parent
TRACKERS, SENSORS, ODOMETRIES, DRIVERS = (
    HERE / f"bad_{name}.py" for name in ("trackers", "sensors", "odometries", "drivers")
)
DETECTORS = HERE.parent / "benchmarks" / "plugins.py"
NAME, METHODS, ANSWERS, FIGURE = "without arguments", "has reset and", "answers", "two seconds"
INPUT, REPEATS, RESET = "input alone", "gives the same", "at a reset"
DRIVES = "drives"
BROKEN = [
    (TRACKERS, "tracker", "NeedsArguments", NAME, "'gate_m'"),
    (TRACKERS, "tracker", "Positional", NAME, "def __init__(self, *, gate_m)"),
    (TRACKERS, "tracker", "RaisesWhenMade", NAME, "OSError: no weights (bad_trackers.py:"),
    (TRACKERS, "tracker", "WithoutReset", METHODS, "no method reset"),
    (TRACKERS, "tracker", "WithoutPose", ANSWERS, "TypeError"),
    (TRACKERS, "tracker", "WrongType", ANSWERS, "Detections"),
    (TRACKERS, "tracker", "ReturnsNan", ANSWERS, "Tracks.centres: must be finite"),
    (TRACKERS, "tracker", "WrongStamp", ANSWERS, "stamped"),
    (TRACKERS, "tracker", "WorldWithoutPose", ANSWERS, "possible: ego"),
    (TRACKERS, "tracker", "Raises", ANSWERS, "KeyError: 'what is this' (bad_trackers.py:"),
    (TRACKERS, "tracker", "Invents", "without detections", "there are tracks"),
    (TRACKERS, "tracker", "ReusesIds", "never uses an id again", "id 0 came back"),
    (TRACKERS, "tracker", "ChangesIds", "keeps the id", "[0, 1, 2"),
    (TRACKERS, "tracker", "DependsOnOrder", "order of detections", "in another order"),
    (TRACKERS, "tracker", "MutatesInput", INPUT, "update changed its argument 1"),
    (TRACKERS, "tracker", "Random", REPEATS, "the second time"),
    (TRACKERS, "tracker", "Remembers", RESET, "after another episode there are"),
    (TRACKERS, "tracker", "EmptyReset", RESET, "after another episode its id "),
    (TRACKERS, "tracker", "KeepsTracks", RESET, "after another episode its id "),
    (TRACKERS, "tracker", "RenamesTracks", RESET, "in another order"),
    (TRACKERS, "tracker", "KeepsOne", RESET, "after another episode its id "),
    (TRACKERS, "tracker", "KeepsTheClock", RESET, "ValueError: stamps must increase"),
    (TRACKERS, "tracker", "IgnoresThePose", "while the ego moves", "world_from_ego"),
    (TRACKERS, "tracker", "FollowsNothing", "keeps the id", "no track"),
    (TRACKERS, "tracker", "FollowsNothing", FIGURE, "no track"),
    (TRACKERS, "tracker", "NumbersRows", FIGURE, "HOTA"),
    (TRACKERS, "tracker", "LateWithout", "has rescored", "no method rescored"),
    (TRACKERS, "tracker", "LateNothing", "rescores every frame", "NoneType"),
    (TRACKERS, "tracker", "LateShort", "rescores every frame", "19 records for 20"),
    (TRACKERS, "tracker", "LateSwapped", "rescores every frame", "stamped 1.9"),
    (TRACKERS, "tracker", "LateScribbles", "history alone", "rescored changed its argument 1"),
    (TRACKERS, "tracker", "LateCounts", "rescores the same history", "the second time"),
    (TRACKERS, "tracker", "LateForgets", "updates as before", "changes what update answers"),
    (DETECTORS, "detector", "Raises", ANSWERS, "KeyError"),
    (DETECTORS, "detector", "ReturnsNonsense", ANSWERS, "not Detections"),
    (DETECTORS, "detector", "ReturnsNan", ANSWERS, "must be finite"),
    (DETECTORS, "detector", "Late", ANSWERS, "the stamp of the frame"),
    (DETECTORS, "detector", "Scribbles", INPUT, "detect changed its argument 1"),
    (DETECTORS, "detector", "KeepsTheFirstScan", RESET, "give other detections"),
    (DETECTORS, "detector", "WithoutReset", METHODS, "no method reset"),
    (DETECTORS, "detector", "Dies", ANSWERS, "exit status 3"),
    (DETECTORS, "detector", "Prints", FIGURE, "0 boxes"),
    (DETECTORS, "detector", "LooksAside", FIGURE, "'ego', x ahead"),
    (ODOMETRIES, "odometry", "WithoutMounting", METHODS, "TypeError"),
    (ODOMETRIES, "odometry", "ReturnsMatrix", ANSWERS, "ndarray"),
    (ODOMETRIES, "odometry", "WrongStamp", ANSWERS, "stamped"),
    (ODOMETRIES, "odometry", "ForgetsReturns", ANSWERS, "dynamic has 3 values for "),
    (ODOMETRIES, "odometry", "StartsElsewhere", ANSWERS, "3 m from the start"),
    (ODOMETRIES, "odometry", "FliesOff", ANSWERS, "1e+09 m from the start"),
    (ODOMETRIES, "odometry", "ReturnsNan", ANSWERS, "must be finite"),
    (ODOMETRIES, "odometry", "Raises", ANSWERS, "KeyError: 'what is this' (bad_odometries.py:"),
    (ODOMETRIES, "odometry", "Scribbles", INPUT, "update changed its argument 1"),
    (ODOMETRIES, "odometry", "NeedsImu", "without an IMU", "AttributeError"),
    (ODOMETRIES, "odometry", "NeedsReturns", "without returns", "ValueError: zero-size"),
    (ODOMETRIES, "odometry", "Random", REPEATS, "the second time"),
    (ODOMETRIES, "odometry", "KeepsTheFirstScan", RESET, "give other poses"),
    (ODOMETRIES, "odometry", "Unsaid", FIGURE, "still"),
    (SENSORS, "camera detector", "BoxesInSpace", ANSWERS, "Detections, not ImageDetections"),
    (SENSORS, "camera detector", "AnHourLate", ANSWERS, "stamped 360"),
    (SENSORS, "camera detector", "KeepsTheFirstImage", RESET, "give other boxes"),
    (SENSORS, "camera detector", "SeesInTheDark", "black image", "1 boxes"),
    (SENSORS, "camera detector", "Greyscale", "other sizes", "320 x 240"),
    (SENSORS, "camera detector", "Fine", FIGURE, "left, top, right, bottom in pixels"),
    (SENSORS, "fusion", "NeedsBoth", "with one sensor", "AttributeError"),
    (SENSORS, "fusion", "MakesUp", "with one sensor", "no detections"),
    (SENSORS, "fusion", "KeepsTheFirstTargets", RESET, "give other targets"),
    (SENSORS, "fusion", "ReturnsDetections", ANSWERS, "Detections, not FusedDetections"),
    (SENSORS, "fusion", "Unsettled", REPEATS, "the second time"),
    (SENSORS, "fusion", "FindsAQuarter", FIGURE, "one sensor alone"),
    (DRIVERS, "driver", "WithoutReset", METHODS, "no method reset"),
    (DRIVERS, "driver", "ReturnsNumbers", DRIVES, "tuple, not DrivingCommand"),
    (DRIVERS, "driver", "ReturnsNan", DRIVES, "expected a finite number"),
    (DRIVERS, "driver", "LeavesTheRoad", DRIVES, "there are lanes 0 to 3"),
    (DRIVERS, "driver", "Collides", DRIVES, "it collides"),
    (DRIVERS, "driver", "Parks", DRIVES, "it hardly drives"),
    (DRIVERS, "driver", "Scribbles", INPUT, "drive changed its argument 1"),
    (DRIVERS, "driver", "Random", REPEATS, "the second time"),
    (DRIVERS, "driver", "KeepsTheFirstScene", RESET, "give other commands"),
]
"""File, kind, class, promise that it breaks (part of its words), part of what is said of it."""
GOOD = [
    (TRACKERS, "tracker", ("Good", "CountsAnew", "RandomNames", "Late")),
    (SENSORS, "fusion", ("Mine",)),
    (ODOMETRIES, "odometry", ("Good",)),
    (DRIVERS, "driver", ("Good",)),
]
"""Plug-ins that keep all promises: ids go on after a reset, begin anew, or are drawn."""


def items_of(spec: str, kind: str, part: str) -> list[ContractItem]:
    """Return the promises of a plug-in in whose words a text stands."""
    items = [item for item in contract_items(spec, kind=kind) if part in item.promise.words]
    assert items, f"no promise of a {kind} has '{part}' in its words"
    return items


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("file", "kind", "name", "promise", "words"), BROKEN)
def test_a_broken_promise_is_named(
    file: Path, kind: str, name: str, promise: str, words: str
) -> None:
    (item,) = items_of(f"{file}:{name}", kind, promise)
    with pytest.raises(PromiseError) as raised:
        item.verify()
    assert words in str(raised.value)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("file", "kind", "name"), [(file, kind, name) for file, kind, names in GOOD for name in names]
)
def test_a_good_plugin_keeps_every_promise(file: Path, kind: str, name: str) -> None:
    for item in contract_items(f"{file}:{name}", kind=kind):
        item.verify()


def test_a_figure_stands_beside_those_of_ours() -> None:
    """Of an odometry that goes on at 10 m/s, as the ego does there."""
    last = contract_items(f"{ODOMETRIES}:Good", kind="odometry")[-1]
    own_m, reference_m, still_m = map(float, re.findall(r"([\d.]+) m\b", last.verify()))
    assert reference_m < own_m < 0.5 * still_m


@pytest.mark.slow
def test_a_pytest_of_ones_own_can_run_it(tmp_path: Path) -> None:
    """As the page `bring-your-own` prints it."""
    page = (HERE.parents[1] / "docs" / "bring-your-own.md").read_text()
    (block,) = (each for each in re.findall(r"```python\n(.*?)```", page, re.S) if "items(" in each)
    for name in ("SaysItsKind", "Invents"):
        text = re.sub(r'contract_items\("[^"]*"', f'contract_items("{TRACKERS}:{name}"', block)
        (tmp_path / f"test_{name.lower()}.py").write_text(text)
    paths = [str(HERE.parents[1]), os.environ.get("PYTHONPATH", "")]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
        capture_output=True,
        text=True,
        timeout=300,
    )
    count = len(contract_items(f"{TRACKERS}:SaysItsKind"))
    assert done.returncode == 1
    assert f"1 failed, {2 * count - 1} passed" in done.stdout
    assert "there are tracks" in done.stdout


def test_an_unrequested_second_pass_is_reported() -> None:
    (item,) = items_of(f"{TRACKERS}:Online", "tracker", ANSWERS)
    assert "offline = True" in item.verify()


def test_a_report_has_an_item_for_every_promise() -> None:
    reported_items: list[Item] = []
    done = roadscope.check(f"{TRACKERS}:Prints", kind="tracker", report=reported_items.append)
    assert tuple(reported_items) == done.items
    promises = [item.promise.words for item in contract_items(f"{TRACKERS}:Prints", kind="tracker")]
    assert [item.promise for item in done.items[1:-1]] == promises
    assert not done.ok
    assert done.broken == done.items[-1:]
    assert "hello from a tracker" in done.broken[0].remark
    assert all(str(item) in str(done) for item in done.items)


@pytest.mark.parametrize(
    ("name", "prints"),
    [("Raises", False), ("PrintsAndRaises", True), ("PrintsAndAnswersNan", True)],
)
def test_an_error_is_no_output_of_the_plugin(name: str, prints: bool) -> None:
    done = roadscope.check(f"{TRACKERS}:{name}", kind="tracker")
    assert not done.ok
    assert done.items[-1].good == (not prints), done.items[-1]


@pytest.mark.slow
@pytest.mark.parametrize("trust", [False, True], ids=["isolated", "trusted"])
def test_it_runs_in_this_process_on_demand(trust: bool) -> None:
    done = check(f"{TRACKERS}:MutatesInput", kind="tracker", trust=trust)
    assert any("changed its argument" in item.remark for item in done.broken)
    assert check(f"{TRACKERS}:Good", kind="tracker", trust=trust).ok


WRITES = """
from contextlib import suppress
from pathlib import Path

def write(name):
    with suppress(OSError):
        Path(__file__).with_name(name).touch()

write("loaded")

class Tracker:
    kind = "tracker"

    def __init__(self):
        write("made")

    def update(self, detections, ego_pose): ...
"""


@pytest.mark.skipif(bool(sandbox_available()), reason=sandbox_available() or "-")
def test_a_sandbox_lets_it_write_no_file(tmp_path: Path) -> None:
    (tmp_path / "writes.py").write_text(WRITES)
    spec, written = f"{tmp_path / 'writes.py'}:Tracker", (tmp_path / "loaded", tmp_path / "made")
    done = CliRunner().invoke(app, ["check", spec, "--sandbox"])
    assert done.exit_code == 1
    assert "no method reset" in done.output
    assert not any(path.exists() for path in written)
    check(spec)
    assert all(path.exists() for path in written)


@pytest.mark.slow
def test_what_hangs_is_named_and_not_tried_again() -> None:
    done = check(f"{TRACKERS}:Hangs", kind="tracker", deadline_s=2.0)
    assert [item.good for item in done.items] == [True, True, True, False, True]
    assert "hangs" in done.broken[0].remark


def test_what_ends_its_process_is_named() -> None:
    done = check(f"{TRACKERS}:Ends", kind="tracker")
    assert "exit status 7" in done.broken[0].remark
    assert not done.items[-2].good


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("no_such_file.py:Mine", "no file"),
        ("oracle", "made from the truth"),
        ("noisy?miss=0.2", "made from the truth"),
        ("noisy-camera", "made from the truth"),
        ("fused?lidar=pag", "each of the three"),
        ("utmost", "utmost"),
        (f"{TRACKERS}:Best", "no class 'Best'"),
        (f"{TRACKERS}:Neither", "update()"),
        (f"{TRACKERS}:Good", 'kind = "tracker"'),
        (f"{DETECTORS}:Late", 'kind = "detector"'),
    ],
)
def test_what_is_no_plugin_of_one_kind_is_said(spec: str, words: str) -> None:
    done = check(spec)
    assert not done.ok
    assert len(done.items) == 1
    assert words in done.items[0].remark
    with pytest.raises(SpecError):
        contract_items(spec)


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(SpecError, match="odometry"):
        check(f"{TRACKERS}:Good", kind="oddity")


@pytest.mark.parametrize(
    ("spec", "kind"),
    [
        ("voxel-map", "odometry"),
        ("gnn", "tracker"),
        ("gnn?gate_m=2.0&ego=voxel-map", "tracker"),
        ("colour-blobs", "camera detector"),
        ("union", "fusion"),
        ("roadscope.fusion.baselines:UnionFusion", "fusion"),
        ("cluster-boxes", "detector"),
        (f"{TRACKERS}:SaysItsKind", "tracker"),
    ],
)
def test_the_kind_comes_from_the_registry_the_class_or_its_method(spec: str, kind: str) -> None:
    assert {item.kind.name for item in contract_items(spec)} == {kind}


def test_a_wrong_argument_is_named_without_a_place_in_the_code() -> None:
    done = check("gnn?foo=1")
    assert not done.ok
    assert "foo" in done.broken[0].remark
    assert ".py:" not in done.broken[0].remark


@pytest.mark.slow
def test_the_command_fails_when_a_promise_is_broken() -> None:
    done = CliRunner().invoke(app, ["check", f"{TRACKERS}:WithoutReset", "--kind", "tracker"])
    assert done.exit_code == 1
    assert sum(line.startswith("WRONG") for line in done.output.splitlines()) == 1
    good = CliRunner().invoke(app, ["check", f"{TRACKERS}:SaysItsKind"])
    assert good.exit_code == 0
