"""The program of Rerun is started so that it reaches no other machine."""

import json
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from roadscope.benchmarks.viewing import ViewerError, arguments, environment

pytest.importorskip("rerun_cli", reason="rerun-sdk is not installed")

ASK = [sys.executable, "-m", "rerun_cli", "analytics", "config"]
LISTENS_WITHIN_S = 30.0


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


def test_it_listens_on_the_loopback_interface_alone() -> None:
    """Without a screen; the viewer with one takes the same arguments."""
    *command, _ = arguments(Path("none.rrd"))
    with environment() as variables:
        process = psutil.Popen(
            [*command, "--headless"],
            env=variables,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            listening, others = _sockets(process)
        finally:
            for each in [*process.children(recursive=True), process]:
                each.kill()
            process.wait()
    if not listening:
        pytest.skip("Rerun has no headless mode here")
    assert {address.ip for address in listening} == {"127.0.0.1"}
    assert {address.ip for address in others} <= {"127.0.0.1"}


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
