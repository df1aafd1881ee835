"""The program of Rerun is started so that it reaches no other machine."""

import json
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from roadscope.benchmarks.viewing import ViewerError, arguments, environment, show

pytest.importorskip("rerun_cli", reason="rerun-sdk is not installed")

ASK = [sys.executable, "-m", "rerun_cli", "analytics", "config"]
LISTENS_WITHIN_S = 30.0
NO_RENDERER = "Failed to get render context"
"""What the viewer prints where it can draw nothing, not even without a screen."""


@pytest.fixture
def willing_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A user whose own settings turn usage statistics on."""
    settings = tmp_path / "rerun" / "analytics.json"
    settings.parent.mkdir()
    content = {"analytics_enabled": True, "analytics_id": "1", "metadata": {}}
    paths = {"config_file_path": str(settings), "data_dir_path": str(tmp_path / "data")}
    settings.write_text(json.dumps(content | paths))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")


@pytest.mark.usefixtures("willing_user")
def test_usage_statistics_are_off_whatever_the_user_chose() -> None:
    own = json.loads(subprocess.run(ASK, capture_output=True, check=True).stdout)
    assert own["analytics_enabled"]
    with environment() as variables:
        assert "FORCE_RERUN_ANALYTICS" not in variables
        done = subprocess.run(ASK, capture_output=True, check=True, env=variables)
    assert json.loads(done.stdout)["analytics_enabled"] is False


def test_a_viewer_that_does_not_say_so_is_not_started(tmp_path: Path, monkeypatch) -> None:
    broken = tmp_path / "rerun"
    broken.write_text("#!/bin/sh\necho '{\"analytics_enabled\": true}'\n")
    broken.chmod(0o755)
    monkeypatch.setenv("RERUN_CLI_PATH", str(broken))
    with pytest.raises(ViewerError, match="analytics disable"), environment():
        pass


def script(path: Path, rest: str) -> str:
    """Write a program that says that it sends no statistics, and else runs some lines."""
    settings = "echo '{\"analytics_enabled\": false}'"
    path.write_text(f'#!/bin/sh\nif [ "$1" = analytics ]; then {settings}; exit; fi\n{rest}\n')
    path.chmod(0o755)
    return str(path)


def test_the_status_of_the_viewer_is_returned(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("RERUN_CLI_PATH", script(tmp_path / "crash", "exit 3"))
    assert show(tmp_path / "none.rrd") == 3


def test_an_interrupt_ends_the_viewer_although_a_child_has_ended(
    tmp_path: Path, monkeypatch
) -> None:
    """The child is gone between the list of children and the signal to it."""
    started = tmp_path / "started"
    lines = f"touch {started}; exec sleep 60"
    monkeypatch.setenv("RERUN_CLI_PATH", script(tmp_path / "viewer", lines))
    gone: list[psutil.Process] = []
    wait, children = psutil.Popen.wait, psutil.Process.children

    def interrupted(process: psutil.Popen, timeout: float | None = None) -> int | None:
        if gone:
            return wait(process, timeout)
        while not started.exists():
            time.sleep(0.01)
        raise KeyboardInterrupt

    def end_first(process: psutil.Process, recursive: bool = False) -> list[psutil.Process]:
        gone.extend(children(process, recursive))
        for each in gone:
            each.kill()
        psutil.wait_procs([process, *gone], timeout=10)
        return gone

    monkeypatch.setattr(psutil.Popen, "wait", interrupted)
    monkeypatch.setattr(psutil.Process, "children", end_first)
    with pytest.raises(KeyboardInterrupt):
        show(tmp_path / "none.rrd")
    assert gone


def test_no_module_comes_from_the_folder_of_the_user(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "rerun_cli").mkdir()
    (tmp_path / "rerun_cli" / "__init__.py").touch()
    (tmp_path / "rerun_cli" / "__main__.py").write_text("main = lambda: 7")
    monkeypatch.chdir(tmp_path)
    with environment() as variables:
        *command, _ = arguments(tmp_path / "none.rrd")
        done = subprocess.run([*command, "--version"], env=variables, check=False)
    assert done.returncode == 0


def test_it_listens_on_the_loopback_interface_alone(tmp_path: Path) -> None:
    """Without a screen; the viewer with one takes the same arguments."""
    *command, _ = arguments(Path("none.rrd"))
    printed = tmp_path / "printed.txt"
    with environment() as variables, printed.open("w") as output:
        process = psutil.Popen(
            [*command, "--headless"], env=variables, stdout=output, stderr=subprocess.STDOUT
        )
        try:
            listening, others = _sockets(process)
        finally:
            _kill(process)
    if not listening and NO_RENDERER in printed.read_text():
        pytest.skip(f"Rerun cannot run without a screen here: {NO_RENDERER}")
    assert {address.ip for address in listening} == {"127.0.0.1"}, printed.read_text()
    assert {address.ip for address in others} <= {"127.0.0.1"}


def _kill(process: psutil.Popen) -> None:
    """End a program and those that it started, of which each may have ended already."""
    started = []
    with suppress(psutil.NoSuchProcess):
        started = process.children(recursive=True)
    for each in [*started, process]:
        with suppress(psutil.NoSuchProcess):
            each.kill()
    process.wait()


def _sockets(process: psutil.Popen) -> tuple[list, list]:
    """Return where a program listens, and which places it is connected to, for a second."""
    end_s = time.monotonic() + LISTENS_WITHIN_S
    listening, others = [], []
    while process.is_running() and process.poll() is None and time.monotonic() < end_s:
        with suppress(psutil.NoSuchProcess):
            for each in [process, *process.children(recursive=True)]:
                for socket in each.net_connections("inet"):
                    (others if socket.raddr else listening).append(socket.raddr or socket.laddr)
        if listening:
            end_s = min(end_s, time.monotonic() + 1.0)
        time.sleep(0.02)
    return listening, others
