"""Classes that fail when they are loaded, before a run and in it."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

import roadscope
from roadscope import SpecError
from tests.torture.acts import ALL, CLASSES
from tests.torture.boards import ONE_EPISODE, TortureRun, Workshop

Made = Callable[..., Workshop]
NESTED = f"class Tracker: x = {'-' * 200_000}1"
"""A file that does not tell the kind of its class either."""
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


@pytest.mark.parametrize("board", ALL)
def test_a_class_that_cannot_be_read_either_costs_its_own_row_on_the_board_that_is_named(
    new_workshop: Made, honest_run: tuple[Workshop, TortureRun], board: str
) -> None:
    """With two workers the failed entry is tried again."""
    place = new_workshop(suite=ONE_EPISODE)
    entry = written(place.folder, "nested", NESTED, board)
    for jobs in (1, 2):
        run = place.run([entry], jobs=jobs, boards=[board])
        for reason in run.reasons(entry):
            assert reason is not None
            assert reason.startswith(entry)
            assert "Error" in reason.removeprefix(entry)
        assert any(failed.startswith(entry) for failed in run.results.failed_entries)
        others = {k: v for k, v in run.values().items() if entry not in k}
        assert others
        assert others == {k: honest_run[1].values()[k] for k in others}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_of_the_user_ends_the_run_before_it_begins(
    new_workshop: Made, mistake: str
) -> None:
    place = new_workshop()
    code, message = MISTAKES[mistake]
    path = place.folder / "mine.py"
    if code is not None:
        path.write_text(code)
    with pytest.raises(SpecError, match=message):
        place.run([f"{path}:Tracker"], boards=["tracking"], out_dir=place.out)
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
