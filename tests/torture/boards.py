"""A tiny suite of all six boards, and runs of it with hostile entries."""

import json
import os
import shutil
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

import roadscope
from roadscope.benchmarks.isolation import Limits
from tests.torture.acts import CLASSES

RIG = """
name = "small"
lidar = "vlp16"
imu = "adis16448"
[camera]
sensor = "wide"
width_px = 320
height_px = 180
focal_px = 160
"""
SUITE = """
name = "torture"
version = 1
rig = "small.toml"
duration_s = 1.5
scenarios = ["motorway", "roundabout"]
seeds = [20123]
[detection]
entries = ["distance"]
[tracking]
entries = ["nearest"]
detectors = ["noisy-misses"]
[camera]
entries = ["noisy-camera"]
[fusion]
entries = ["union"]
lidar = ["noisy-misses"]
camera = ["noisy-camera"]
[odometry]
entries = ["still"]
[driving]
entries = ["idm"]
stacks = ["truth"]
"""
ONE_EPISODE = SUITE.replace('["motorway", "roundabout"]', '["motorway"]')
LIMITS = Limits(first_call_s=60, call_s=60, episode_s=120, memory_gb=0.3, output_mb=2)
"""No deadline that an honest plug-in on a loaded machine may miss."""
HANG_LIMITS = Limits(first_call_s=0.3, call_s=0.3, episode_s=20)
"""For runs in which all hostile entries hang: others may be slower than that."""
MOST_MESSAGE = 2000
MOST_ENDING_S = 10.0
PRIVATE_TIME = ("call_", "wall_", "driver_")
"""How the names of metrics begin that are times."""


@dataclass(frozen=True)
class Workshop:
    """Folders of one run: its own cache, results, suite and copy of the plug-ins."""

    folder: Path

    @property
    def cache(self) -> Path:
        return self.folder / "cache"

    @property
    def out(self) -> Path:
        return self.folder / "out"

    @property
    def suite(self) -> Path:
        return self.folder / "torture.toml"

    @property
    def plugins(self) -> Path:
        return self.folder / "hostile.py"

    def spec(self, board: str, act: str, **more: Any) -> str:
        """Name a hostile entry of a board; `load.ACT` is done by a copy of the file."""
        file = self.plugins
        if act.startswith("load."):
            file = self.folder / act.removeprefix("load.") / file.name
            file.parent.mkdir(exist_ok=True)
            if not file.exists():
                shutil.copy(self.plugins, file)
        arguments = {"act": act, **more}
        query = "&".join(f"{key}={value}" for key, value in arguments.items())
        return f"{file}:{CLASSES[board]}?{query}"

    @contextmanager
    def in_use(self) -> Iterator[None]:
        """Let computed files go to this cache."""
        before = os.environ["ROADSCOPE_CACHE"]
        os.environ["ROADSCOPE_CACHE"] = str(self.cache)
        try:
            yield
        finally:
            os.environ["ROADSCOPE_CACHE"] = before

    def run(self, entries: Sequence[str], **options: Any) -> "TortureRun":
        """Run the suite with hostile entries.

        No boards are written unless `out_dir` is given: with many entries that takes seconds.
        """
        options = {"limits": LIMITS} | options
        with self.in_use(), warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            results = roadscope.leaderboard(str(self.suite), entries, **options)
        return TortureRun(results, [str(each.message) for each in raised])

    def command(self, *words: str, kitti: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Run the suite, or KITTI's data in a folder, by the command line."""
        data = ["--suite", str(self.suite)] if kitti is None else ["--kitti", str(kitti)]
        return subprocess.run(
            [sys.executable, "-m", "roadscope", "leaderboard", *data, *words],
            env=os.environ
            | {"ROADSCOPE_CACHE": str(self.cache), "PYTHONPATH": os.pathsep.join(sys.path)},
            capture_output=True,
            text=True,
            check=False,
            timeout=300,
        )


@dataclass(frozen=True)
class TortureRun:
    """What a run returned, and what it warned of."""

    results: roadscope.Results
    warned: list[str]

    def values(self, hostile: bool = False, board: str = "") -> Mapping[str, Any]:
        """Return every score of the suite's own entries, but times, exactly; of a board or all."""
        named = {}
        for job in self.results.jobs:
            if ("hostile.py" in job.entry) is not hostile or board not in job.board:
                continue
            place = f"{job.board} {job.entry} {job.scenario} {job.inputs}"
            named[place] = {"reason": job.reason} | without_times(job.scores)
        return named

    def reasons(self, entry: str) -> list[str | None]:
        """Return the reason of each episode of an entry, None where it came through."""
        return [job.reason for job in self.results.jobs if job.entry == shown(job.board, entry)]


def shown(board: str, entry: str) -> str:
    """Return how an entry is named on its board: a driver with the stack of the suite."""
    return f"{entry} on truth" if board == "driving" else entry


def without_times(scores: Mapping[str, Any]) -> dict[str, str]:
    """Return scores as text with all digits, but those of time."""
    return {
        name: json.dumps(score.to_json())
        for name, score in scores.items()
        if not name.startswith(PRIVATE_TIME)
    }


def workshop(folder: Path, timelines: Path | None = None, suite: str = SUITE) -> Workshop:
    """Make the folders of a run; timelines: a cache whose traffic and parsed sources are taken."""
    made = Workshop(folder)
    for place in (made.cache, made.out):
        place.mkdir(parents=True)
    (folder / "small.toml").write_text(RIG)
    made.suite.write_text(suite)
    shutil.copy(Path(__file__).with_name("hostile.py"), made.plugins)
    if timelines is not None:
        for cache_folder in ("timelines", "sources"):
            shutil.copytree(timelines / cache_folder, made.cache / cache_folder)
    return made


def left_running(plugins: Path) -> list[str]:
    """Return what hostile plug-ins left behind; a guard has some time to end after its report.

    A worker's supervisor may go on; below it no process may be left.
    """
    deadline = time.monotonic() + MOST_ENDING_S
    while (left := _left_now(plugins)) and time.monotonic() < deadline:
        time.sleep(0.05)
    return left


def _left_now(plugins: Path) -> list[str]:
    left = [line for line in command_lines() if str(plugins) in line]
    for process in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            above = process.parent()
            if above is not None and "isolation.supervisor" in " ".join(above.cmdline()):
                left.append(f"{process.pid} below a supervisor")
    return left


def command_lines() -> Iterator[str]:
    """Yield the command lines of all processes that can be read."""
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            yield " ".join(process.cmdline())
