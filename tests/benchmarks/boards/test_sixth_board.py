"""Adding a board is one file and one line, and its import: shown in a copy of the package."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import roadscope

SUITE = """
name = "mine"
version = 1
rig = "lux"
scenarios = ["motorway", "two-way"]
split = "validation"
seeds = 2
duration_s = 4.0
[following]
entries = ["coast"]
step_s = 0.5
"""
STEPS, EPISODES = 8, 4
DRIVERS = """
import os

def note(text):
    with open({log!r}, "a") as file:
        file.write(text + "\\n")

class Careful:
    def reset(self):
        note("begins")

    def drive(self, gap_m, speed_m_s):
        note(str(os.getpid()))
        return -8.0 if gap_m < 2 * speed_m_s else 0.0

class Breaks:
    calls = 0

    def reset(self):
        self.calls = 0

    def drive(self, gap_m, speed_m_s):
        self.calls += 1
        if self.calls > 3:
            raise RuntimeError("the wheel came off")
        return 0.0

class Wild:
    kind = "follower"

    def reset(self): ...

    def drive(self, gap_m, speed_m_s):
        return 1e3
"""
PROMISES = """
from roadscope.testing.shared import start_promises
from roadscope.testing.subject import Promise, PromiseError

def brakes(subject):
    with subject.started() as instance:
        if instance.call("drive", 1.0, 10.0) >= 0:
            raise PromiseError("it does not brake close to a car")
    return ""

PROMISES = *start_promises("drive", "gap_m, speed_m_s"), Promise("brakes", brakes)
"""
IMPORT = "from roadscope.benchmarks.boards.following import FollowingBoard\n"
LINE = "        FollowingBoard(),\n"
LAST = "        OdometryBoard(),\n"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a copy of the package that has the board, a suite and drivers."""
    root = tmp_path_factory.mktemp("sixth")
    package = root / "roadscope"
    skipped = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(roadscope.__file__).parent, package, ignore=skipped)
    boards = package / "benchmarks/boards"
    shutil.copy(Path(__file__).parent / "following_board.py", boards / "following.py")
    registry = boards / "__init__.py"
    text = registry.read_text()
    assert text.count(LAST) == 1
    before, line, after = text.partition("from roadscope.benchmarks.boards.fusion")
    registry.write_text((before + IMPORT + line + after).replace(LAST, LAST + LINE))
    (root / "mine.toml").write_text(SUITE)
    (root / "drivers.py").write_text(DRIVERS.format(log=str(root / "log")))
    return root


def does(home: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "roadscope", *arguments]
    environment = {
        **os.environ,
        "PYTHONPATH": str(home),
        "ROADSCOPE_CACHE": str(home / "cache"),
        "COLUMNS": "160",
        **variables,
    }
    return subprocess.run(
        command, capture_output=True, text=True, cwd=home, env=environment, timeout=300
    )


def ranks(home: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command_arguments = (
        "following",
        "--suite",
        "mine.toml",
        "--jobs",
        "1",
        "--out",
        "out",
        *arguments,
    )
    return does(home, "leaderboard", *command_arguments)


def calls(home: Path) -> list[str]:
    """Return what the careful driver noted since this was last asked."""
    log = home / "log"
    lines = log.read_text().splitlines() if log.exists() else []
    log.unlink(missing_ok=True)
    return lines


def written(home: Path) -> dict[tuple[str, str], float]:
    rows = json.loads((home / "out/leaderboard.json").read_text())["rows"]
    return {(row["entry"], row["metric"]): row["value"] for row in rows}


@pytest.fixture(scope="module")
def first(home: Path) -> subprocess.CompletedProcess[str]:
    """The first run: a driver of the suite, and three of a stranger of which two fail."""
    entry_options = [f"--entry=drivers.py:{name}" for name in ("Careful", "Breaks", "Wild")]
    return ranks(home, *entry_options, "--by", "scenario")


@pytest.mark.slow
def test_drivers_are_ranked_by_what_they_do_to_the_world(home: Path, first) -> None:
    assert first.returncode == 1, first.stderr
    figures = written(home)
    assert figures["drivers.py:Careful", "least_gap"] > figures["coast", "least_gap"]
    standings = json.loads((home / "out/leaderboard.json").read_text())["standings"]
    ranked = {each["entry"]: each["rank"] for each in standings}
    assert (ranked["drivers.py:Careful"], ranked["coast"]) == (1, 2)
    assert ranked["drivers.py:Breaks"] is ranked["drivers.py:Wild"] is None
    assert figures["drivers.py:Careful", "call_p50_ms"] >= 0


@pytest.mark.slow
def test_the_printed_board_has_its_columns_breakdown_and_reasons(first) -> None:
    text = first.stdout
    assert "Drivers follow a car that brakes." in text
    assert "following board" in text
    for word in ("follower", "least gap m", "mean gap m", "ms p50", "by scenario", "two-way"):
        assert word in text, word
    assert "drivers.py:Breaks failed in every episode" in text
    assert "the wheel came off" in text
    assert "expected an acceleration up to 8 m/s2, got 1000.0" in text


@pytest.mark.slow
def test_drivers_run_isolated_once_a_step_and_only_when_they_must(home: Path, first) -> None:
    entry = "--entry=drivers.py:Careful"
    noted = calls(home)
    assert noted.count("begins") == EPISODES
    assert len(noted) == EPISODES * (1 + STEPS)
    assert str(os.getpid()) not in noted
    before = written(home)
    again = ranks(home, entry)
    assert again.returncode == 0, again.stderr
    assert calls(home) == []
    assert "drives" not in again.stderr
    (home / "out/results.sqlite").unlink()
    assert ranks(home, entry).returncode == 0
    assert calls(home) == [], "drives are kept"
    assert ranks(home, entry, "--fresh").returncode == 0
    assert calls(home).count("begins") == EPISODES
    after = written(home)
    assert {key for key in after if key[1] == "least_gap"} <= before.keys()
    assert {after[key] - before[key] for key in after if key[1] == "least_gap"} == {0.0}


@pytest.mark.slow
def test_its_table_of_a_suite_is_checked_with_all_others(home: Path) -> None:
    wrong = SUITE.replace(
        "step_s = 0.5", "step_s = -1\nstepp_s = 1\n[follwoing]\n[tracking]\nego=''"
    )
    (home / "wrong.toml").write_text(wrong)
    refused = does(home, "leaderboard", "following", "--suite", "wrong.toml")
    assert refused.returncode != 0
    for words in ("following.step_s: ", "following.stepp_s", "'follwoing'", "tracking.ego: "):
        assert words in refused.stderr, words
    unknown = does(home, "leaderboard", "following", "--suite", "mine.toml", "--entry", "coats")
    assert "no follower 'coats' (did you mean 'coast'" in unknown.stderr
    other = does(home, "leaderboard", "following", "--suite", "mine.toml", "--entry", "nearest")
    assert "'nearest' is a tracker; the boards of this run are for a follower" in other.stderr


@pytest.mark.slow
def test_the_command_line_knows_the_board(home: Path) -> None:
    listed = does(home, "list", "boards").stdout
    assert "Ranks drivers by their least distance to the car ahead." in listed
    assert does(home, "list", "followers").stdout.split()[:2] == ["followers", "coast"]
    words = {"COMP_WORDS": "roadscope leaderboard --entry coa", "COMP_CWORD": "3"}
    completed = does(home, _ROADSCOPE_COMPLETE="complete_bash", **words).stdout
    assert completed.split() == ["coast"]
    # Several workers would first compile what other boards need.
    run_options = ("--suite", "mine.toml", "--jobs", "1", "--entry", "drivers.py:Careful")
    whole = does(home, "leaderboard", *run_options)
    assert whole.returncode == 0, whole.stderr
    assert "following board" in whole.stdout
    assert "answers" in does(home, "cache", "clear").stdout


@pytest.mark.slow
def test_what_reads_results_knows_the_board(home: Path, first) -> None:
    page = does(home, "report", "out")
    assert page.returncode == 0, page.stderr
    assert "least gap" in (home / "out/report.html").read_text()
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    shown = does(home, "view", "out", "--save", "drive.rrd")
    assert shown.returncode == 1
    assert "is a drive behind a car, which no view shows" in shown.stderr


@pytest.mark.slow
def test_its_kind_of_plugin_is_checked(home: Path) -> None:
    assert "follower" in does(home, "check", "coast", "--kind", "followr").stderr
    loaded = does(home, "check", "coast")
    assert loaded.returncode == 0, loaded.stdout
    assert "a follower; what followers promise beyond these items is not known" in loaded.stdout
    assert "has reset and drive" in loaded.stdout
    (home / "roadscope/testing/follower.py").write_text(PROMISES)
    broken = does(home, "check", "drivers.py:Wild")
    assert broken.returncode == 1, broken.stderr
    assert "brakes: it does not brake close to a car" in broken.stdout
    either = does(home, "check", "drivers.py:Breaks")
    assert "it may be a driver or a follower" in either.stdout
