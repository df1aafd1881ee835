from pathlib import Path

import pytest

from roadscope.benchmarks.jobs.entries import kind_of
from roadscope.benchmarks.jobs.plan import boards_of, plan
from roadscope.benchmarks.oracle import MARKS
from roadscope.benchmarks.suite import (
    SPLITS,
    SUITES,
    SuiteError,
    check_names,
    load_suite,
    parse_suite,
)
from roadscope.core import SpecError

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


@pytest.mark.parametrize("name", SUITES)
def test_shipped_suites_name_what_exists(name) -> None:
    suite = load_suite(name)
    check_names(suite)
    assert suite.name == name
    assert set(suite.seeds) <= set(SPLITS["test"])
    jobs = plan(suite, [], boards_of(suite))
    seen = len(suite.weathers) + len(suite.lights) + len(suite.faults) - 2
    episodes = len(suite.scenarios) * len(suite.seeds) * seen
    ranked = len(suite.detectors)
    assert len(jobs.detection) == episodes * (len(MARKS) + ranked if ranked else 0)
    followed = len(suite.trackers) * len(suite.public_detectors) * len(suite.egos)
    assert len(jobs.tracking) == episodes * followed
    looking = len(suite.camera_detectors)
    assert len(jobs.camera) == episodes * (looking + 1 if looking else 0)
    pairs, joining = len(suite.fused_lidar) * len(suite.fused_camera), len(suite.fusions)
    assert len(jobs.fusion) == episodes * pairs * (joining + 2 if joining else 0)


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
    ("old", "new", "message"),
    [
        ("seeds = 2", "seeds = 0", "seeds: expected how many"),
        ("seeds = 2", "seeds = 10001", "split 'validation' has 10000 seeds, got 10001"),
        ("seeds = 2", "seeds = [3]", "10000 to 19999"),
        ("seeds = 2", "seed = 2", "no key 'seed' (did you mean 'seeds'?)"),
        ('"validation"', '"tset"', "no split 'tset' (did you mean 'test'?)"),
        ("version = 3", "", "key 'version' is missing"),
        ("version = 3", 'version = "3"', "version: expected an integer, got '3'"),
        ("duration_s = 1.0", "duration_s = -1.0", "duration_s: expected seconds above 0"),
        ("duration_s = 1.0", "duration_s = nan", "duration_s: expected seconds above 0"),
        ("[detection]", "[eligibility]\nrange_m = [9]\n[detection]", "expected [near, far]"),
        ("[detection]", "[eligibility]\nrange_m = [9, 3]\n[detection]", "0 <= near < far"),
        ("[detection]", '[eligibility]\nfamilies = ["cat"]\n[detection]', "vehicle, cyclist"),
        ("[tracking]", "[tracking]\nentrys = 1", "no key 'tracking.entrys'"),
        ("name =", "name ==", "not TOML"),
    ],
)
def test_errors_say_what_is_wrong(old, new, message) -> None:
    assert old in TINY
    with pytest.raises(SuiteError) as caught:
        parse_suite(TINY.replace(old, new), "mine.toml")
    assert message in str(caught.value)
    assert str(caught.value).startswith("mine.toml: ")


def test_unknown_names_list_what_exists(tmp_path) -> None:
    with pytest.raises(SuiteError, match="known: quick, standard"):
        load_suite("quik")
    with pytest.raises(SuiteError, match="cannot read suite"):
        load_suite(tmp_path / "none.toml")
    with pytest.raises(SuiteError, match=r"no scenario 'motorwy' \(did you mean 'motorway'"):
        check_names(parse_suite(TINY.replace("lu2018-three-vehicles", "motorwy"), "x"))
    with pytest.raises(ValueError, match=r"one sweep of 'lux', got 0\.01 s"):
        check_names(parse_suite(TINY.replace("= 1.0", "= 0.01"), "x"))
    with pytest.raises(ValueError, match=r"no rig 'luxx' .*; known: lux"):
        check_names(parse_suite(TINY.replace('"lux"', '"luxx"'), "x"))


def test_entries_find_their_board() -> None:
    assert kind_of("pag-range") == "detector"
    assert kind_of("nearest?gate_m=2.5") == "tracker"
    assert kind_of("roadscope.trackers.nearest:NearestTracker") == "tracker"
    with pytest.raises(SpecError, match=r"no detector or tracker 'neerest'.*'nearest'"):
        kind_of("neerest")
    with pytest.raises(SpecError, match="neither detect"):
        kind_of("pathlib:Path")


def test_wrong_entries_are_refused_before_anything_runs() -> None:
    suite = parse_suite(TINY, "x")
    with pytest.raises(SpecError, match="gate_m"):
        plan(suite, ["nearest?gate=2"], ("tracking",))
    with pytest.raises(SpecError, match="'pag' is a detector"):
        plan(suite, ["pag"], ("tracking",))
    with pytest.raises(SpecError, match=r"plugins\.py:WithoutReset' has no reset\(\)"):
        plan(suite, [f"{PLUGINS}:WithoutReset"], ("detection",))
    with pytest.raises(SpecError, match="--only needs at least one --entry"):
        plan(suite, [], ("detection",), only=True)
    wrong = parse_suite(TINY.replace('entries = ["pag"]', 'entries = ["gap"]'), "x")
    with pytest.raises(SuiteError, match=r"suite tiny v3, detection\.entries: no detector 'gap'"):
        plan(wrong, [], ("detection",))
    bare = parse_suite(TINY.partition("[tracking]")[0], "x")
    with pytest.raises(SpecError, match="nothing to run on: tracking"):
        plan(bare, [], ("tracking",))
    with pytest.raises(SpecError, match=r"no tracking\.detectors"):
        plan(bare, ["nearest"], ("detection", "tracking"))
    with pytest.raises(SpecError, match="no board 'drift'; known: detection, tracking"):
        plan(suite, [], ("drift",))


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
        plan(parse_suite(TINY, "x"), [spec], ("detection",))
    assert len(str(refused.value)) < 400
    wrong = parse_suite(TINY.replace('entries = ["pag"]', f'entries = ["{spec}"]'), "x")
    with pytest.raises(SuiteError, match=r"suite tiny v3, detection\.entries: "):
        plan(wrong, [], ("detection",))


def test_keys_follow_content(tmp_path) -> None:
    plugin = tmp_path / "mine.py"
    source = "class Mine:\n    def __init__(self, *, a=1): ...\n    def reset(self): ...\n"
    source += "    def update(self): ...\n"

    def keys(spec: str, text: str = TINY) -> list[str]:
        return [j.key for j in plan(parse_suite(text, "x"), [spec], ("tracking",)).tracking]

    plugin.write_text(source)
    first = keys(f"{plugin}:Mine")
    assert first == keys(f"{plugin}:Mine")
    assert len(set(first)) == 4
    other = keys(f"{plugin}:Mine?a=2")
    assert other[0] == first[0]
    assert other[1] != first[1]
    plugin.write_text(source + "# changed\n")
    assert keys(f"{plugin}:Mine")[1] != first[1]
    far = "[eligibility]\nrange_m = [0, 90]\n[detection]"
    assert not set(keys(f"{plugin}:Mine", TINY.replace("[detection]", far))) & set(first)
