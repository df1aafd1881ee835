"""A plug-in's string, parsed once."""

import pickle
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope import Spec
from roadscope.core import SpecError

NAMES = st.sampled_from(["gnn", "my/own.py:Mine", "package.module:Mine"])
VALUES = st.one_of(
    st.integers(-1000, 1000), st.floats(-10, 10), st.booleans(), st.sampled_from(["iou", "a b"])
)
ARGUMENTS = st.dictionaries(st.sampled_from(["gate_m", "b", "_c"]), VALUES)
EGOS = st.sampled_from(
    ["none", "voxel-map", "voxel-map?voxel_m=1.0&b=2", "oracle?odometry=a?b=1", "my.py:Own?k=3"]
)


def text_of(name: str, arguments) -> str:
    query = "&".join(f"{key}={value}" for key, value in arguments.items())
    return f"{name}?{query}" if query else name


@given(NAMES, ARGUMENTS)
def test_name_and_arguments_are_read_and_the_text_stays(name, arguments) -> None:
    text = text_of(name, arguments)
    spec = Spec.parse(text)
    assert str(spec) == spec.text == text
    assert (spec.name, spec.arguments, spec.parts) == (name, arguments, {})
    assert spec.is_class == (":" in name)


def test_arguments_are_python_literals_or_text() -> None:
    spec = Spec.parse("a?i=1&f=2.5&t=true&n=none&s=iou&l=[1,2]&u=x=y")
    assert spec.name == "a"
    assert spec.arguments == {
        "i": 1,
        "f": 2.5,
        "t": True,
        "n": None,
        "s": "iou",
        "l": [1, 2],
        "u": "x=y",
    }


@pytest.mark.parametrize(
    "text", ["", "?x=1", "a?gate", "a?1=2", "a?=2", "a?b c=2", "a?x=1&y", "a?x=1&x=2"]
)
def test_what_is_no_spec_is_refused_by_its_text(text) -> None:
    with pytest.raises(SpecError, match=r"names nothing|arguments look like|twice") as caught:
        Spec.parse(text)
    assert f"'{text}'" in str(caught.value)


@given(NAMES, ARGUMENTS, EGOS)
def test_a_tracker_and_its_pose_source(name, arguments, ego) -> None:
    plain = Spec.parse(text_of(name, arguments))
    assert plain.ego is None
    assert plain.plain == plain
    spec = plain.with_ego(ego)
    assert Spec.parse(str(spec)) == spec
    assert str(spec.ego) == ego
    assert spec.plain == plain
    assert (spec.name, spec.arguments) == (name, arguments)
    assert spec.with_ego("none").plain == plain
    assert str(spec.with_ego("none").ego) == "none"


def test_everything_behind_ego_belongs_to_the_odometry() -> None:
    spec = Spec.parse("gnn?gate_m=2.5&ego=voxel-map?voxel_m=1.0&b=2")
    assert spec.arguments == {"gate_m": 2.5}
    assert spec.ego is not None
    assert spec.ego.arguments == {"voxel_m": 1.0, "b": 2}
    oracle = Spec.parse("oracle?odometry=voxel-map?voxel_m=1.0&b=2").parts["odometry"]
    assert (oracle.name, oracle.arguments) == ("voxel-map", {"voxel_m": 1.0, "b": 2})


def test_a_fused_detector_has_its_detectors_and_fusion_as_parts() -> None:
    spec = Spec.parse(
        "fused?lidar=cluster-boxes&camera=my.py:Camera&fusion=union&calibration=c.json"
    )
    assert {key: str(part) for key, part in spec.parts.items()} == {
        "lidar": "cluster-boxes",
        "camera": "my.py:Camera",
        "fusion": "union",
    }
    assert spec.arguments == {"calibration": "c.json"}


def test_a_wrong_part_is_refused_where_the_whole_is_parsed() -> None:
    for text in ("gnn?ego=", "gnn?ego=a?b", "oracle?odometry=", "fused?lidar="):
        with pytest.raises(SpecError):
            Spec.parse(text)


def test_specs_are_equal_by_text_and_kind_and_can_be_keys() -> None:
    from roadscope import DETECTORS, TRACKERS

    text = "mine.py:Mine?a=[1,2]"
    assert Spec.parse(text) == Spec.parse(text)
    assert len({Spec.parse(text), Spec.parse(text), Spec.parse("mine.py:Mine?a=[1,3]")}) == 2
    assert DETECTORS.resolve(text) != TRACKERS.resolve(text)
    assert Spec.parse(text) != text


def test_a_spec_is_read_by_another_process_as_it_was_sent() -> None:
    from roadscope import TRACKERS

    spec = TRACKERS.resolve("gnn?gate_share=0.9&ego=voxel-map?voxel_m=1.0")
    code = "import pickle, sys; pickle.dump(pickle.load(sys.stdin.buffer), sys.stdout.buffer)"
    answer = subprocess.run(
        [sys.executable, "-c", code], input=pickle.dumps(spec), capture_output=True, check=True
    ).stdout
    again = pickle.loads(answer)
    assert again == spec
    assert hash(again) == hash(spec)
    assert (again.target, again.kind, again.arguments) == (spec.target, spec.kind, spec.arguments)
    assert str(again.ego) == "voxel-map?voxel_m=1.0"


def test_a_spec_without_a_class_says_so() -> None:
    with pytest.raises(SpecError, match="'gnn' is not resolved"):
        _ = Spec.parse("gnn").factory


def test_nothing_is_loaded_until_a_class_is_asked_for(tmp_path) -> None:
    from roadscope import TRACKERS

    path, mark = tmp_path / "mine.py", tmp_path / "loaded"
    path.write_text(f"open({str(mark)!r}, 'w').close()\n\n\nclass Mine:\n    pass\n")
    spec = TRACKERS.resolve(f"{path}:Mine")
    assert (spec.ours, spec.isolated) == (False, True)
    assert not mark.exists()
    assert spec.factory.__name__ == "Mine"
    assert mark.exists()


def test_what_ships_with_the_package_runs_inside_unless_it_wraps_a_strangers_library() -> None:
    from roadscope import TRACKERS

    ours, wrapper = TRACKERS.resolve("nearest"), TRACKERS.resolve("norfair")
    assert (ours.ours, ours.isolated, ours.missing) == (True, False, None)
    assert (wrapper.ours, wrapper.isolated) == (True, True)


def test_a_file_is_never_ours_whatever_its_name() -> None:
    from roadscope import TRACKERS

    for place in ("roadscope.mine.py:Mine", "roadscope.trackers.py:Mine", "./roadscope.py:Mine"):
        spec = TRACKERS.resolve(place)
        assert (spec.ours, spec.isolated) == (False, True)


def test_a_spec_cannot_be_changed() -> None:
    arguments = {"gate_m": 2.5}
    spec = Spec("nearest?gate_m=2.5&ego=none", "nearest", arguments, {"ego": Spec.parse("none")})
    arguments["gate_m"] = 9.0
    for mapping in (spec.arguments, spec.parts):
        with pytest.raises(TypeError):
            mapping["gate_m"] = 9.0
    assert spec.arguments == {"gate_m": 2.5}
