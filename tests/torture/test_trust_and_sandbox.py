"""Plug-ins that are trusted run in the run's own processes; those in a sandbox reach nothing."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from toy_kitti import write_kitti

import roadscope
from roadscope.benchmarks.isolation import sandbox_available
from tests.torture.acts import ALL
from tests.torture.boards import LIMITS, ONE_EPISODE, TortureRun, Workshop, left_running, workshop

Made = Callable[..., Workshop]
RAISED = {
    "base_exception": "BaseException",
    "generator_exit": "GeneratorExit",
    "system_exit": "SystemExit",
    "unspeakable": "UnspeakableError",
    "wrong_type": "returned list",
}
HARMLESS = ("seek_all", "seek_all", "seek_all", "rewrite_valid")
FAILING = ("segfault", "kill_guard", "kill_worker", "forge_results")
needs_sandbox = pytest.mark.skipif(bool(sandbox_available()), reason=sandbox_available() or "-")


@pytest.mark.parametrize("jobs", [1, 2])
def test_trusted_plugins_run_in_the_processes_of_the_run(
    new_workshop: Made, honest_run: tuple[Workshop, TortureRun], jobs: int
) -> None:
    """There they find what others cannot, so the search of those is one that can find."""
    place = new_workshop(suite=ONE_EPISODE)
    process = f"in process {os.getpid()} " if jobs == 1 else f"below {os.getpid()} "
    expected_reasons = {
        "say_process": process,
        "seek_truth": "FoundError",
        "seek_paths": "FoundError",
    } | RAISED
    entries = {
        place.spec(board, act): text for board in ALL for act, text in expected_reasons.items()
    }
    run = place.run(list(entries), jobs=jobs, trust=True)
    for entry, text in entries.items():
        (reason,) = run.reasons(entry)
        assert reason is not None
        assert reason.startswith(entry)
        assert text in reason
    assert run.values() == {k: honest_run[1].values()[k] for k in run.values()}


TWO_FACED = """
import sys

import numpy as np

from roadscope import Tracks

class TwoFaced:
    kind = "tracker"

    def reset(self):
        pass

    def update(self, detections, ego_pose):
        if "roadscope.benchmarks.run" not in sys.modules:
            raise RuntimeError("it is watched")
        return Tracks.of(detections, np.arange(len(detections)))
"""


def test_what_trusted_plugins_answered_is_not_used_again(new_workshop: Made) -> None:
    """They may have cheated: neither their answers nor their scores count in a later run."""
    place = new_workshop(suite=ONE_EPISODE)
    file = place.folder / "two_faced.py"
    file.write_text(TWO_FACED)
    entry = f"{file}:TwoFaced"
    options = {"boards": ["tracking"], "out_dir": place.out}
    isolated = place.run([entry], **options)
    trusted = place.run([entry], trust=True, **options)
    again = place.run([entry], **options)
    assert trusted.reasons(entry) == [None]
    for run in (isolated, again):
        (reason,) = run.reasons(entry)
        assert reason is not None
        assert "it is watched" in reason
    assert trusted.results.manifest["trust"] is True
    assert "trust" not in again.results.manifest


@needs_sandbox
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_sandbox_holds(
    new_workshop: Made, honest_run: tuple[Workshop, TortureRun], jobs: int
) -> None:
    """The one process of a sandbox that could be taken for the worker cannot be ended.

    A supervisor for each plug-in takes a second: half of the boards have those that fail.
    """
    place = new_workshop(suite=ONE_EPISODE)
    folders = {"cache": place.cache, "results": place.out}
    harmless, failing = (
        [place.spec(board, act, **folders) for board, act in zip(cycle(boards), acts, strict=False)]
        for boards, acts in ((ALL[jobs - 1 :: 2], HARMLESS), (ALL[2 - jobs :: 2], FAILING))
    )
    marker = place.folder / "written"
    code = f"\nwith suppress(OSError):\n    Path({str(marker)!r}).write_text('x')\n"
    with place.plugins.open("a") as file:
        file.write(code)
    limits = replace(LIMITS, first_call_s=20, call_s=20)
    entries = [*harmless, *failing]
    run = place.run(entries, jobs=jobs, limits=limits, sandbox=True, out_dir=place.out)
    assert not marker.exists()
    for entry in harmless:
        assert run.reasons(entry) == [None]
    for entry in failing:
        assert all(reason and reason.startswith(entry) for reason in run.reasons(entry))
    assert run.values() == {k: honest_run[1].values()[k] for k in run.values()}
    assert run.warned == []
    assert left_running(place.plugins) == []


@needs_sandbox
@pytest.mark.parametrize("sandbox", [False, True])
def test_a_sandbox_hides_the_labels_of_recorded_data(tmp_path: Path, sandbox: bool) -> None:
    """Their folder is one that a sandbox does not hide by itself, as it does with `/tmp`."""
    place = workshop(tmp_path / "run")
    with TemporaryDirectory(dir="/var/tmp") as folder:
        labels = write_kitti(Path(folder, "kitti"), ("0000",)) / "label_02" / "0000.txt"
        entry = place.spec("tracking", "read_labels", results=labels)
        with place.in_use():
            results = roadscope.leaderboard(
                entries=[entry],
                boards=["tracking"],
                only=True,
                kitti=Path(folder, "kitti"),
                jobs=1,
                out_dir=place.out,
                sandbox=sandbox,
            )
        reasons = [job.reason for job in results.jobs]
        if sandbox:
            words = ["--only", "--entry", entry, "--sandbox", "--json", "--fresh"]
            done = place.command("tracking", "--jobs", "2", *words, kitti=Path(folder, "kitti"))
            reasons += [each["reason"] for each in json.loads(done.stdout)["failures"]]
            assert len(reasons) == 2 * len(results.jobs)
    assert reasons
    for reason in reasons:
        assert ("FileNotFoundError" if sandbox else "DontCare") in str(reason)
