"""What a plug-in in a sandbox can reach."""

import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

import roadscope
from roadscope.benchmarks.isolation import (
    Limits,
    PluginError,
    SandboxError,
    open_plugin,
    probe,
    probing,
    sandbox_available,
)
from roadscope.core import Tracks
from tests.benchmarks.isolation.specs import bad, detections, hostile, written

ROOT = Path(roadscope.__file__).parents[1]
needs_sandbox = pytest.mark.skipif(bool(sandbox_available()), reason=sandbox_available() or "-")


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder that a sandbox does not hide by itself, as it does with `/tmp`."""
    with TemporaryDirectory(dir="/var/tmp") as name:
        yield Path(name)


@needs_sandbox
def test_a_sandbox_hides_files_network_and_processes(folder: Path) -> None:
    place, hidden = folder / "results", folder / "cache"
    for folder in (place, hidden):
        folder.mkdir()
    secret = hidden / "truth"
    secret.write_text("x")
    spec = bad("Tries", place=str(place), secret=str(secret))
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with open_plugin(spec) as plugin:
            free = plugin.call("update", None, port).answer
        (place / "new").unlink()
        with open_plugin(spec, sandbox=True) as plugin:
            assert plugin.call("update", None, port).answer["read"] == ""
        with open_plugin(spec, sandbox=True, hidden=[hidden]) as plugin:
            caught = plugin.call("update", None, port).answer
    assert (free["write"], free["read"], free["network"]) == ("", "", "")
    assert caught["write"]
    assert caught["read"]
    assert caught["network"]
    assert caught["scratch"] == ""
    assert not caught["listing"]
    assert caught["processes"] < min(free["processes"], 8)
    assert secret.read_text() == "x"
    assert not (place / "new").exists()


@needs_sandbox
def test_root_cannot_take_a_sandbox_off(folder: Path) -> None:
    (folder / "cache").mkdir()
    (folder / "cache" / "truth").write_text("x")
    spec = bad("Mounts", place=str(folder), secret=str(folder / "cache" / "truth"))
    with open_plugin(spec, sandbox=True, hidden=[folder / "cache"]) as plugin:
        caught = plugin.call("update", None, None).answer
    assert caught["read"]
    assert caught["write"]
    assert not (folder / "new").exists()


@needs_sandbox
def test_a_sandbox_hides_our_cache(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROADSCOPE_CACHE", str(folder / "ours"))
    (folder / "ours").mkdir()
    (folder / "ours" / "timeline").write_text("x")
    spec = bad("Tries", place=str(folder / "ours"), secret=str(folder / "ours" / "timeline"))
    with open_plugin(spec, sandbox=True) as plugin:
        caught = plugin.call("update", None, None).answer
    assert caught["read"]
    assert not caught["listing"]


@needs_sandbox
def test_a_plugin_in_a_hidden_folder_fails_with_what_to_do(tmp_path: Path) -> None:
    spec = written(tmp_path, "class Tracker: ...")
    with (
        pytest.raises(PluginError, match="another folder"),
        open_plugin(spec, sandbox=True, hidden=[tmp_path]),
    ):
        pass


@needs_sandbox
def test_a_sandbox_hides_recorded_data(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """That are folders to which links in it lead too, and those of the import path in it."""
    data, linked, imported = folder / "kitti", folder / "disk", folder / "kitti" / "code"
    for place in (linked, imported):
        place.mkdir(parents=True)
        (place / "labels").write_text("x")
    (data / "training").symlink_to(linked)
    (data / "itself").symlink_to(data)
    monkeypatch.syspath_prepend(str(imported))
    for place in (linked, imported):
        spec = bad("Tries", place=str(folder), secret=str(place / "labels"))
        for options, read in (({}, ""), ({"data": [data]}, "FileNotFoundError")):
            with open_plugin(spec, sandbox=True, **options) as plugin:
                assert plugin.call("update", None, None).answer["read"] == read


@needs_sandbox
def test_recorded_data_are_hidden_while_a_class_is_loaded(folder: Path) -> None:
    (folder / "kitti").mkdir()
    (folder / "mine").mkdir()
    labels = folder / "kitti" / "labels"
    labels.write_text("x")
    code = f"open({str(labels)!r})\nclass Tracker:\n    update = reset = None"
    spec = written(folder / "mine", code)
    for data, is_open in (([], True), ([folder / "kitti"], False)):
        with probing(Limits(), sandbox=True, data=data):
            assert (not probe(spec).failure) is is_open


@needs_sandbox
def test_a_plugin_among_recorded_data_fails_with_what_to_do(tmp_path: Path) -> None:
    place = tmp_path / "training" / "mine"
    place.mkdir(parents=True)
    with (
        pytest.raises(PluginError, match="to another folder"),
        open_plugin(written(place, "class Tracker: ..."), sandbox=True, data=[tmp_path]),
    ):
        pass


@needs_sandbox
def test_what_python_needs_stays_in_a_hidden_folder() -> None:
    """Data may be beside a virtual environment, and in the folder of a clone."""
    with open_plugin(bad("Good"), sandbox=True, hidden=[ROOT, Path(sys.prefix).parent]) as plugin:
        assert isinstance(plugin.call("update", detections(), None).answer, Tracks)


@needs_sandbox
def test_a_sandbox_changes_no_answer() -> None:
    answers = []
    for sandbox in (False, True):
        with open_plugin(bad("Good"), sandbox=sandbox) as plugin:
            plugin.call("reset")
            answers.append(plugin.call("update", detections(), None).answer)
    assert isinstance(answers[0], Tracks)
    assert answers[0] == answers[1]


@needs_sandbox
@pytest.mark.parametrize(
    ("act", "message"),
    [
        ("segfault", "SIGSEGV"),
        ("kill_guard", "watches over it"),
        ("kill_both", "watches over it"),
        ("hog", "memory"),
    ],
)
def test_failures_in_a_sandbox_are_named(act: str, message: str) -> None:
    with (
        pytest.raises(PluginError, match=message),
        open_plugin(hostile(act), sandbox=True, limits=Limits(memory_gb=0.5)) as plugin,
    ):
        plugin.call("update", detections(), None)


def test_what_cannot_be_sandboxed_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    sandbox_available.cache_clear()
    try:
        with (
            pytest.raises(SandboxError, match="bubblewrap"),
            open_plugin(bad("Good"), sandbox=True),
        ):
            pass
    finally:
        sandbox_available.cache_clear()
