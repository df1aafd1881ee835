"""What bad plug-ins do costs them their own row: real processes, really killed."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

import roadscope.core
from roadscope.benchmarks.isolation import Limits, PluginError, PluginHandle, open_plugin
from roadscope.core import Pose, RecordError, Tracks
from tests.benchmarks.isolation.specs import Named, bad, detections, hostile, written

LIMITS = Limits(first_call_s=20, call_s=1, episode_s=30, memory_gb=0.5, output_mb=2)
SHORT = Limits(first_call_s=1.5, call_s=1, episode_s=30)
MOST_S = 30.0
"""What any failure may take on a loaded machine; the plug-ins sleep twice as long."""


def one_call(spec: Named, limits: Limits = LIMITS) -> Any:
    """Do what an episode does with one frame."""
    with open_plugin(spec, limits=limits) as plugin:
        plugin.call("reset")
        return plugin.call("update", detections(), Pose.identity()).answer


def updates(plugin: PluginHandle, count: int, pause_s: float = 0.0) -> None:
    """Call a tracker again and again."""
    for _ in range(count):
        plugin.call("update", detections(), None)
        time.sleep(pause_s)


def failure(spec: Named, limits: Limits = LIMITS) -> PluginError:
    """Return how a plug-in fails; the next test shows that the next one works."""
    start = time.monotonic()
    with pytest.raises(PluginError) as raised:
        one_call(spec, limits)
    assert time.monotonic() - start < MOST_S
    text = str(raised.value)
    assert text.startswith(f"{spec.text}: ")
    assert len(text) <= 2000
    assert text.isprintable()
    assert len(raised.value.log) <= 4000
    return raised.value


def test_the_end_of_the_process_is_named() -> None:
    crash = failure(hostile("segfault"))
    assert "SIGSEGV" in str(crash)
    assert "hostile.py" in crash.log
    assert "SIGSEGV" in str(failure(bad("SegfaultWhenMade")))
    assert "SIGKILL" in str(failure(hostile("kill_itself")))
    assert isinstance(one_call(bad("Good")), Tracks)


@pytest.mark.parametrize("status", [0, 255])
def test_an_exit_is_named_with_its_status(status: int) -> None:
    assert f"status {status}" in str(failure(bad("Leaves", status=status)))


@pytest.mark.parametrize(
    "name", ["BaseException", "SystemExit", "KeyboardInterrupt", "MemoryError", "BrokenPipeError"]
)
def test_exceptions_of_any_kind_are_named_with_their_line(name: str) -> None:
    text = str(failure(bad("Raises", name=name)))
    assert name in text
    assert "bad_trackers.py:" in text


def test_exceptions_whose_text_is_trouble() -> None:
    assert "UnspeakableError" in str(failure(hostile("unspeakable")))
    failure(bad("RaisesNameless"))
    assert "ValueError" in str(failure(hostile("long_text")))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "spec",
    [
        *map(hostile, ("made.hang", "reset.hang", "hang", "stop_itself")),
        *map(bad, ("IgnoresSignals", "Drips")),
    ],
    ids=str,
)
def test_hanging_has_an_end(spec: Named) -> None:
    assert "1.5 s" in str(failure(spec, SHORT))
    assert isinstance(one_call(bad("Good")), Tracks)


@pytest.mark.slow
def test_later_calls_have_a_shorter_deadline() -> None:
    limits = Limits(first_call_s=60, call_s=2)
    with open_plugin(hostile("hang_in_third_call"), limits=limits) as plugin:
        for _ in range(2):
            plugin.call("update", detections(), None)
        start = time.monotonic()
        with pytest.raises(PluginError, match=r" 2 s"):
            plugin.call("update", detections(), None)
        assert time.monotonic() - start < MOST_S
        with pytest.raises(PluginError, match=r" 2 s"):
            plugin.call("update", detections(), None)


def test_an_episode_has_a_deadline() -> None:
    limits = Limits(first_call_s=60, call_s=60, episode_s=1.5)
    start = time.monotonic()
    with (
        pytest.raises(PluginError, match=r"1\.5 s"),
        open_plugin(bad("Slow"), limits=limits) as plugin,
    ):
        updates(plugin, 100)
    assert time.monotonic() - start < MOST_S


def test_output_is_limited() -> None:
    error = failure(hostile("flood"))
    assert "output" in str(error)
    assert "2 MB" in str(error)


def test_output_is_stored_without_control_characters() -> None:
    log = failure(bad("Prints")).log
    assert "the last" in log
    assert all(line.isprintable() for line in log.splitlines())


def test_output_may_be_closed() -> None:
    with open_plugin(bad("ClosesOutput")) as plugin:
        for _ in range(2):
            with suppress(PluginError):
                answer = plugin.call("update", detections(), None).answer
    assert isinstance(answer, Tracks)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("spec", [hostile("hog"), bad("HogsInChild")], ids=str)
def test_memory_is_limited(spec: Named) -> None:
    error = failure(spec)
    assert "memory" in str(error)
    assert "0.5 GB" in str(error)
    assert isinstance(one_call(bad("Good")), Tracks)


@pytest.mark.slow
def test_answers_are_limited() -> None:
    assert "64 MB" in str(failure(hostile("million_boxes"), Limits(memory_gb=4)))
    assert "64 MB" in str(failure(hostile("forged_length")))


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (hostile("object_arrays"), "object"),
        (hostile("itself"), "cannot be sent"),
        (hostile("nan.scores"), "Tracks.scores"),
        (bad("AnswersHostile"), "SystemExit"),
    ],
    ids=str,
)
def test_answers_that_cannot_be_sent(spec: Named, message: str) -> None:
    assert message in str(failure(spec))


@pytest.mark.parametrize(
    "spec", [hostile("forged_bytes"), hostile("truncated"), bad("ClosesAll")], ids=str
)
def test_what_is_written_to_the_socket_is_checked(spec: Named) -> None:
    failure(spec)


@pytest.mark.parametrize("case", range(13))
def test_forged_messages_are_refused(case: int) -> None:
    assert "60 s" not in str(failure(bad("ForgesMessage", case=case)))


@pytest.mark.parametrize("spec", [hostile("second_answer"), bad("Forks")], ids=str)
def test_a_call_has_one_answer(spec: Named) -> None:
    with open_plugin(spec, limits=LIMITS) as plugin:
        plugin.call("reset")
        with pytest.raises(PluginError):
            updates(plugin, 5, pause_s=0.2)
    one_call(bad("Good"))


@pytest.mark.parametrize("act", ["kill_guard", "kill_both"])
def test_a_plug_in_that_ends_its_guards_fails(act: str) -> None:
    failure(hostile(act))
    assert isinstance(one_call(bad("Good")), Tracks)


def test_a_plug_in_that_stops_its_guards_is_ended() -> None:
    one_call(bad("Good"))
    before = psutil.Process().children()
    with (
        pytest.raises(PluginError, match="stop_both"),
        open_plugin(hostile("stop_both"), limits=SHORT) as plugin,
    ):
        plugin.call("update", detections(), None)
    deadline = time.monotonic() + MOST_S
    # A guard ends shortly after it reported.
    while set(psutil.Process().children(recursive=True)) - set(before):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    one_call(bad("Good"))


@pytest.mark.parametrize("act", ["kill_guard", "stop_both"])
def test_a_plug_in_that_harms_its_guard_costs_no_other(act: str) -> None:
    with open_plugin(bad("Good")) as other:
        with pytest.raises(PluginError), open_plugin(hostile(act), limits=SHORT) as plugin:
            plugin.call("update", detections(), None)
        assert isinstance(other.call("update", detections(), None).answer, Tracks)
        assert isinstance(one_call(bad("Good")), Tracks)


@pytest.mark.slow
def test_a_guard_that_does_not_report_is_ended_alone() -> None:
    with open_plugin(bad("Good")) as other:
        with open_plugin(bad("StopsGuard")) as plugin:
            number = plugin.call("update", detections(), None).answer
        assert not _running(number)
        assert isinstance(other.call("update", detections(), None).answer, Tracks)


@pytest.mark.parametrize("how", ["returns", "dies", "hangs later", "kills"])
def test_no_process_is_left(how: str, tmp_path: Path) -> None:
    spec = bad("LeavesChildren", file=str(tmp_path / "numbers"), how=how)
    with (
        suppress(PluginError),
        open_plugin(spec, limits=Limits(first_call_s=60, call_s=1)) as plugin,
    ):
        updates(plugin, 2 if how == "hangs later" else 1)
    numbers = [int(number) for number in (tmp_path / "numbers").read_text().split()]
    assert len(numbers) == 4
    assert not any(map(_running, numbers))


def test_a_plugin_that_is_left_by_an_exception_is_ended() -> None:
    opening = open_plugin(bad("SaysWhere"))
    number = opening.__enter__().call("update", detections(), None).answer
    assert _running(number)
    assert not opening.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert not _running(number)


def test_nothing_is_left_of_a_worker_that_was_killed(tmp_path: Path) -> None:
    spec = bad("LeavesChildren", file=str(tmp_path / "numbers"), how="hangs")
    code = f"""
from tests.benchmarks.isolation.test_torture import one_call, Limits, bad
one_call(bad("LeavesChildren", file={spec.arguments["file"]!r}, how="hangs"), Limits())
"""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    worker = subprocess.Popen([sys.executable, "-c", code], env=environment)
    deadline = time.monotonic() + 120
    while not (tmp_path / "numbers").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(0.2)
    below = psutil.Process(worker.pid).children(recursive=True)
    assert len(below) >= 3  # A supervisor, a guard, a plug-in.
    worker.kill()
    worker.wait()
    numbers = [int(number) for number in (tmp_path / "numbers").read_text().split()]
    numbers += [process.pid for process in below]
    deadline = time.monotonic() + MOST_S
    while any(map(_running, numbers)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(_running, numbers))


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import a_module_that_is_not_there", "a_module_that_is_not_there"),
        ("1 / 0", "plugin.py:1"),
        ("class Tracker", "SyntaxError"),
        ("import os; os._exit(0)", "status 0"),
        ("raise BaseException('no')", "BaseException"),
        ("raise SystemExit(0)", "SystemExit"),
        ("import time; time.sleep(60)", "1.5 s"),
        ("class Other: pass", "Other"),
        ("Tracker = 1", "not a class"),
    ],
)
def test_files_that_cannot_be_loaded(code: str, message: str, tmp_path: Path) -> None:
    limits = SHORT if "sleep" in code else LIMITS
    assert message in str(failure(written(tmp_path, code), limits))


def test_changes_of_our_modules_reach_no_other_plug_in(tmp_path: Path) -> None:
    before = roadscope.core.Tracks.empty
    spec = written(
        tmp_path,
        """
import numpy as np
import roadscope.core
from roadscope.core import Detections, Tracks
class Tracker:
    def reset(self): ...
    def update(self, detections, ego_pose):
        return Tracks.of(detections, np.arange(len(detections)))
Tracks.__post_init__ = lambda self: None
Detections.select = None
Tracks.empty = None
roadscope.core.Tracks = None
""",
    )
    one_call(spec)
    assert roadscope.core.Tracks.empty is before
    with pytest.raises(RecordError):
        Tracks.of(detections(), np.zeros(30, int))
    assert len(one_call(bad("Good"))) == 30


def test_answers_do_not_change_afterwards() -> None:
    with open_plugin(bad("WritesLater")) as plugin:
        answer = plugin.call("update", detections(), None).answer
        time.sleep(0.2)
        again = plugin.call("update", detections(), None).answer
    assert answer == again
    assert abs(answer.centres).max() < 100


def test_a_supervisor_that_was_killed_is_replaced() -> None:
    one_call(bad("Good"))
    for process in psutil.Process().children():
        if any("isolation.supervisor" in word for word in process.cmdline()):
            os.kill(process.pid, signal.SIGKILL)
    with suppress(PluginError):
        one_call(bad("Good"))
    assert isinstance(one_call(bad("Good")), Tracks)


def _running(number: int) -> bool:
    try:
        return psutil.Process(number).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
