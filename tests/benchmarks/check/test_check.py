from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from typer.testing import CliRunner

from roadscope.__main__ import app
from roadscope.benchmarks.check import (
    camera_detectors,
    detectors,
    fusions,
    odometries,
    offline,
    plugin,
    trackers,
)
from roadscope.benchmarks.check.items import Item, Promise, PromiseError, traffic_ready
from roadscope.benchmarks.check.plugin import (
    LOADED,
    PATIENCE_S,
    QUIET,
    READY,
    check_plugin,
    load,
    looked_at,
)
from roadscope.benchmarks.noisy_camera import CAMERA_NOISES
from roadscope.benchmarks.oracle import CLUSTER_BOXES, FUSED, ORACLE
from roadscope.core.registry import SpecError
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.fusion import FUSIONS
from roadscope.trackers import TRACKERS as TRACKERS_OF_OURS

HERE = Path(__file__).parent
TRACKERS, DETECTORS = HERE / "bad_trackers.py", HERE.parent / "plugins.py"
ODOMETRIES = HERE / "bad_odometries.py"
ANSWERS = "answers each scan with a pose, the first at the start"
SLOW = "follows two seconds of traffic"
WRONG = {
    TRACKERS: [
        ("NeedsArguments", "made by its name alone", "argument 'gate_m' has no default; give it"),
        ("Positional", "made by its name alone", "def __init__(self, *, gate_m=2.0)"),
        ("RaisesWhenMade", "made by its name alone", "OSError: no weights (bad_trackers.py:"),
        ("WithoutReset", "has reset and update", "no method reset; the contract has def reset"),
        ("WithoutPose", "has reset and update", "update cannot be called as the contract does"),
        ("WrongType", "answers with tracks of the same moment", "returned Detections, not"),
        ("ReturnsNan", "answers with tracks of the same moment", "Tracks.centres: must be finite"),
        ("WrongStamp", "answers with tracks of the same moment", "return the stamp of the det"),
        ("WorldWithoutPose", "answers with tracks of the same moment", "possible: ego"),
        ("Raises", "answers with tracks of the same moment", "KeyError: 'what is this' (bad_t"),
        ("Invents", "takes frames without detections", "no detections, yet there are tracks"),
        ("ReusesIds", "never uses an id again", "id 0 came back"),
        ("ChangesIds", "keeps the id of what it follows", "had the ids [0, 1, 2"),
        ("DependsOnOrder", "the order of detections is irrelevant", "in another order the "),
        ("MutatesInput", "leaves its input alone", "changed the detections"),
        ("Random", "the same input gives the same tracks", "gives other tracks the second time"),
        ("Remembers", "reset forgets everything", "after another episode there are"),
        ("EmptyReset", "reset forgets everything", "after another episode its id "),
        ("KeepsTracks", "reset forgets everything", "after another episode its id "),
        ("RenamesTracks", "reset forgets everything", "episode ids are given in another order"),
        ("KeepsOne", "reset forgets everything", "after another episode its id "),
        ("KeepsTheClock", "reset forgets everything", "ValueError: stamps must increase"),
        ("IgnoresThePose", "follows what stands while the ego moves", "ego_pose is world_from_e"),
        ("FollowsNothing", "keeps the id of what it follows", "never followed within 1 m"),
        ("FollowsNothing", SLOW, "nothing is followed"),
        ("LateWithout", "has rescored, being offline", "no method rescored; the contract has"),
        ("LateNothing", "tells the same moments anew", "rescored returned NoneType, not a seq"),
        ("LateShort", "tells the same moments anew", "rescored returned 19 records for the 20"),
        ("LateSwapped", "tells the same moments anew", "rescored: tracks are stamped 1.9"),
        ("LateScribbles", "leaves the history alone", "rescored changed the tracks"),
        ("LateCounts", "tells the same history in the same way", "another way the second time"),
        ("LateForgets", "goes on as if nothing had been told anew", "changes what update answers"),
    ],
    DETECTORS: [
        ("Raises", "answers with detections of a frame it saw", "KeyError: 'what\\nis this' (pl"),
        ("ReturnsNonsense", "answers with detections of a frame it saw", "returned list, not"),
        ("ReturnsNan", "answers with detections of a frame it saw", "must be finite"),
        ("Late", "answers with detections of a frame it saw", "return the stamp of the frame"),
        ("Scribbles", "leaves its input alone", "changed the frame it was given"),
        ("WithoutReset", "has reset and detect", "no method reset"),
        ("Prints", "detects two seconds of traffic", "nothing is detected"),
        ("LooksAside", "detects two seconds of traffic", "and none of them on a car"),
    ],
    ODOMETRIES: [
        ("WithoutMounting", "has reset and update", "def reset(self, lidar_from_imu)"),
        ("ReturnsMatrix", ANSWERS, "update returned ndarray, not OdometryEstimate"),
        ("WrongStamp", ANSWERS, "the estimate is stamped 1.05"),
        ("ForgetsReturns", ANSWERS, "dynamic has 3 values for "),
        ("StartsElsewhere", ANSWERS, "the first pose is 3 m from the start"),
        ("FliesOff", ANSWERS, "a pose 1e+09 m from the start"),
        ("ReturnsNan", ANSWERS, "must be finite"),
        ("Raises", ANSWERS, "KeyError: 'what is this' (bad_odometries.py:"),
        ("Scribbles", "leaves its input alone", "update changed the scan or the samples"),
        ("NeedsImu", "goes on without an IMU", "AttributeError"),
        ("NeedsReturns", "goes on after scans without returns or numbers", "ValueError: zero-size"),
        ("Random", "the same scans give the same poses", "give other poses the second time"),
        ("Remembers", "reset forgets everything", "the same scans after it give other poses"),
    ],
}
"""Plug-ins of a file, the promise that each breaks, and what is said of it."""
GOOD = ("Good", "CountsAnew", "RandomNames")
"""Their ids go on after a reset, begin anew, or are drawn."""


def item(spec: str, promise: str) -> Item:
    plugin, promises = load(spec)
    return looked_at(next(p for p in promises if p.words == promise), plugin)


@pytest.mark.parametrize("promise", [p.words for p in trackers.PROMISES if p.words != SLOW])
@pytest.mark.parametrize("name", [*map(f"{TRACKERS}:{{}}".format, GOOD), "nearest", "gnn"])
def test_good_trackers_keep_every_promise(name: str, promise: str) -> None:
    found = item(name, promise)
    assert found.good, found.words


@pytest.mark.parametrize(
    ("file", "name", "promise", "words"),
    [(file, *row) for file, rows in WRONG.items() for row in rows],
)
def test_what_is_wrong_is_said(file: Path, name: str, promise: str, words: str) -> None:
    found = item(f"{file}:{name}", promise)
    assert found.good is False
    assert words in found.words


@pytest.mark.parametrize("promise", [p.words for p in offline.PROMISES])
@pytest.mark.parametrize("name", [f"{TRACKERS}:Late", "existence-offline"])
def test_good_offline_trackers_keep_every_promise(name: str, promise: str) -> None:
    found = item(name, promise)
    assert found.good, found.words


def test_a_second_pass_that_nobody_asks_for_is_remarked() -> None:
    assert load(f"{TRACKERS}:Online")[1] == trackers.PROMISES
    found = item(f"{TRACKERS}:Online", "has reset and update")
    assert found.good
    assert "the class does not say offline = True" in found.words


def test_two_seconds_of_traffic_are_scored() -> None:
    found = item(f"{TRACKERS}:Good", SLOW)
    assert found.good
    assert found.words.startswith("HOTA 1.00 on perfect detections of a motorway, ")


def test_rows_are_no_identities() -> None:
    words = item(f"{TRACKERS}:NumbersRows", SLOW).words
    assert float(words.split()[1]) < 0.5


@pytest.mark.parametrize("promise", [p.words for p in detectors.PROMISES])
def test_a_good_detector_keeps_every_promise(promise: str) -> None:
    found = item("distance", promise)
    assert found.good, found.words


@pytest.mark.parametrize("promise", [p.words for p in camera_detectors.PROMISES])
@pytest.mark.parametrize("name", CAMERA_DETECTORS.installed())
def test_our_camera_detectors_keep_every_promise(name: str, promise: str) -> None:
    found = item(name, promise)
    assert found.good, found.words


@pytest.mark.parametrize("promise", [p.words for p in fusions.PROMISES])
@pytest.mark.parametrize("name", FUSIONS.installed())
def test_our_fusions_keep_every_promise(name: str, promise: str) -> None:
    found = item(name, promise)
    assert found.good, found.words


@pytest.mark.parametrize(
    ("name", "promise", "words"),
    [
        ("BoxesInSpace", "answers with boxes in the image it saw", "returned Detections, not Im"),
        ("AnHourLate", "answers with boxes in the image it saw", "stamped 3600"),
        ("SeesInTheDark", "finds nothing in a black image", "1 boxes in an image that is black"),
        ("Greyscale", "takes images of other sizes", "boxes reach beyond an image of 320 x 240"),
        ("NeedsBoth", "goes on with one sensor, and finds nothing of nothing", "AttributeError"),
        ("MakesUp", "goes on with one sensor, and finds nothing of nothing", "which found nothing"),
        ("ReturnsDetections", "answers with targets of that moment", "returned Detections, not"),
        ("Unsettled", "the same detections give the same targets", "the second time"),
    ],
)
def test_what_is_wrong_with_cameras_and_fusions_is_said(
    name: str, promise: str, words: str
) -> None:
    found = item(f"{HERE / 'bad_sensors.py'}:{name}", promise)
    assert found.good is False
    assert words in found.words


@pytest.mark.parametrize("promise", [p.words for p in odometries.PROMISES])
@pytest.mark.parametrize("name", [f"{ODOMETRIES}:Good", "still", "dead-reckoning", "voxel-map"])
def test_good_odometries_keep_every_promise(name: str, promise: str) -> None:
    found = item(name, promise)
    assert found.good, found.words


def test_how_far_an_odometry_is_off_is_remarked() -> None:
    found = item(f"{ODOMETRIES}:Good", "follows two seconds of traffic")
    said = re.match(r"([\d.]+) m off after (\d+) m among traffic, ", found.words)
    assert said
    off_m, way_m = map(float, said.groups())
    assert abs(off_m - abs(19.0 - way_m)) < 2.0
    spoilt = item(f"{ODOMETRIES}:Unsaid", "goes on after scans without returns or numbers")
    assert spoilt.good


def test_kinds_are_told_apart() -> None:
    assert load("voxel-map")[1] is odometries.PROMISES
    assert load(f"{ODOMETRIES}:Good")[1] is odometries.PROMISES
    assert load(f"{ODOMETRIES}:Unsaid")[1] is odometries.PROMISES
    assert load("gnn")[1] == trackers.PROMISES
    assert load("existence-offline")[1] == (*trackers.PROMISES, *offline.PROMISES)
    assert load(f"{DETECTORS}:Late")[1] is detectors.PROMISES
    assert load("colour-blobs")[1] is camera_detectors.PROMISES
    assert load("roadscope.detectors.camera_baselines:ColourBlobs")[1] is camera_detectors.PROMISES
    # Without a word on what it returns, by what it reads.
    assert load(f"{HERE / 'bad_sensors.py'}:Unsaid")[1] is camera_detectors.PROMISES
    assert load("union")[1] is fusions.PROMISES
    assert load("roadscope.fusion.baselines:UnionFusion")[1] is fusions.PROMISES
    with pytest.raises(PromiseError, match="neither a method update"):
        load(f"{TRACKERS}:Neither")
    with pytest.raises(SpecError, match=r"no plug-in 'utmost'; .*; or name your"):
        load("utmost")
    with pytest.raises(SpecError, match="no class 'Best' in"):
        load(f"{TRACKERS}:Best")
    with pytest.raises(SpecError, match=r"'mine\.py:X:Y' has more than one colon; possible: pack"):
        load("mine.py:X:Y")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (ORACLE, "made from the truth and is no plug-in"),
        ("noisy?miss=0.2", "made from the truth and is no plug-in"),
        (next(iter(CAMERA_NOISES)), "made from the truth and is no plug-in"),
        (f"{FUSED}?lidar=pag", "check each of the three"),
    ],
)
def test_what_is_listed_but_no_plug_in_is_said_to_be_none(name: str, words: str) -> None:
    with pytest.raises(PromiseError, match=words):
        load(name)


def test_detectors_that_only_suites_name_can_be_looked_at() -> None:
    assert load(CLUSTER_BOXES)[1] is detectors.PROMISES


def test_a_wrong_argument_is_told_without_where_it_was_raised() -> None:
    found = looked_at(trackers.PROMISES[0], TRACKERS_OF_OURS.resolve("gnn?foo=1"))
    assert not found.good
    assert found.words.startswith("'gnn?foo=1': got an unexpected keyword argument 'foo'; its arg")
    assert ".py:" not in found.words


def test_all_of_it_in_a_process_of_its_own() -> None:
    told: list[Item] = []
    items = check_plugin(f"{TRACKERS}:Prints", told=told.append)
    assert told == items
    assert [i.promise for i in items] == [
        LOADED,
        *(p.words for p in trackers.PROMISES),
        QUIET,
    ]
    assert [i.promise for i in items if not i.good] == [QUIET]
    assert "it prints 'hello from a tracker'" in items[-1].words


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Hangs", "no answer within 2 s: it hangs"),
        ("Ends", "ended the whole program, exit code 7"),
    ],
)
def test_what_hangs_or_ends_the_program_is_told(name: str, words: str) -> None:
    items = check_plugin(f"{TRACKERS}:{name}", deadline_s=2.0)
    assert [i.good for i in items] == [True, True, True, False]
    assert items[-1] == Item("answers with tracks of the same moment", False, words)


def test_what_cannot_be_loaded_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[object] = []
    pipe = type("Pipe", (), {"send": staticmethod(sent.append)})
    plugin._look_at("no_such_file.py:Mine", pipe)  # type: ignore[arg-type]
    assert sent == [Item(LOADED, False, "no file no_such_file.py"), None]


def test_what_is_wrong_everywhere_is_told_once_with_the_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def wrong(_: object) -> str:
        raise PromiseError("it raises")

    promises = [Promise(f"promise {k}", wrong if k > 1 else lambda _: "") for k in range(5)]
    sent = list[Any]()
    monkeypatch.setattr(plugin, "load", lambda spec: (TRACKERS_OF_OURS.resolve("gnn"), promises))
    monkeypatch.setattr(plugin, "_kind", lambda promises: "a tracker")
    plugin._look_at("gnn", type("Pipe", (), {"send": staticmethod(sent.append)}))  # type: ignore[arg-type]
    items = [each for each in sent if isinstance(each, Item)]
    assert [each for each in items if not each.good] == [
        Item("promise 2", False, "it raises"),
        Item("and 2 more", False, "the same: it raises", 2),
    ]
    assert plugin.broken(items) == 3


@pytest.mark.parametrize(
    ("spec", "ours"),
    [
        ("long-range", True),
        ("long-range?fit=body", True),
        (CLUSTER_BOXES, True),
        ("roadscope.fusion.baselines:UnionFusion", True),
        (f"{TRACKERS}:Hangs", False),
        ("utmost", False),
        ("?", False),
    ],
)
def test_ours_are_given_the_time_that_compiling_takes(spec: str, ours: bool) -> None:
    assert plugin._patience_s(spec, 2.0) == (PATIENCE_S[READY] if ours else 2.0)
    assert plugin._patience_s(spec, 1e4) == 1e4


def test_what_ours_compile_is_not_held_against_a_plug_in(monkeypatch: pytest.MonkeyPatch) -> None:
    sent, done = list[Any](), list[int]()
    seen = Promise("is seen", lambda _: "ready" if done else "", lambda: done.append(1))
    monkeypatch.setattr(plugin, "load", lambda spec: (TRACKERS_OF_OURS.resolve("gnn"), [seen]))
    monkeypatch.setattr(plugin, "_kind", lambda promises: "a tracker")
    plugin._look_at("gnn", type("Pipe", (), {"send": staticmethod(sent.append)}))  # type: ignore[arg-type]
    assert sent[1:4] == [READY, "is seen", Item("is seen", True, "ready")]

    waited = list[float]()

    def poll(patience_s: float) -> bool:
        waited.append(patience_s)
        return True

    ears = {"poll": staticmethod(poll), "recv": staticmethod(iter(sent).__next__)}
    heard = list(plugin._heard(type("Pipe", (), ears), None, 2.0))  # type: ignore[arg-type]
    assert heard == [item for item in sent if isinstance(item, Item)]
    assert waited[:4] == [PATIENCE_S[LOADED]] * 2 + [PATIENCE_S[READY], 2.0]


def test_how_well_cameras_and_fusions_do_in_a_street_is_remarked() -> None:
    found = item("colour-blobs", "looks at two seconds of a street")
    assert "detection rate 0." in found.words
    boxes = item(f"{HERE / 'bad_sensors.py'}:Fine", "looks at two seconds of a street")
    assert boxes.good
    assert "left, top, right, bottom in pixels" in boxes.words
    joined = item("consistent", "joins two seconds of a street")
    assert "detection rate 0." in joined.words


@pytest.mark.parametrize("kind", [trackers, detectors, camera_detectors, fusions])
def test_who_looks_at_traffic_has_it_ready_before(kind: ModuleType) -> None:
    ready = {promise.ready for promise in kind.PROMISES} - {None}
    assert (
        ready
        == {
            trackers: {traffic_ready},
            detectors: {traffic_ready, detectors.frames},
            camera_detectors: {camera_detectors.frames},
            fusions: {fusions.street_ready},
        }[kind]
    )


def test_the_command_says_what_is_wrong_and_fails() -> None:
    done = CliRunner().invoke(app, ["check", f"{TRACKERS}:WithoutReset"])
    assert done.exit_code == 1
    ok, _, wrong, quiet, verdict = done.output.splitlines()
    assert ok == "ok     can be loaded: a tracker"
    assert wrong.startswith("WRONG  has reset and update: there is no method reset")
    assert quiet == "ok     prints nothing"
    assert verdict.endswith("WithoutReset: 1 item wrong")
