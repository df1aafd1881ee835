"""The command line shows the board of a run in which plug-ins failed, and says so."""

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from roadscope import TRACKERS
from tests.torture.acts import ALL
from tests.torture.boards import ONE_EPISODE, Workshop, left_running, shown

PEERS = ("norfair", "stonesoup-gnn", "roboflow-sort")
Made = Callable[..., Workshop]
Answer = Callable[..., tuple[int, str, str]]
ACTS = {**dict.fromkeys(ALL, ("exit_0",)), "tracking": ("exit_0", "base_exception", "honest")}
NASTY = "=cmd|<script>alert(1)\x1b[31m\n\u202e&%_.py"
"""The name of a file that is a formula, a tag, a new line and a colour."""


def in_process(answer: Answer, place: Workshop, *words: str) -> tuple[int, str, str]:
    """Run the board of trackers by the command line in this process."""
    with place.in_use():
        return answer("leaderboard", "tracking", "--suite", place.suite, "--jobs", "1", *words)


def test_the_board_is_shown_and_the_status_is_1(new_workshop: Made) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    entries, names = [], []
    for board in ALL:
        specs = [place.spec(board, act) for act in ACTS[board]]
        entries += specs
        names += [shown(board, spec) for spec in specs]
    words = [word for entry in entries for word in ("--entry", entry)]
    done = place.command("--jobs", "2", "--out", str(place.out), *words)
    assert done.returncode == 1
    for board in ALL:
        assert f"{board} board" in done.stdout
    for own in ("distance", "nearest", "noisy-camera", "union", "still", "idm on truth"):
        assert own in done.stdout
    for name in names:
        named = [line for line in done.stdout.splitlines() if line.startswith(f"{name} failed")]
        assert len(named) == ("honest" not in name)
    assert "Traceback" not in done.stderr
    saved = json.loads((place.out / "leaderboard.json").read_text())
    failed = {f["entry"].removesuffix(" on oracle") for f in saved["failures"]}
    assert failed == {name for name in names if "honest" not in name}
    raised = [f for f in saved["failures"] if "base_exception" in f["entry"]]
    for failure in raised:
        assert failure["log_file"] in done.stdout
        assert failure["log"] in Path(failure["log_file"]).read_text()
    assert left_running(place.plugins) == []


def test_without_failures_the_status_is_0(new_workshop: Made, answer: Answer) -> None:
    """Infinity is an argument like any other."""
    place = new_workshop(suite=ONE_EPISODE)
    path = place.folder / "mine.py"
    path.write_text(
        "from roadscope.trackers import NearestTracker\n\n\n"
        "class Mine(NearestTracker):\n    def __init__(self, *, far):\n"
        "        super().__init__()\n        assert far == (float('inf'), -float('inf'))[far < 0]\n"
    )
    entries = [f"{path}:Mine?far={text}" for text in ("1e999", "-1e999")]
    words = [word for entry in entries for word in ("--entry", entry)]
    status, out, _ = in_process(answer, place, "--json", *words)
    assert status == 0
    assert set(entries) <= {row["entry"] for row in json.loads(out)["rows"]}


def test_what_strangers_write_is_harmless_wherever_it_is_shown(
    new_workshop: Made, answer: Answer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rich would take square brackets for its markup; a terminal obeys escape sequences."""
    summary = "[/nothing] [bold]\\u001b[31m"
    place = new_workshop(suite=ONE_EPISODE.replace("\n", f'\nsummary = "{summary}"\n', 1))
    (place.folder / NASTY).write_bytes(place.plugins.read_bytes())
    (place.folder / "mine.py").write_text(
        "class Mine:\n    kind = 'tracker'\n    def update(self, *_): pass\n    def reset(self):\n"
        "        raise RuntimeError('weights is not installed: pip install x')\n"
    )
    monkeypatch.chdir(place.folder)
    entries = [f"{NASTY}:Tracker?act={act}" for act in ("honest", "base_exception")]
    words = [word for entry in (*entries, "mine.py:Mine") for word in ("--entry", entry)]
    words += ["--width", "200", "--out", str(place.out)]
    status, out, error = in_process(answer, place, *words)
    assert status == 1
    assert "cmd" in out
    assert "[/nothing] [bold]?[31m" in out
    assert "mine.py:Mine failed" in out
    assert "(not installed)" not in out
    for text in (out, error):
        assert all(line.isprintable() for line in text.splitlines())
    check_csv(place.out / "leaderboard.csv")
    check_markdown(place.out / "leaderboard.md")
    check_latex(place.out / "leaderboard.tex")


def check_csv(path: Path) -> None:
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    assert len({len(row) for row in rows}) == 1
    texts = [cell for row in rows for cell in row if "cmd" in cell]
    assert texts
    for text in texts:
        assert text.isprintable()
        assert text[0] not in "=+-@"


def check_markdown(path: Path) -> None:
    lines = path.read_text().splitlines()
    named = [line for line in lines if "cmd" in line]
    assert named
    assert not any("<" in line for line in named)
    assert all(line.isprintable() for line in lines)
    tables = [line for line in named if line.startswith("| ")]
    columns = [len(re.findall(r"(?<!\\)\|", line)) for line in lines if line.startswith("| ---")]
    assert tables
    assert len(re.findall(r"(?<!\\)\|", tables[0])) == columns[0]


def check_latex(path: Path) -> None:
    lines = path.read_text().splitlines()
    named = [line for line in lines if "cmd" in line]
    assert named
    assert all(line.isprintable() for line in lines)
    for line in named:
        assert line.endswith(r"\\")
        assert not re.search(r"(?<!\\)[%_#]", line)


def test_a_named_entry_that_is_not_installed_gives_status_1(
    new_workshop: Made, answer: Answer
) -> None:
    absent = next((name for name in PEERS if TRACKERS.missing(name)), None)
    if absent is None:
        pytest.skip("all peers are installed")
    place = new_workshop(suite=ONE_EPISODE)
    status, out, _ = in_process(answer, place, "--entry", absent)
    assert status == 1
    assert f"{absent} is left out" in out


def test_only_trackers_get_poses(new_workshop: Made, answer: Answer) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    words = "--suite", place.suite, "--entry", "pag?ego=truth"
    status, _, error = answer("leaderboard", "detection", *words)
    assert status == 1
    assert "for trackers" in error
