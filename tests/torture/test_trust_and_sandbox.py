"""Plug-ins that are trusted run in this process; those in a sandbox reach nothing."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from toy_kitti import write_kitti

import roadscope
from roadscope.benchmarks.isolation import sandbox_available
from tests.torture.acts import ALL
from tests.torture.boards import LIMITS, ONE_EPISODE, Run, Workshop, left_running, workshop

Made = Callable[..., Workshop]
needs_sandbox = pytest.mark.skipif(bool(sandbox_available()), reason=sandbox_available() or "-")


@pytest.mark.parametrize("trust", [True, False])
def test_a_trusted_plugin_runs_in_this_process(new_workshop: Made, trust: bool) -> None:
    place = new_workshop()
    entry = place.spec("tracking", "say_process")
    run = place.run([entry], boards=["tracking"], trust=trust)
    for reason in run.reasons(entry):
        assert reason is not None
        assert reason.startswith(entry)
        assert (f"in process {os.getpid()} " in reason) is trust


def test_what_a_trusted_plugin_raises_is_its_own_row(
    new_workshop: Made, honest_run: tuple[Workshop, Run]
) -> None:
    place = new_workshop()
    acts = ("base_exception", "generator_exit", "system_exit", "unspeakable", "wrong_type")
    entries = [place.spec("tracking", act) for act in acts]
    run = place.run(entries, boards=["tracking"], trust=True)
    for entry in entries:
        assert all(reason and reason.startswith(entry) for reason in run.reasons(entry))
    honest = honest_run[1].values()
    assert run.values() == {k: v for k, v in honest.items() if k.startswith("tracking")}


@pytest.mark.parametrize("act", ["seek_truth", "seek_paths"])
def test_a_trusted_plugin_finds_what_others_cannot(new_workshop: Made, act: str) -> None:
    """So the search of those that find nothing in a process of their own is one that can find."""
    place = new_workshop(suite=ONE_EPISODE)
    entries = [place.spec(board, act) for board in ALL]
    run = place.run(entries, trust=True)
    for entry in entries:
        assert all("FoundError" in str(reason) for reason in run.reasons(entry))


@needs_sandbox
def test_a_sandbox_holds(new_workshop: Made, honest_run: tuple[Workshop, Run]) -> None:
    """The one process of a sandbox that could be taken for the worker cannot be ended."""
    place = new_workshop(suite=ONE_EPISODE)
    harmless = ("honest", "children", "seek_truth", "seek_paths", "rewrite_valid")
    failing = ("segfault", "exit_0", "kill_guard", "kill_worker", "forge_results")
    entries = {
        act: place.spec("tracking", act, cache=place.cache, results=place.out)
        for act in (*harmless, *failing)
    }
    others = [place.spec(board, "honest") for board in ALL if board != "tracking"]
    marker = place.folder / "written"
    code = f"\nwith suppress(OSError):\n    Path({str(marker)!r}).write_text('x')\n"
    with place.plugins.open("a") as file:
        file.write(code)
    limits = replace(LIMITS, first_call_s=20, call_s=20)
    run = place.run([*entries.values(), *others], jobs=1, limits=limits, sandbox=True)
    assert not marker.exists()
    for entry in (*others, *(entries[act] for act in harmless)):
        assert run.reasons(entry) == [None]
    for act in failing:
        reasons = run.reasons(entries[act])
        assert all(reason and reason.startswith(entries[act]) for reason in reasons)
    expected = honest_run[1].values()
    assert run.values() == {place: expected[place] for place in run.values()}
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
        words = ["--only", "--entry", entry, *["--sandbox"] * sandbox, "--json", "--fresh"]
        done = place.command("tracking", "--jobs", "1", *words, kitti=Path(folder, "kitti"))
    reasons = [job.reason for job in results.jobs]
    reasons += [each["reason"] for each in json.loads(done.stdout)["failures"]]
    assert len(reasons) == 2 * len(results.jobs) > 0
    for reason in reasons:
        assert ("FileNotFoundError" if sandbox else "DontCare") in str(reason)
