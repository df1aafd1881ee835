"""Classes that fail when they are loaded, before a run and in it."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

import roadscope
from roadscope import SpecError
from tests.torture.acts import ALL, CLASSES
from tests.torture.boards import LOAD_LIMITS, ONE_EPISODE, Run, Workshop, left_running

Made = Callable[..., Workshop]
FAILING = {
    "segfault": ("import ctypes; ctypes.string_at(0)", "sigsegv"),
    "exit": ("import os; os._exit(0)", "status 0"),
    "loop": ("while True: pass", "hangs"),
    "system_exit": ("raise SystemExit(0)", "systemexit"),
    "division": ("1 / 0", "zerodivisionerror"),
    "base_exception": ("raise BaseException('bare')", "baseexception"),
    "nested": (f"class Tracker: x = {'-' * 200_000}1", "error"),
}
"""By the name of a file its first line, and what the reason says."""
UNREADABLE = "nested"
"""The file that does not tell the kind of its class either."""
CLASS = """
class {0}:
    kind = "{1}"
    def reset(self, *_): ...
    def {2}(self, *_): ...
"""
METHODS = {
    "detection": ("detector", "detect"),
    "camera": ("camera detector", "detect"),
    "tracking": ("tracker", "update"),
    "fusion": ("fusion", "fuse"),
    "odometry": ("odometry", "update"),
    "driving": ("driver", "drive"),
}
"""By board the kind of its entries, and what they are called by."""
MISTAKES = {
    "no file": (None, "no file"),
    "no class": ("class Other: ...", "Other"),
    "no Python": ("class Tracker", "SyntaxError"),
    "no package": ("import a_package_that_is_not_there", "a_package_that_is_not_there"),
}
SAYS_PROCESS = """
import os
from pathlib import Path
with Path(__file__).with_suffix(".log").open("a") as log:
    log.write(f"{os.getpid()}\\n")
"""


def written(folder: Path, name: str, code: str, board: str = "tracking") -> str:
    """Write the file of a plug-in and return its spec."""
    path = folder / f"{name}.py"
    path.write_text(code + "\n" + CLASS.format(CLASSES[board], *METHODS[board]))
    return f"{path}:{CLASSES[board]}"


def check_rows(run: Run, honest: Run, entries: dict[str, str]) -> None:
    """Check that each entry failed alone; entries: by spec the name of what fails."""
    for entry, name in entries.items():
        reasons = run.reasons(entry)
        assert len(reasons) == 1
        for reason in reasons:
            assert reason is not None
            assert reason.startswith(entry)
            assert FAILING[name][1] in reason.removeprefix(entry).lower()
        assert any(failed.startswith(entry) for failed in run.results.failed_entries)
    expected = honest.values()
    others = {k: v for k, v in run.values().items() if not any(entry in k for entry in entries)}
    assert others
    assert others == {place: expected[place] for place in others}


@pytest.mark.parametrize("jobs", [1, 2])
def test_classes_that_fail_when_they_are_loaded_cost_their_own_rows(
    new_workshop: Made, honest_run: tuple[Workshop, Run], jobs: int
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    entries = {
        written(place.folder, f"{name}_{board}", code, board): name
        for board in ALL
        for name, (code, _) in FAILING.items()
        if name != UNREADABLE
    }
    run = place.run(list(entries), jobs=jobs, limits=LOAD_LIMITS)
    check_rows(run, honest_run[1], entries)
    assert left_running(place.folder) == []


@pytest.mark.parametrize(("board", "jobs"), [*((board, 1) for board in ALL), ("tracking", 2)])
def test_a_class_that_cannot_be_read_either_costs_its_own_row_on_the_board_that_is_named(
    new_workshop: Made, honest_run: tuple[Workshop, Run], board: str, jobs: int
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    entry = written(place.folder, UNREADABLE, FAILING[UNREADABLE][0], board)
    run = place.run([entry], jobs=jobs, boards=[board], limits=LOAD_LIMITS)
    check_rows(run, honest_run[1], {entry: UNREADABLE})


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_of_the_user_ends_the_run_before_it_begins(
    new_workshop: Made, mistake: str
) -> None:
    place = new_workshop()
    code, said = MISTAKES[mistake]
    path = place.folder / "mine.py"
    if code is not None:
        path.write_text(code)
    with pytest.raises(SpecError, match=said):
        place.run([f"{path}:Tracker"], boards=["tracking"])
    assert list(place.out.iterdir()) == []


def test_a_class_that_fails_and_says_no_kind_needs_a_board(new_workshop: Made) -> None:
    place = new_workshop()
    path = place.folder / "mine.py"
    path.write_text("raise SystemExit\nclass Tracker:\n    update = None")
    entry = f"{path}:Tracker"
    with pytest.raises(SpecError, match="name the board"):
        place.run([entry])
    run = place.run([entry], boards=["tracking"])
    assert all("SystemExit" in str(reason) for reason in run.reasons(entry))


def test_a_trusted_class_is_loaded_in_this_process_alone(new_workshop: Made) -> None:
    place = new_workshop()
    entry = written(place.folder, "mine", SAYS_PROCESS)
    place.run([entry], boards=["tracking"], trust=True)
    assert set((place.folder / "mine.log").read_text().split()) == {str(os.getpid())}


def test_a_trusted_class_is_checked_in_this_process_alone(tmp_path: Path) -> None:
    entry = written(tmp_path, "mine", SAYS_PROCESS)
    assert not roadscope.check(entry, trust=True).ok
    assert set((tmp_path / "mine.log").read_text().split()) == {str(os.getpid())}


def test_a_class_that_hangs_when_it_is_loaded_is_checked_within_the_deadline(
    tmp_path: Path,
) -> None:
    entry = written(tmp_path, "mine", "while True: pass")
    report = roadscope.check(entry, deadline_s=1.0)
    assert [item.good for item in report.items] == [False]
    assert "hangs" in report.items[0].remark
