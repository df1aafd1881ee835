"""A plug-in in a process of its own answers as it does in this one."""

import os
import pickle
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from roadscope.benchmarks import source_hash
from roadscope.benchmarks.isolation import Limits, PluginError, open_plugin, probe
from roadscope.core import Calibration, Frame, Pose, SpecError, Tracks
from tests.benchmarks.isolation.specs import Named, bad, detections, written
from tests.core.wire_values import make_value


@pytest.mark.parametrize("isolated", [True, False])
def test_answers_are_the_same_wherever_it_runs(isolated: bool) -> None:
    boxes = detections()
    with open_plugin(bad("Good", first=5), isolated=isolated) as plugin:
        assert {"update", "reset"} <= set(plugin.traits.methods)
        assert "detect" not in plugin.traits.methods
        assert plugin.traits.weighed
        assert plugin.call("reset").answer is None
        answers = [plugin.call("update", boxes, pose).answer for pose in (None, Pose.identity())]
    assert answers == [Tracks.of(boxes, np.arange(30) + 5)] * 2


@pytest.mark.parametrize("isolated", [True, False])
@pytest.mark.parametrize("name", ["BaseException", "SystemExit", "ValueError"])
def test_exceptions_are_the_same_wherever_it_runs(isolated: bool, name: str) -> None:
    spec = bad("Raises", name=name)
    with open_plugin(spec, isolated=isolated) as plugin, pytest.raises(PluginError) as raised:
        plugin.call("update", detections(), None)
    text = str(raised.value)
    assert text.startswith(f"{spec.text}: {name}: what is ")
    assert "bad_trackers.py:" in text
    assert text.isprintable()


def test_an_interrupt_in_this_process_is_the_users() -> None:
    with (
        open_plugin(bad("Raises", name="KeyboardInterrupt"), isolated=False) as plugin,
        pytest.raises(KeyboardInterrupt),
    ):
        plugin.call("update", detections(), None)


def test_where_it_runs_follows_from_the_spec() -> None:
    here = Named("ours", bad("SaysWhere").target, isolated=False)
    with open_plugin(here) as plugin:
        assert plugin.call("update", None, None).answer == os.getpid()
    with open_plugin(bad("SaysWhere")) as plugin:
        assert plugin.call("update", None, None).answer != os.getpid()


def test_a_plugin_that_raised_may_be_asked_again() -> None:
    with open_plugin(bad("Raises", name="ValueError")) as plugin:
        for _ in range(2):
            with pytest.raises(PluginError, match="ValueError"):
                plugin.call("update", detections(), None)
        plugin.call("reset")


def test_plugins_are_open_side_by_side() -> None:
    with open_plugin(bad("Good")) as one, open_plugin(bad("Good", first=7)) as two:
        for _ in range(3):
            first, second = (plugin.call("update", detections(), None) for plugin in (one, two))
            assert first.answer.ids[0] == 0
            assert second.answer.ids[0] == 7
        with pytest.raises(PluginError), open_plugin(bad("Leaves")) as three:
            three.call("update", detections(), None)
        assert len(one.call("update", detections(), None).answer) == 30


def test_plugins_are_opened_by_several_threads() -> None:
    def episode(number: int) -> int | str:
        spec = bad("Leaves", status=number) if number % 3 == 0 else bad("Good", first=number)
        try:
            with open_plugin(spec) as plugin:
                return int(plugin.call("update", detections(), None).answer.ids[0])
        except PluginError as error:
            return str(error)

    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(episode, range(12)))
    for number, answer in enumerate(answers):
        assert f"status {number}" in str(answer) if number % 3 == 0 else answer == number


def test_an_error_has_the_output_of_its_own_plugin_alone(tmp_path: Path) -> None:
    talkative = written(
        tmp_path,
        """
class Talkative:
    def update(self, detections, ego_pose):
        print("nothing is wrong here")
""",
        "Talkative",
    )

    def refuse_an_answer() -> None:
        with open_plugin(bad("Good")) as silent, open_plugin(talkative) as other:
            silent.call("update", detections(), None)
            other.call("update", None, None)
            raise PluginError(bad("Good").text, "its answer is wrong")

    with pytest.raises(PluginError) as refused:
        refuse_an_answer()
    assert refused.value.log == ""


def test_errors_are_pickled() -> None:
    with open_plugin(bad("Prints")) as plugin, pytest.raises(PluginError) as raised:
        plugin.call("update", detections(), None)
    again = pickle.loads(pickle.dumps(raised.value))
    assert isinstance(again, PluginError)
    assert str(again) == str(raised.value)
    assert vars(again) == vars(raised.value)
    assert again.log


def test_a_frame_arrives_whole() -> None:
    frame = make_value("frame", np.random.default_rng(0), 60_000)
    with open_plugin(bad("Echoes")) as plugin:
        assert plugin.call("update", frame, None).answer == frame
        assert plugin.call("update", Frame(0.0, Calibration()), None).answer.lidar is None


def test_times_are_those_of_the_call_alone() -> None:
    with open_plugin(bad("Slow")) as plugin:
        slow = plugin.call("update", detections(), None)
    assert slow.wall_ms >= 100
    assert slow.processor_ms < 50
    with open_plugin(bad("Busy")) as plugin:
        busy = plugin.call("update", detections(), None)
    assert 50 <= busy.processor_ms < 150
    assert busy.wall_ms >= 50


def test_its_process_has_nothing_of_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROADSCOPE_CACHE", "/somewhere")
    monkeypatch.setenv("SECRET_KEY", "1234")
    with open_plugin(bad("Looks")) as plugin:
        answer = plugin.call("update", detections(), None).answer
    assert not any("ROADSCOPE" in name or "SECRET" in name for name in answer["environment"])
    assert "/somewhere" not in repr(answer)
    ours = "roadscope.benchmarks"
    loaded = {name for name in answer["modules"] if name.startswith(f"{ours}.")}
    assert {name for name in loaded if not name.startswith(f"{ours}.isolation")} == set()
    assert list(answer["files"]) == [0, 1, 2, 3, 4]
    assert answer["session"]
    assert answer["interrupts"]
    assert answer["terminates"]
    assert answer["blocked"] == 0
    assert answer["core"] == 0
    assert answer["input"] == ""
    assert answer["folder"] == str(Path.cwd())


def test_random_numbers_differ_between_processes() -> None:
    random_numbers = []
    for _ in range(2):
        with open_plugin(bad("Looks")) as plugin:
            random_numbers.append(plugin.call("update", None, None).answer["random"])
    assert random_numbers[0] != random_numbers[1]


def test_a_file_imports_the_file_beside_it(tmp_path: Path) -> None:
    (tmp_path / "beside.py").write_text("from roadscope.core import Tracks")
    spec = written(
        tmp_path,
        """
from beside import Tracks
class Tracker:
    def update(self, detections, ego_pose):
        import later_beside
        return later_beside.answer
""",
    )
    (tmp_path / "later_beside.py").write_text("answer = 3")
    with open_plugin(spec) as plugin:
        assert plugin.call("update", detections(), None).answer == 3


def test_files_beside_it_come_first_if_their_folder_was_last_on_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As is the working directory once a class of ours was loaded."""
    own, other = tmp_path / "own", tmp_path / "other"
    for folder in (own, other):
        folder.mkdir()
        (folder / "beside.py").write_text(f"answer = {folder.name!r}")
    spec = written(
        own,
        """
from beside import answer
class Tracker:
    def update(self, detections, ego_pose):
        return answer
""",
    )
    monkeypatch.setattr(sys, "path", [str(other), *sys.path, str(own)])
    with open_plugin(spec) as plugin:
        assert plugin.call("update", detections(), None).answer == "own"


def test_what_a_class_says_of_itself(tmp_path: Path) -> None:
    spec = written(
        tmp_path,
        """
from roadscope.core import Requirement
class Tracker:
    kind, offline, weighed, takes_imu = "tracker", True, True, False
    requires = Requirement("no-such-thing", "pip install no-such-thing")
    def __init__(self, *, gate_m=2.5, name="a", needed): ...
    def update(self, detections, ego_pose): ...
    def rescored(self, history): ...
""",
    )
    traits = probe(spec)
    assert traits.file == tmp_path / "plugin.py"
    assert traits.methods == {"update", "rescored"}
    assert (traits.kind, traits.offline, traits.weighed) == ("tracker", True, True)
    assert not traits.takes_imu
    assert "no-such-thing" in traits.requires
    assert dict(traits.parameters) == {"gate_m": "2.5", "name": "a", "needed": ""}
    assert "needed" in traits.problem
    with pytest.raises(PluginError, match="needed"), open_plugin(spec):
        pass


@pytest.mark.parametrize("kind", ['kind = "tracker"', 'kind: str = "tracker"'])
def test_the_kind_of_a_class_that_cannot_be_loaded_is_read(tmp_path: Path, kind: str) -> None:
    code = f"class Tracker:\n    {kind}\n    def update(self): ...\nraise RuntimeError"
    traits = probe(written(tmp_path, code))
    assert (traits.kind, traits.methods) == ("tracker", {"update"})
    assert "RuntimeError" in traits.failure


def test_a_source_that_python_cannot_parse_is_a_failure_of_its_class(tmp_path: Path) -> None:
    spec = written(tmp_path, f"class Tracker:\n    kind = 'tracker'\nx = {'-' * 200_000}1")
    traits = probe(spec)
    assert traits.kind == ""
    assert "Error" in traits.failure
    assert len(source_hash(spec.target)) == 16


def test_the_description_of_a_class_changes_with_its_file(tmp_path: Path) -> None:
    spec = written(tmp_path, "class Tracker:\n    def update(self): ...")
    assert probe(spec).methods == {"update"}
    assert probe(spec) is probe(spec)
    written(tmp_path, "class Tracker:\n    def fuse(self): ...")
    os.utime(tmp_path / "plugin.py", ns=(1, 1))
    assert probe(spec).methods == {"fuse"}


def test_probing_does_not_load_a_strangers_code_here(tmp_path: Path) -> None:
    code = f"""
import os
with open({str(tmp_path / "log")!r}, "a") as file:
    file.write(str(os.getpid()))
class Tracker: ...
"""
    probe(written(tmp_path, code))
    assert (tmp_path / "log").read_text() != str(os.getpid())


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("no_such_module:Class", "no_such_module"),
        ("no_such_file.py:Class", "no_such_file.py"),
        ("os:", "after the colon"),
        ("Class", "before the colon"),
        ("collections:Missing", "OrderedDict"),
        ("os:getpid", "not a class"),
        (f"{bad('Good').target}d", "Good"),
    ],
)
def test_what_cannot_be_loaded_is_a_wrong_spec(target: str, message: str) -> None:
    with pytest.raises(SpecError) as raised:
        probe(Named("my spec", target))
    assert message in str(raised.value)
    assert str(raised.value).startswith("my spec: ")


def test_literals_arrive_as_they_are() -> None:
    arguments = {"a": (1, [2.5]), "b": None, "c": {"x": True}, "d": "text'\"", "e": {1}, "f": b"1"}
    spec = Named("echo", bad("EchoesArguments").target, arguments)
    with open_plugin(spec) as plugin:
        assert plugin.call("update", None, None).answer == repr(arguments)


def test_opening_and_calling_cost_little() -> None:
    boxes, opening, calling = detections(30), [], []
    for _ in range(15):
        start = time.perf_counter()
        with open_plugin(bad("Good")) as plugin:
            plugin.call("reset")
            opening.append(time.perf_counter() - start)
            for _ in range(60):
                start = time.perf_counter()
                plugin.call("update", boxes, None)
                calling.append(time.perf_counter() - start)
    # The slow ones are those of other programs on this machine.
    assert min(opening) < 0.1
    assert sorted(calling)[len(calling) // 10] < 0.003


def test_slow_libraries_are_imported_once(tmp_path: Path) -> None:
    code = """
import time
start = time.process_time()
import filterpy.kalman
import numba
import roadscope.trackers
TOOK_S = time.process_time() - start
class Tracker:
    def update(self, detections, ego_pose):
        return TOOK_S
"""
    took_s = []
    for _ in range(3):
        with open_plugin(written(tmp_path, code)) as plugin:
            took_s.append(plugin.call("update", None, None).answer)
    assert took_s[2] < 0.2
    with open_plugin(bad("Good")) as plugin:
        assert len(plugin.call("update", detections(), None).answer) == 30


def test_what_was_printed_is_at_hand_afterwards() -> None:
    with open_plugin(bad("Good"), limits=Limits()) as plugin:
        assert plugin.call("reset").answer is None
    assert plugin.log == "a new episode"
