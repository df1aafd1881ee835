import pickle
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from roadscope import Spec
from roadscope.benchmarks import (
    SPLITS,
    SUITES,
    BoardSettings,
    Eligibility,
    SuiteError,
    check_names,
    entry_kind,
    load_suite,
    parse_suite,
    plan,
)
from roadscope.benchmarks.boards import (
    CameraSettings,
    DrivingSettings,
    FusionSettings,
    OdometrySettings,
    TrackingSettings,
    boards_of,
)
from roadscope.core import SpecError
from roadscope.trackers import TRACKERS

PLUGINS = Path(__file__).parent / "plugins.py"
TINY = """
name = "tiny"
version = 3
rig = "lux"
scenarios = ["lu2018-three-vehicles"]
split = "validation"
seeds = 2
duration_s = 1.0
[detection]
entries = ["pag"]
[tracking]
entries = ["nearest"]
detectors = ["pag"]
"""


@pytest.mark.parametrize("name", ["driving", "driving-camera"])
def test_a_lidar_that_detects_people_drives_alone(name) -> None:
    stacks = load_suite(name).settings("driving", DrivingSettings).stacks
    assert "cluster-boxes + existence" in stacks


@pytest.mark.slow
@pytest.mark.parametrize("name", SUITES)
def test_shipped_suites_name_what_exists(name) -> None:
    suite = load_suite(name)
    check_names(suite)
    assert suite.name == name
    assert set(suite.seeds) <= set(SPLITS["test"])
    jobs = Counter(job.board.name for job in plan(suite, []).jobs)
    assert set(jobs) == {board.name for board in boards_of(suite) if board.suite_entries(suite)}
    conditions = len(suite.weathers) + len(suite.lights) + len(suite.faults) - 2
    episodes = len(suite.scenarios) * len(suite.seeds) * conditions
    ranked, tracking, camera, fusion = (
        suite.boards[name] for name in ("detection", "tracking", "camera", "fusion")
    )
    assert jobs["detection"] == episodes * (2 + len(ranked.entries) if ranked.entries else 0)
    tracked = len(tracking.entries) * len(tracking.detectors) * len(tracking.egos)
    assert jobs["tracking"] == episodes * tracked
    assert jobs["camera"] == episodes * (len(camera.entries) + 1 if camera.entries else 0)
    pairs = len(fusion.lidar) * len(fusion.camera)
    assert jobs["fusion"] == episodes * pairs * (len(fusion.entries) + 2 if fusion.entries else 0)


def test_splits_share_no_seed() -> None:
    seeds = [set(split) for split in SPLITS.values()]
    assert not set.intersection(*seeds)
    assert sum(map(len, seeds)) == len(set.union(*seeds))


def test_a_suite_of_ones_own(tmp_path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(TINY.replace('"lux"', '"mine-rig.toml"'))
    assert load_suite(path).rig == str(tmp_path / "mine-rig.toml")
    path.write_text(TINY)
    suite = load_suite(path)
    assert suite.title == "tiny v3"
    assert suite.seeds == (10_000, 10_001)
    assert suite.eligibility.min_returns == 10


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("seeds = 2", "seeds = 0", ["seeds"]),
        ("seeds = 2", "seeds = 10001", ["seeds", "'validation'", "10000", "10001"]),
        ("seeds = 2", "seeds = [3]", ["seeds", "10000", "19999"]),
        ("seeds = 2", "seeds = true", ["seeds", "bool"]),
        ("seeds = 2", "seed = 2", ["'seed'", "'seeds'"]),
        ('"validation"', '"tset"', ["'tset'", "'test'"]),
        ("version = 3", "", ["'version'", "missing"]),
        ('version = 3\nrig = "lux"', "", ["'version'", "'rig'", "missing"]),
        ("version = 3", 'version = "3"', ["version", "'3'"]),
        ("duration_s = 1.0", "duration_s = -1.0", ["duration_s", "-1.0"]),
        ("duration_s = 1.0", "duration_s = nan", ["duration_s", "nan"]),
        ("duration_s = 1.0", "duration_s = inf", ["duration_s", "inf"]),
        ("duration_s = 1.0", "duration_s = true", ["duration_s", "bool"]),
        ("[detection]", "[eligibility]\nrange_m = [9]\n[detection]", ["eligibility.range_m"]),
        ("[detection]", "[eligibility]\nrange_m = [9, 3]\n[detection]", ["range_m", "[9.0, 3.0]"]),
        ("[detection]", '[eligibility]\nfamilies = ["cat"]\n[detection]', ["vehicle", "cat"]),
        ("[detection]", "[camera]\nevery_s = 0\n[detection]", ["camera.every_s", "0"]),
        ("[detection]", '[fusion]\nlidar = "pag"\n[detection]', ["fusion.lidar", "'pag'"]),
        ("[detection]", "[odometry]\nlengths_m = []\n[detection]", ["odometry.lengths_m"]),
        ("[detection]", "detection = 3", ["detection", "3"]),
        ('["lu2018-three-vehicles"]', "[]", ["scenarios"]),
        ("[tracking]", '[tracking]\nego = ["none", ""]', ["tracking.ego[1]", "''"]),
        ("[tracking]", "[trackign]\n[tracking]", ["'trackign'", "'tracking'"]),
        ("[tracking]", "[tracking]\nentrys = 1", ["'tracking.entrys'", "'tracking.entries'"]),
        ("name =", "name ==", ["TOML"]),
    ],
)
def test_errors_say_what_is_wrong(old: str, new: str, words: list[str]) -> None:
    assert old in TINY
    text = TINY.replace(old, new)
    if new == "detection = 3":
        text = TINY.replace('[detection]\nentries = ["pag"]\n', "").replace(
            "name", f"{new}\nname", 1
        )
    with pytest.raises(SuiteError) as caught:
        parse_suite(text, "mine.toml")
    message = str(caught.value)
    assert message.startswith("mine.toml: ")
    assert not [word for word in words if word not in message]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "seed = 3\nname = 4\n[camera]\nevry_s = 1\n[odometry]\nlengths_m = [-1]",
            [
                "'seed'",
                "name",
                "'camera.evry_s'",
                "odometry.lengths_m[0]",
                "'rig'",
                "'version'",
                "'scenarios'",
                "'seeds'",
            ],
        ),
        (
            TINY.replace("seeds = 2", 'seeds = [1]\nlights = ["nihgt"]\nfaults = ["fog:9"]'),
            ["seeds", "'night'", "fog:9"],
        ),
    ],
)
def test_all_problems_are_named_at_once(text: str, words: list[str]) -> None:
    with pytest.raises(SuiteError) as caught:
        parse_suite(text, "mine.toml")
    assert not [word for word in words if word not in str(caught.value)]


def test_boards_without_inputs_are_named_at_once() -> None:
    tables = '[tracking]\nentries = ["nearest"]\n[driving]\nentries = ["idm"]\n'
    tables += '[camera]\nentries = ["network"]\n[fusion]\nentries = ["union"]\n'
    text = TINY.partition("[tracking]")[0] + tables
    with pytest.raises(SuiteError) as caught:
        plan(parse_suite(text, "mine.toml"), [])
    keys = ("tracking.detectors", "fusion.lidar", "fusion.camera", "driving.stacks")
    for words in (*keys, "camera: rig 'lux' has no camera", "fusion: rig 'lux' has no camera"):
        assert words in str(caught.value)


def test_nested_tables_reach_the_suite() -> None:
    tables = """
[camera]
entries = ["colour-blobs", "colour-blobs"]
every_s = 1
[fusion]
entries = ["union"]
lidar = ["pag"]
camera = ["network"]
[odometry]
lengths_m = [10, 20, 10]
[driving]
entries = ["idm"]
stacks = ["pag + gnn", "blind", "blind"]
[eligibility]
range_m = [1, 30]
min_returns = 3
families = ["cyclist"]
"""
    suite = parse_suite(TINY + tables, "x")
    assert suite.boards == {
        "detection": BoardSettings(entries=("pag",)),
        "tracking": TrackingSettings(entries=("nearest",), detectors=("pag",), ego="truth"),
        "camera": CameraSettings(entries=("colour-blobs",), every_s=1.0),
        "fusion": FusionSettings(
            entries=("union",), lidar=("pag",), camera=("network",), every_s=0.4
        ),
        "odometry": OdometrySettings(lengths_m=(10.0, 20.0)),
        "driving": DrivingSettings(entries=("idm",), stacks=("pag + gnn", "blind")),
    }
    assert suite.settings("tracking", TrackingSettings).egos == ("truth",)
    assert suite.eligibility == Eligibility((1.0, 30.0), 3, ("cyclist",))


def test_unknown_names_are_answered_with_what_is_possible(tmp_path) -> None:
    with pytest.raises(SuiteError, match="did you mean 'quick'"):
        load_suite("quik")
    with pytest.raises(SuiteError, match="cannot read suite"):
        load_suite(tmp_path / "none.toml")
    with pytest.raises(SuiteError, match=r"no scenario 'motorwy' \(did you mean 'motorway'"):
        check_names(parse_suite(TINY.replace("lu2018-three-vehicles", "motorwy"), "x"))
    with pytest.raises(ValueError, match=r"one sweep of 'lux', got 0\.01 s"):
        check_names(parse_suite(TINY.replace("= 1.0", "= 0.01"), "x"))
    with pytest.raises(ValueError, match=r"no rig 'luxx' .*; known: lux"):
        check_names(parse_suite(TINY.replace('"lux"', '"luxx"'), "x"))
    with pytest.raises(ValueError, match="rig 'lux' has no camera"):
        check_names(parse_suite(f'lights = ["day", "night"]{TINY}', "x"))


def kind_of(text: str) -> str:
    return entry_kind(Spec.parse(text)).name


def test_registered_names_have_the_kind_of_their_registry() -> None:
    assert kind_of("pag-range") == "detector"
    assert kind_of("nearest?gate_m=2.5") == "tracker"
    assert kind_of("network") == "camera detector"
    assert kind_of("union") == "fusion"
    assert kind_of("voxel-map") == kind_of("oracle?odometry=voxel-map") == "odometry"
    with pytest.raises(SpecError, match=r"'neerest'.*'nearest'"):
        kind_of("neerest")
    with pytest.raises(SpecError, match="'noisy'"):
        kind_of("noisy?miss=0.2")


CLASSES = """
class Detects:
    def reset(self): ...
    def detect(self, frame): ...

class Updates:
    def reset(self): ...
    def update(self, detections, ego_pose): ...

class Tracks(Updates):
    kind = "tracker"

class Drives(Updates):
    kind = "odometry"

class Fuses:
    def reset(self): ...
    def fuse(self, lidar, camera, calibration): ...

class Odd(Updates):
    kind = "trakcer"

class Nothing:
    def reset(self): ...
"""


def test_a_class_has_the_kind_that_it_declares_or_the_only_one_that_fits(tmp_path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(CLASSES)
    suite = parse_suite(TINY, "x")
    assert kind_of(f"{path}:Tracks") == "tracker"
    assert kind_of(f"{path}:Drives") == "odometry"
    assert kind_of(f"{path}:Fuses") == "fusion"
    with pytest.raises(SpecError, match=r"tracker.*odometry.*kind = "):
        kind_of(f"{path}:Updates")
    with pytest.raises(SpecError, match=r"'trakcer'.*'tracker'"):
        kind_of(f"{path}:Odd")
    with pytest.raises(SpecError, match=r"no method.*detect\(\)"):
        kind_of(f"{path}:Nothing")
    # The boards that are asked for decide where the class leaves it open.
    both = {
        job.board.name
        for job in plan(suite, [f"{path}:Updates", f"{path}:Detects"]).jobs
        if job.entry.startswith(str(path))
    }
    assert both == {"detection", "tracking"}
    with pytest.raises(SpecError, match=r"odometry.*tracker"):
        plan(suite, [f"{path}:Drives"], boards=["tracking"])


def test_a_spec_is_parsed_and_resolved_once() -> None:
    spec = Spec.parse("nearest?gate_m=2.5&ego=none")
    assert Spec.parse("nearest?gate_m=2.5&ego=none") is spec
    resolved = TRACKERS.resolve(spec)
    assert TRACKERS.resolve(resolved) is resolved


def test_entries_are_made_once_to_check_them(monkeypatch: pytest.MonkeyPatch) -> None:
    make, made = Spec.make, Counter[str]()

    def counted(spec: Spec) -> Any:
        made[str(spec)] += 1
        return make(spec)

    monkeypatch.setattr(Spec, "make", counted)
    for seeds in (1, 5):
        made.clear()
        suite = parse_suite(TINY.replace("seeds = 2", f"seeds = {seeds}"), "x")
        plan(suite, ["gnn?ego=none"])
        # The detector `pag` is an entry, and trackers get its detections.
        assert made == {"pag": 2, "nearest": 1, "gnn": 1}


def test_wrong_entries_are_refused_before_anything_runs() -> None:
    suite = parse_suite(TINY, "x")
    with pytest.raises(SpecError, match="gate_m"):
        plan(suite, ["nearest?gate=2"], boards=["tracking"])
    with pytest.raises(SpecError, match="'pag' is a detector"):
        plan(suite, ["pag"], boards=["tracking"])
    with pytest.raises(SpecError, match=r"plugins\.py:WithoutReset' has no reset\(\)"):
        plan(suite, [f"{PLUGINS}:WithoutReset"], boards=["detection"])
    with pytest.raises(SpecError, match="--entry"):
        plan(suite, [], boards=["detection"], only=True)
    wrong = parse_suite(TINY.replace('entries = ["pag"]', 'entries = ["gap"]'), "x")
    with pytest.raises(SuiteError, match=r"suite tiny v3: detection\.entries: no detector 'gap'"):
        plan(wrong, [], boards=["detection"])
    wrong = parse_suite(TINY.replace('entries = ["pag"]', 'entries = ["pag?x"]'), "x")
    with pytest.raises(SuiteError, match=r"suite tiny v3: detection\.entries: 'pag\?x'"):
        plan(wrong, [], boards=["detection"])
    bare = parse_suite(TINY.partition("[tracking]")[0], "x")
    with pytest.raises(SpecError, match="tracking"):
        plan(bare, [], boards=["tracking"])
    with pytest.raises(SpecError, match=r"tracking\.detectors"):
        plan(bare, ["nearest"], boards=["detection", "tracking"])
    with pytest.raises(SpecError, match=r"'drift'.*detection, tracking"):
        plan(suite, [], boards=["drift"])


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (
            "cluster?ground=polarr",
            r"^'cluster\?ground=polarr': no ground stage .*'polar'.*; known: g",
        ),
        ("distance-l-shape?criterion=foo", "no criterion 'foo'; known: area, closeness"),
        ("dbscan-l-shape?eps_m=-1", "eps_m must be a positive length in metres, got -1"),
        ("dbscan-l-shape?eps=1", "no stage has an option 'eps'.*'dbscan' takes eps_m=1.0, min"),
        ("zhang2017?fit=simple", "no fit 'simple'; known: single"),
    ],
)
def test_wrong_values_are_refused_before_anything_runs(spec, message) -> None:
    with pytest.raises(SpecError, match=message) as refused:
        plan(parse_suite(TINY, "x"), [spec], boards=["detection"])
    assert len(str(refused.value)) < 400
    wrong = parse_suite(TINY.replace('entries = ["pag"]', f'entries = ["{spec}"]'), "x")
    with pytest.raises(SuiteError, match=r"suite tiny v3: detection\.entries: "):
        plan(wrong, [], boards=["detection"])


def test_a_suite_without_entries_is_for_every_board() -> None:
    empty = parse_suite(TINY.partition("[detection]")[0], "x")
    assert [board.name for board in plan(empty, ["pag"]).boards] == ["detection"]
    assert [board.name for board in plan(empty, ["voxel-map", "pag"]).boards] == [
        "detection",
        "odometry",
    ]
    with pytest.raises(SpecError, match="nothing to run on: detection, tracking, camera"):
        plan(empty, [])


@pytest.mark.slow
def test_keys_depend_on_content(tmp_path) -> None:
    plugin = tmp_path / "mine.py"
    source = "class Mine:\n    def __init__(self, *, a=1): ...\n    def reset(self): ...\n"
    source += "    def update(self): ...\n"

    def keys(spec: str, text: str = TINY) -> list[str]:
        return [j.key for j in plan(parse_suite(text, "x"), [spec], boards=["tracking"]).jobs]

    plugin.write_text(source)
    first = keys(f"{plugin}:Mine")
    assert first == keys(f"{plugin}:Mine")
    assert len(set(first)) == 4
    other = keys(f"{plugin}:Mine?a=2")
    assert other[0] == first[0]
    assert other[1] != first[1]
    plugin.write_text(source + "# a comment costs nothing\n")
    assert keys(f"{plugin}:Mine") == first
    plugin.write_text(source + "CHANGED = True\n")
    assert keys(f"{plugin}:Mine")[1] != first[1]
    far = "[eligibility]\nrange_m = [0, 90]\n[detection]"
    assert not set(keys(f"{plugin}:Mine", TINY.replace("[detection]", far))) & set(first)


def test_problems_of_a_suite_survive_the_transfer_from_another_process() -> None:
    with pytest.raises(SuiteError) as raised:
        parse_suite(TINY.replace("name =", "nmae ="), "x")
    for error in (raised.value, raised.value.__cause__):
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), str(again)) == (type(error), str(error))
    assert len(raised.value.problems) == 2
