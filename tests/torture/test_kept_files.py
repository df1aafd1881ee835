"""Kept files that are damaged or changed are not used, and nobody else is blamed for them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.torture.acts import ALL
from tests.torture.boards import ONE_EPISODE, Run, Workshop, left_running

Made = Callable[..., Workshop]
Honest = tuple[Workshop, Run]
BOARDS = ("tracking", "fusion")
"""Those whose entries get what others detected, from kept files."""


def attacked(place: Workshop, act: str, *, jobs: int, **more: str) -> Run:
    """Run all boards, with one hostile entry each."""
    entries = [place.spec(board, act, cache=place.cache, **more) for board in ALL]
    return place.run(entries, jobs=jobs)


def expected(run: Run, honest: Run) -> dict[str, object]:
    """Return what an honest run has in the place of each entry of a run."""
    return {place: honest.values()[place] for place in run.values()}


def of_boards(run: Run) -> dict[str, object]:
    return {k: v for k, v in run.values().items() if k.startswith(BOARDS)}


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("act", ["rewrite_broken", "rewrite_valid"])
def test_files_that_a_plugin_rewrote_are_made_again(
    new_workshop: Made, honest_run: Honest, act: str, jobs: int
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    run = attacked(place, act, jobs=jobs)
    assert run.values() == expected(run, honest_run[1])
    assert run.results.failed_entries == []
    folder = str(place.cache)
    assert run.warned
    assert [text for text in run.warned if folder not in text] == []
    again = place.run([], jobs=1, out_dir=place.folder / "second")
    assert again.values() == expected(again, honest_run[1])
    assert left_running(place.plugins) == []


@pytest.mark.parametrize("jobs", [1, 2])
def test_answers_that_a_plugin_wrote_for_others_are_not_used(
    new_workshop: Made, honest_run: Honest, jobs: int
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    run = attacked(place, "plant", jobs=jobs, results=str(honest_run[0].cache))
    planted = {path.name for path in (honest_run[0].cache / "tracks").iterdir()}
    assert planted & {path.name for path in (place.cache / "tracks").iterdir()}
    assert run.values() == expected(run, honest_run[1])
    assert run.results.failed_entries == []


@pytest.mark.parametrize(("where", "jobs"), [(10, 1), (0.5, 2)])
def test_a_file_that_was_damaged_between_runs_is_made_again(
    new_workshop: Made, honest_run: Honest, where: float, jobs: int
) -> None:
    place = new_workshop()
    place.run([], jobs=1, boards=BOARDS)
    damaged = [*place.cache.glob("detections/*.cache"), *place.cache.glob("tracks/*.cache")]
    damaged += place.cache.glob("timelines/*")
    assert len(damaged) >= 6
    for path in damaged:
        flip(path, where)
    run = place.run([], jobs=jobs, boards=BOARDS, out_dir=place.folder / "second")
    assert of_boards(run) == of_boards(honest_run[1])
    assert run.results.failed_entries == []
    read = [path for path in damaged if path.parent.name != "timelines"]
    for path in read:
        assert any(str(path) in text for text in run.warned)
    again = place.run([], jobs=1, boards=BOARDS, out_dir=place.folder / "third")
    assert not any(str(path) in text for path in read for text in again.warned)


def flip(path: Path, where: float) -> None:
    """Flip the bits of a byte; where: its number, or the share of the file before it."""
    content = bytearray(path.read_bytes())
    content[where if isinstance(where, int) else int(where * len(content))] ^= 0xFF
    path.write_bytes(content)
