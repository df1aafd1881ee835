"""Classes that fail when they are loaded, before a run and in it."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

import roadscope
from roadscope import SpecError
from tests.torture.acts import ALL, CLASSES
from tests.torture.boards import HANG_LIMITS, ONE_EPISODE, Run, Workshop, left_running, shown

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


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("board", ALL)
def test_a_class_that_fails_when_it_is_loaded_costs_its_own_row(
    new_workshop: Made, honest_run: tuple[Workshop, Run], board: str, jobs: int
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    entries = {
        name: written(place.folder, name, code, board) for name, (code, _) in FAILING.items()
    }
    names = list(entries.values())
    run = place.run(names, jobs=jobs, boards=[board], limits=HANG_LIMITS)
    for name, entry in entries.items():
        reasons = run.reasons(entry)
        assert len(reasons) == 1
        for reason in reasons:
            assert reason is not None
            assert reason.startswith(entry)
            assert FAILING[name][1] in reason.removeprefix(entry).lower()
    expected = honest_run[1].values()
    others = {k: v for k, v in run.values().items() if not any(name in k for name in names)}
    assert others
    assert others == {place: expected[place] for place in others}
    assert {shown(board, name) for name in names} <= set(run.results.failed_entries)
    assert left_running(place.folder) == []


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
