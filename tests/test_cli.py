import json
import os
import re
import shlex
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from interrupts import heed_interrupts

import roadscope
from roadscope.benchmarks import MEANINGS

ROOT = Path(roadscope.__file__).parents[1]
PLUGINS = Path(__file__).parent / "benchmarks" / "plugins.py"
OFFLINE = """
from roadscope.trackers import NearestTracker

class Late(NearestTracker):
    offline = True

    def rescored(self, history):
        return history
"""
SUITE = """
name = "tiny"
version = 1
rig = "lux"
scenarios = ["lu2018-three-vehicles"]
seeds = 4
duration_s = 0.9
"""


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "roadscope", *map(str, arguments)]


def environment() -> dict[str, str]:
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "COLUMNS": "80"}


def roadscope_does(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(*arguments), capture_output=True, text=True, env=environment(), cwd=cwd, timeout=300
    )


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(SUITE)
    return path


@pytest.fixture
def refused(answer) -> Callable[..., str]:
    """End with a status and nothing but errors, which are returned; in this process."""

    def refuse(status: int, *arguments: object) -> str:
        code, out, errors = answer(*arguments)
        assert (code, out) == (status, "")
        return errors

    return refuse


def test_list(answer) -> None:
    everything = answer("list")[1]
    for name in ("pag-range", "nearest", "roundabout", "quick", "lux", "hdl32e"):
        assert name in everything
    detectors = answer("list", "detectors")[1]
    assert "roundabout" not in detectors
    assert "oracle" in detectors


def test_json_of_names_and_of_one_episode(answer) -> None:
    everything = json.loads(answer("list", "--json")[1])
    assert "nearest" in everything["trackers"]
    assert list(json.loads(answer("list", "rigs", "--json")[1])) == ["rigs"]
    run = "run", "lu2018-occlusion", "--seconds", 1, "--detector", "oracle"
    status, out, _ = answer(*run, "--json")
    table = json.loads(out)
    assert (status, table["episode"]["scenario"]) == (0, "lu2018-occlusion")
    assert {"value", "unit", "n"} <= set(table["tracking"]["hota"])
    assert answer(*run, "--quiet") == (0, "", "")


@pytest.mark.slow
@pytest.mark.parametrize(("entry", "status"), [("nearest", 0), (f"{PLUGINS}:Raises", 1)])
def test_json_of_a_check_holds_every_item(answer, entry, status) -> None:
    code, out, errors = answer("check", entry, "--json")
    table = json.loads(out)
    assert (code, errors, table["ok"]) == (status, "", status == 0)
    assert all(item["good"] for item in table["items"]) == table["ok"]
    code, out, errors = answer("check", entry, "--quiet")
    assert (code, out, bool(errors)) == (status, "", status == 1)


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["list", "trakers"], 1, "no kind 'trakers' (did you mean 'trackers'?)"),
        (["leaderboard", "drift"], 1, "no board 'drift'; known: detection, tracking"),
        (["leaderboard", "--suite", "quik"], 1, "no suite 'quik' (did you mean 'quick'?)"),
        (["leaderboard", "--entry", "neerest"], 1, "no detector or tracker 'neerest'"),
        (["leaderboard", "--entry", "nearest?gate=1"], 1, "gate_m"),
        (["leaderboard", "--entry", "none.py:Mine"], 1, "no file none.py"),
        (["leaderboard", "--only"], 1, "--only needs at least one --entry"),
        (["run", "motorway", "--detector", f"{PLUGINS}:EgoFrame"], 1, "is a tracker, not a detec"),
        (["leaderboard", "--jobs", "-1"], 2, "--jobs"),
        (["leaderboard", "--by", "rnage"], 1, "no breakdown 'rnage' (did you mean 'range'?)"),
        (["leaderboard", "tracking", "--by", "range"], 1, "no tracking breakdown 'range'; known"),
        (["leaderboard", "--jbos", "2"], 2, "roadscope leaderboard --help"),
        (["run", "motorwy"], 1, "no scenario 'motorwy' (did you mean 'motorway'?)"),
        (["run", "motorway", "--rig", "lxu"], 1, "no rig 'lxu' (did you mean 'lux'?)"),
        (["run", "motorway", "--weather", "fgo"], 1, "no weather 'fgo' (did you mean 'fog'?)"),
        (["run", "motorway", "--light", "dsk"], 1, "no light 'dsk' (did you mean 'dusk'?)"),
        (["run", "motorway", "--detector", "pga"], 1, "no detector 'pga' (did you mean 'pag'?)"),
        (["run", "motorway", "--tracker", "nearst"], 1, "(did you mean 'nearest'?)"),
        (["speed", "trakcers"], 1, "no part 'trakcers' (did you mean 'trackers'?)"),
        (["run", "motorway", "--seconds", "-2"], 1, "got -2 s"),
        (["run", "lu2018-occlusion", "--seconds", "0.01"], 1, "one sweep of 'lux', got 0.01 s"),
        (["run", "motorway", "--seconds", "nan"], 1, "got nan s"),
        (["run", "motorway", "--seconds", "1e9"], 1, "at most 3600 s"),
        (["run", "motorway", "--light", "night"], 1, "rig 'lux' has no camera"),
        (["run", "roadscope/HighwayDense-v0"], 1, "the scenario 'dense-motorway'"),
        (["new", "trakcer"], 1, "no template 'trakcer' (did you mean 'tracker'?)"),
        (["run", "motorway", "--picture", "scene.txt"], 1, "a picture ends in .png"),
        (["run", "motorway", "--picture", "/proc/no/scene.png"], 1, "cannot write to folder"),
        (["run", "motorway", "--video", "drive.avi"], 1, "a video ends in .gif or .mp4"),
        (["run", "empty-motorway", "--seconds", "300", "--video", "a.gif"], 1, "of 3750 frames"),
        (
            ["run", "motorway", "--seconds", "300", "--video", "a.gif", "--video-every", "2"],
            1,
            "a greater --video-every",
        ),
        (
            ["run", "motorway", "--video", "a.gif", "--camera-detector", "oracle"],
            1,
            "rig 'lux' has no camera",
        ),
        (["run", "motorway", "--camera-detector", "oracle"], 2, "--picture or --video or --image"),
        (["run", "motorway", "--picture", "a.png", "--video-every", "2"], 2, "without --video "),
        (["run", "motorway", "--image", "a.png", "--video-width", "640"], 2, "without --video "),
        (["run", "motorway", "--image", "a.png", "--returns", "object"], 2, "--picture or --video"),
        (["run", "street", "--image", "seen.png"], 1, "rig 'lux' has no camera"),
        (["leaderboard", "--suite", "odometry", "--seeds", "20"], 1, "suite odometry v2 has 5;"),
        (["run", "street", "--rig", "wide", "--image", "seen.txt"], 1, "an image ends in .png"),
        (["reproduce", "lu2019"], 1, "no paper 'lu2019' (did you mean 'lu2018'?)"),
        (["fly"], 2, "fly"),
    ],
)
def test_bad_input_is_answered_in_one_line(arguments, status, message, refused) -> None:
    errors = refused(status, *arguments)
    assert message in errors
    assert errors.startswith("error: ")
    assert errors.count("\n") == 1


def test_each_problem_of_a_suite_is_a_line(tmp_path, answer) -> None:
    file = tmp_path / "mine.toml"
    text = (
        'name = "mine"\nversion = 1\nrig = "luxx"\nduration_s = 1.0\nscenarios = ["motorwy"]\n'
        'seeds = [20000]\n[tracking]\nentries = ["nearst"]\ndetectors = ["noisy-misess"]\n'
    )
    file.write_text(text)
    status, out, errors = answer("leaderboard", "--suite", str(file))
    assert (status, out) == (1, "")
    first, *problems = errors.splitlines()
    assert "4 problems" in first
    for problem, name in zip(problems, ("motorway", "lux", "nearest", "noisy-misses"), strict=True):
        assert problem.startswith("- ")
        assert f"did you mean '{name}'" in problem


NEEDY = """
from roadscope.core import Requirement


class Needy:
    requires = Requirement("no-such-distribution", "pip install no-such-distribution")

    def reset(self): ...

    def {method}(self, *given): ...
"""


@pytest.mark.parametrize(
    ("kind", "method"), [("tracker", "update"), ("detector", "detect"), ("odometry", "update")]
)
def test_what_is_not_installed_is_said_before_anything_runs(
    answer, monkeypatch, tmp_path, kind, method
) -> None:
    (tmp_path / "needy.py").write_text(NEEDY.format(method=method))
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path / "cache"))
    status, out, errors = answer("run", "motorway", f"--{kind}", f"{tmp_path}/needy.py:Needy")
    assert (status, out) == (1, "")
    assert "no-such-distribution is not installed" in errors
    assert not (tmp_path / "cache" / "timelines").exists(), "traffic was recorded"


def test_bad_input_ends_the_program_too() -> None:
    done = roadscope_does("list", "trakers")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("error: no kind 'trakers'")
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_folders_that_cannot_be_used(tmp_path, suite, refused) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    db = sqlite3.connect(foreign / "results.sqlite")
    db.execute("CREATE TABLE mine (a)")
    db.close()
    corrupt = tmp_path / "corrupt"
    corrupt.mkdir()
    (corrupt / "results.sqlite").write_bytes(b"\0garbage" * 1000)
    for out, message in (
        (blocked, "a file is in the way"),
        (foreign, "another program"),
        (corrupt, "not usable"),
    ):
        errors = refused(
            1, "leaderboard", "--suite", suite, "--entry", "pag", "--jobs", 1, "--out", out
        )
        assert message in errors
        assert errors.count("\n") == 1


def test_leaderboard_prints_and_writes(tmp_path, suite) -> None:
    out = tmp_path / "out"
    suite.write_text(SUITE + '[detection]\nentries = ["pag"]\n')
    entry = f"{PLUGINS}:Raises"
    done = roadscope_does(
        *("leaderboard", "--suite", suite, "--entry", entry, "--jobs", 1, "--out", out),
        *("--by", "range", "--by", "category", "--by", "range"),
    )
    # One entry failed.
    assert done.returncode == 1
    assert "oracle" in done.stdout
    assert "detected by range, m" in done.stdout
    assert done.stdout.count("precision by range, m") == 1
    assert "detected by category" in done.stdout
    board_lines = done.stdout.partition("written:")[0].splitlines()
    # What failed is one line each, however long, so that it can be searched for.
    assert max(len(line) for line in board_lines if " failed in " not in line) <= 80
    assert f"{entry} failed in every episode: KeyError" in " ".join(done.stdout.split())
    board = json.loads((out / "leaderboard.json").read_text())
    assert {row["entry"] for row in board["rows"]} == {"oracle", "one-cluster", "pag", entry}
    assert {failure["entry"] for failure in board["failures"]} == {entry}
    (place,) = [place for place in board["standings"] if place["entry"] == entry]
    assert place["rank"] is None
    assert "KeyError" in place["reason"]
    ranks = [place["rank"] for place in board["standings"] if place["mark"] is None]
    assert ranks == [1, None]
    assert not any(line.startswith("2 ") for line in board_lines)
    assert f"{entry} failed in every episode: KeyError" in (out / "leaderboard.md").read_text()


@pytest.mark.slow
def test_the_width_is_that_which_is_asked_for(answer, tmp_path, suite) -> None:
    suite.write_text(SUITE.replace("seeds = 4", "seeds = 1") + '[detection]\nentries = ["pag"]\n')
    widest = {}
    for width in (60, 200):
        status, out, errors = answer(
            *("leaderboard", "--suite", suite, "--jobs", 1, "--out", tmp_path / "out"),
            *("--width", width),
        )
        assert status == 0, errors
        lines = out.partition("written:")[0].splitlines()
        widest[width] = max(map(len, lines))
        assert widest[width] <= width
    assert widest[200] > 100


@pytest.mark.slow
def test_texts_fit_the_seeds_and_entries_of_the_run(answer) -> None:
    entry = "nearest?gate_m=3"
    options = ["--entry", entry, "--only", "--detections", "oracle"]
    status, out, _ = answer("leaderboard", "tracking", *options, "--seeds", 1, "--jobs", 1)
    assert status == 0
    assert "1 seed." in out
    assert "no intervals" in out
    assert not re.search("three|seeds|on oracle", out)
    hint = shlex.split(out.splitlines()[-1])
    assert hint[-len(options) - 5 :] == [
        *("roadscope", "leaderboard", "tracking", "--suite", "tracking"),
        *options,
    ]


@pytest.mark.slow
def test_json_in_place_of_tables_or_nothing_at_all(tmp_path, suite) -> None:
    """Plain lines of progress go to the other stream of a pipe."""
    suite.write_text(SUITE.replace("seeds = 4", "seeds = 1") + '[detection]\nentries = ["pag"]\n')
    options = ["leaderboard", "--suite", suite, "--jobs", 1, "--out", tmp_path / "out"]
    content = roadscope_does(*options, "--json")
    assert content.returncode == 0, content.stderr
    board = json.loads(content.stdout)
    assert {row["entry"] for row in board["rows"]} == {"oracle", "one-cluster", "pag"}
    assert {score["entry"] for score in board["scores"]} == {"oracle", "one-cluster", "pag"}
    assert re.search(r"^detection.* 3/3\b", content.stderr, re.M)
    assert "\r" not in content.stderr
    assert "\x1b" not in content.stderr
    silent = roadscope_does(*options, "--quiet", "--fresh")
    assert (silent.returncode, silent.stdout, silent.stderr) == (0, "", "")


WRITES_ITS_PROCESS = """
import os
from pathlib import Path
from roadscope import Detections

class Mine:
    kind = "detector"

    def __init__(self, *, log):
        self.log = Path(log)

    def reset(self):
        self.log.write_text(str(os.getpid()))

    def detect(self, frame):
        return Detections.empty(frame.stamp_s)
"""


@pytest.mark.slow
@pytest.mark.parametrize("options", [(), ("--trust",)])
def test_only_what_is_trusted_runs_in_the_process_of_the_run(tmp_path, suite, options) -> None:
    suite.write_text(SUITE.replace("seeds = 4", "seeds = 1"))
    (tmp_path / "mine.py").write_text(WRITES_ITS_PROCESS)
    entry = f"{tmp_path / 'mine.py'}:Mine?log={tmp_path / 'log'}"
    process = started(
        command(
            *("leaderboard", "detection", "--suite", suite, "--entry", entry, "--only"),
            *("--jobs", 1, "--out", tmp_path / "out", *options),
        )
    )
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    ran_inside = int((tmp_path / "log").read_text()) == process.pid
    assert ran_inside == bool(options)


@pytest.mark.slow
def test_run_prints_a_summary_and_draws(tmp_path) -> None:
    path, plugin = tmp_path / "scene.png", tmp_path / "late.py"
    plugin.write_text(OFFLINE)
    done = roadscope_does(
        "run",
        "lu2018-occlusion",
        *("--seconds", 1, "--picture", path, "--weather", "rain-2", "--rig", "li2021"),
        *("--light", "dusk", "--tracker", f"{plugin}:Late"),
    )
    assert done.returncode == 0
    assert "lu2018-occlusion, seed 0, li2021, rain-2 + dusk: " in done.stdout
    assert "without effect on LiDAR detectors: dusk" in done.stdout
    assert "detection_rate" in done.stdout
    assert "mota" in done.stdout
    assert "late.py:Late (offline)" in " ".join(done.stdout.split())
    assert path.read_bytes().startswith(b"\x89PNG")
    assert "rror" not in done.stderr


@pytest.mark.slow
def test_run_explains_ten_figures_of_each_and_shows_all_when_asked() -> None:
    run = ("run", "lu2018-occlusion", "--seconds", 1, "--odometry", "still")
    short, whole = roadscope_does(*run), roadscope_does(*run, "--all")
    assert (short.returncode, whole.returncode) == (0, 0)
    names = [line.split()[0] for line in whole.stdout.splitlines() if line.strip()]
    for kind, meanings in MEANINGS.items():
        assert len(meanings) == 10
        for name, meaning in meanings.items():
            assert name in names
            (line, *_) = [
                x for x in short.stdout.splitlines() if x.rstrip().endswith(f" {meaning}")
            ]
            assert line.startswith(name)
        assert f"{kind} " in short.stdout
    assert max(map(len, short.stdout.splitlines())) <= 80
    assert "gospa_m" in names
    assert "gospa_m" not in short.stdout


@pytest.mark.slow
def test_run_shows_what_the_camera_sees(tmp_path) -> None:
    path = tmp_path / "seen.png"
    done = roadscope_does(
        "run",
        "street",
        "--rig",
        "wide",
        "--seconds",
        1,
        "--image",
        path,
        "--camera-detector",
        "oracle",
    )
    assert done.returncode == 0
    boxes = re.search(r"image: .*seen\.png, (\d+) boxes of oracle", done.stdout.replace("\n", ""))
    assert boxes is not None
    assert int(boxes[1]) > 0
    assert path.read_bytes().startswith(b"\x89PNG")


def test_a_picture_that_is_a_folder_is_refused_first(tmp_path, refused) -> None:
    folder = tmp_path / "scene.png"
    folder.mkdir()
    errors = refused(1, "run", "motorway", "--picture", folder)
    assert "it is a folder" in errors
    assert errors.count("\n") == 1


TRACKING = '[tracking]\ndetectors = ["pag"]\n'


def slow_run(suite: Path, out: Path, log: Path, jobs: int) -> list[str]:
    """Return the command that runs a slow detector and a tracker on a suite with both boards."""
    slow = f"{PLUGINS}:Logged?log={log}&wait_s=0.06"
    chosen = "--entry", slow, "--entry", "nearest", "--only"
    return command("leaderboard", "--suite", suite, *chosen, "--jobs", jobs, "--out", out)


def rows_of(out: Path) -> dict[str, str]:
    """Return the scores of the finished jobs, with all times, by the keys of the jobs."""
    path = out / "results.sqlite"
    if not path.exists():
        return {}
    db = sqlite3.connect(path)
    try:
        return dict(db.execute("SELECT key, scores FROM results"))
    except sqlite3.OperationalError:
        return {}
    finally:
        db.close()


def stopped(process: subprocess.Popen[str], out: Path, sent: signal.Signals) -> None:
    """Send the signal to the process group as soon as a first job is finished."""
    while not rows_of(out) and process.poll() is None:
        time.sleep(0.01)
    assert process.poll() is None
    os.killpg(process.pid, sent)


def started(arguments: list[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        arguments,
        env=environment(),
        text=True,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=heed_interrupts,
    )


def episodes_begun(log: Path) -> int:
    return log.read_text().count("begun") if log.exists() else 0


def untimed_rows(out: Path) -> list[dict[str, Any]]:
    """Return the rows of the written boards but those of times."""
    rows = json.loads((out / "leaderboard.json").read_text())["rows"]
    return [row for row in rows if not row["metric"].endswith("_ms")]


@pytest.mark.slow
def test_twelve_kills_at_random_moments_lose_nothing(tmp_path, suite) -> None:
    """Nothing is computed twice but what was running, and the board is that of one whole run."""
    episodes, kills = 24, 12
    suite.write_text(SUITE.replace("seeds = 4", f"seeds = {episodes}") + TRACKING)
    out, log, rng = tmp_path / "out", tmp_path / "log", np.random.default_rng(0)
    before: dict[str, str] = {}
    running = 0
    for kill in range(kills):
        jobs = 1 + kill % 2
        process = started(slow_run(suite, out, log, jobs))
        target = episodes_begun(log) + rng.integers(3)
        while episodes_begun(log) < target and process.poll() is None:
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 1.0))
        assert process.poll() is None
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate(timeout=60)
        running += jobs
        after = rows_of(out)
        assert before.items() <= after.items()
        before = after
    assert 0 < len(before) < 2 * episodes
    assert not (out / "leaderboard.json").exists()
    subprocess.run(slow_run(suite, out, log, 2), env=environment(), check=True)
    assert before.items() <= rows_of(out).items()
    assert len(rows_of(out)) == 2 * episodes
    assert episodes <= episodes_begun(log) <= episodes + running
    variables = {**environment(), "ROADSCOPE_CACHE": str(tmp_path / "cache")}
    subprocess.run(slow_run(suite, tmp_path / "whole", log, 2), env=variables, check=True)
    assert untimed_rows(out) == untimed_rows(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_ctrl_c_keeps_finished_rows(tmp_path, suite, jobs) -> None:
    out = tmp_path / "out"
    suite.write_text(SUITE + TRACKING)
    process = started(slow_run(suite, out, tmp_path / "log", jobs))
    stopped(process, out, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.splitlines()[-1].startswith("interrupted; finished results are kept")
    assert "Traceback" not in errors
    assert rows_of(out)


@pytest.mark.slow
def test_sigterm_ends_workers_and_prints_nothing(tmp_path, suite) -> None:
    out = tmp_path / "out"
    suite.write_text(SUITE + TRACKING)
    process = started([*slow_run(suite, out, tmp_path / "log", 2), "--quiet"])
    while not rows_of(out) and process.poll() is None:
        time.sleep(0.01)
    process.terminate()
    assert process.communicate(timeout=60) == ("", "")
    assert process.returncode == 143
    assert rows_of(out)


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [int(c) for c in children if "loky_posix" in Path(f"/proc/{c}/cmdline").read_text()]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
def test_workers_end_with_a_killed_run(tmp_path, suite) -> None:
    out = tmp_path / "out"
    suite.write_text(SUITE + TRACKING)
    process = started(slow_run(suite, out, tmp_path / "log", 2))
    while not rows_of(out) and process.poll() is None:
        time.sleep(0.01)
    workers = workers_of(process)
    assert workers
    process.kill()
    # They hold the other ends of the pipes: this returns once they are gone.
    process.communicate(timeout=60)
    assert not any(Path(f"/proc/{worker}/exe").exists() for worker in workers)


@pytest.mark.parametrize("words", [(), ("cache",)])
def test_without_a_command_the_help_is_shown(words) -> None:
    done = roadscope_does(*words)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == roadscope_does(*words, "--help").stdout
