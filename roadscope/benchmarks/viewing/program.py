"""Starts the viewer of Rerun: on this machine alone, and without usage statistics.

What this relies on was seen in rerun-sdk 0.41. The viewer listens on all network interfaces unless
`--bind` says otherwise. It sends usage statistics unless its file of settings says otherwise; no
option and no environment variable turns them off. So it gets settings of its own, and before it
starts it is asked whether it takes them. It looks for a newer version of itself on the internet,
which nothing turns off; so it gets a proxy that does not exist. The viewer in a browser does all
of this too and cannot be stopped: it is not offered.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil

PROGRAM = (
    sys.executable,
    "-c",
    "import sys; from rerun_cli.__main__ import main; sys.exit(main())",
)
"""Starts Rerun and ends with its status, which `python -m rerun_cli` drops."""
LOOPBACK = "127.0.0.1"
NO_PROXY = f"http://{LOOPBACK}:9"
"""Nothing answers here: 9 is the port of the service `discard`, which no system offers today."""
PROXIES = ("http_proxy", "https_proxy", "all_proxy")
ANSWER_S = 60.0
"""Longest time in which the program has to say what its settings are; it takes 0.1 s."""


class ViewerError(RuntimeError):
    """Rerun is not installed, or would do what it must not."""


def rerun_module() -> Any:
    """Return the module `rerun`; raise `ViewerError` where it is not installed."""
    try:
        return importlib.import_module("rerun")
    except ImportError as error:
        raise ViewerError("rerun-sdk is not installed: pip install 'roadscope[view]'") from error


def show(recording: Path) -> int:
    """Show a recording until the viewer is closed; return its exit status.

    `ViewerError` if Rerun is not installed or its usage statistics cannot be turned off.
    """
    rerun_module()
    with environment() as variables:
        process = psutil.Popen(arguments(recording), env=variables)
        try:
            return int(process.wait())
        finally:
            # The viewer is a child of this process, which an interrupt may not reach.
            _stop(process)


def _stop(process: psutil.Popen) -> None:
    """Terminate a process and those that it started; each may have ended by itself."""
    started: list[psutil.Process] = []
    with suppress(psutil.NoSuchProcess):
        started = process.children(recursive=True)
    for each in [*started, process]:
        with suppress(psutil.NoSuchProcess):
            each.terminate()
    process.wait()


def arguments(recording: Path) -> list[str]:
    """Return the command that shows a recording; it listens on the loopback interface alone."""
    return [*PROGRAM, "--bind", LOOPBACK, "--port", "auto", "--hide-welcome-screen", str(recording)]


@contextmanager
def environment() -> Iterator[Mapping[str, str]]:
    """Yield the variables of a process of Rerun that sends nothing to other machines.

    Its settings are in a folder that is removed at the end. Where they have no effect (not Linux),
    those of the user have to turn the statistics off, or `ViewerError` is raised.
    """
    with tempfile.TemporaryDirectory(prefix="roadscope-view-") as folder:
        path = Path(folder, "rerun", "analytics.json")
        settings = {
            "analytics_enabled": False,
            "analytics_id": "",
            "metadata": {},
            "config_file_path": str(path),
            "data_dir_path": str(path.with_suffix("")),
        }
        path.parent.mkdir()
        path.write_text(json.dumps(settings), encoding="utf-8")
        variables = {**os.environ, "XDG_CONFIG_HOME": folder, "NO_PROXY": "", "no_proxy": ""}
        # No module of the folder that the user is in takes the place of Rerun's.
        variables["PYTHONSAFEPATH"] = "1"
        for name in PROXIES:
            variables[name] = variables[name.upper()] = NO_PROXY
        # It turns the statistics on in spite of the settings.
        variables.pop("FORCE_RERUN_ANALYTICS", None)
        _check_settings(variables)
        yield variables


def _check_settings(variables: Mapping[str, str]) -> None:
    """Raise `ViewerError` unless a process of Rerun says that it sends no usage statistics."""
    command = [*PROGRAM, "analytics", "config"]
    try:
        done = subprocess.run(
            command, env=variables, capture_output=True, text=True, timeout=ANSWER_S, check=True
        )
        enabled = json.loads(done.stdout)["analytics_enabled"]
    except (OSError, subprocess.SubprocessError, ValueError, KeyError, TypeError) as error:
        raise ViewerError(
            f"Rerun does not say whether it sends usage statistics: {error}"
        ) from error
    if enabled is not False:
        raise ViewerError(
            "Rerun would send usage statistics; turn them off with 'rerun analytics disable', or "
            "write a file with --save"
        )
