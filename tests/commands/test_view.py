"""`roadscope view`."""

import sys
from pathlib import Path

import pytest

SCENE = ("view", "lu2018-occlusion", "--seconds", "0.5", "--tracker", "nearest")


def test_a_file_is_written_and_nothing_is_opened(answer, tmp_path: Path, monkeypatch) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    from recordings import read_recording

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a program was started")

    monkeypatch.setattr("psutil.Popen", refuse)
    path = tmp_path / "scene.rrd"
    status, out, _ = answer(*SCENE, "--save", path)
    assert status == 0
    assert str(path) in out
    assert {"/world/truth", "/world/tracks", "/world/detections", "/summary"} <= set(
        read_recording(path)
    )
    assert list(tmp_path.iterdir()) == [path]


def test_without_the_extra_it_is_named(answer, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    status, _, errors = answer(*SCENE, "--save", tmp_path / "scene.rrd")
    assert status == 1
    assert "roadscope[view]" in errors
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "status", "named"),
    [
        (("view", "nowhere"), 1, "folder"),
        (("view", "roundabout", "--save", "scene.png"), 1, ".rrd"),
        (("view", "roundabout", "--returns", "colour"), 2, "intensity"),
        (("view", "roundabout", "--rig", "lux", "--camera-detector", "oracle"), 1, "camera"),
        (("view", "roundabout", "--rig", "wide", "--camera-detector", "nobody"), 1, "nobody"),
        (("view", "roundabout", "--odometry", "nothing"), 1, "odometry"),
        (("view", "roundabout", "--board", "tracking"), 2, "--board"),
        (("view", "{folder}", "--rig", "lux"), 2, "--rig"),
        (("view", "{folder}"), 1, "leaderboard"),
    ],
)
def test_wrong_input_is_refused_in_one_line(
    answer, tmp_path: Path, arguments: tuple[str, ...], status: int, named: str
) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    ended, _, errors = answer(*(each.format(folder=tmp_path) for each in arguments))
    assert ended == status
    assert named in errors
    assert len(errors.splitlines()) == 1


def test_help_says_which_board_is_not_shown(answer) -> None:
    lines = answer("view", "--help")[1].splitlines()
    assert any("--board" in line and "driving" in line for line in lines)


def test_a_viewer_that_crashes_is_a_failure(answer, tmp_path: Path, monkeypatch) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    crash = tmp_path / "crash"
    crash.write_text(
        "#!/bin/sh\n[ $1 = analytics ] || exit 3\necho '{\"analytics_enabled\": false}'"
    )
    crash.chmod(0o755)
    monkeypatch.setenv("RERUN_CLI_PATH", str(crash))
    status, _, errors = answer(*SCENE)
    assert status == 1
    assert "status 3" in errors
