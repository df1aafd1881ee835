"""Files of a run that are changed or damaged falsify no board, and no innocent entry is blamed."""

import re
import sqlite3
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from roadscope.benchmarks import StoreError
from tests.torture.acts import ALL
from tests.torture.boards import ONE_EPISODE, TortureRun, Workshop, left_running, workshop

Made = Callable[..., Workshop]
Honest = tuple[Workshop, TortureRun]
ATTACKS = {
    "rewrite_broken": "forge_results",
    "rewrite_valid": "forge_results_well",
    "plant": "ruin_results",
}
"""What plug-ins do to kept files, and what others do to the results in the same run."""
CHANGED = "results were changed by another program"


def of_honest(run: TortureRun, honest: Honest) -> Mapping[str, object]:
    """Return what an honest run has in the place of each entry of a run."""
    return {place: honest[1].values()[place] for place in run.values()}


def of_strangers(run: TortureRun) -> list[tuple[str, Any]]:
    """Return the scores of each hostile entry, and its place without its act."""
    return [
        (re.sub(r"\S*hostile\.py:(\w+)\?\S*", r"\1", place), scores)
        for place, scores in run.values(hostile=True).items()
    ]


@pytest.fixture(scope="module")
def strangers(tmp_path_factory: pytest.TempPathFactory, honest_run: Honest) -> dict[str, Any]:
    """Return the scores of plug-ins of all boards without an attack."""
    folder = tmp_path_factory.mktemp("strangers") / "run"
    place = workshop(folder, honest_run[0].cache, ONE_EPISODE)
    return dict(of_strangers(place.run([place.spec(board, "honest") for board in ALL])))


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("act", ATTACKS)
def test_files_that_plugins_change_falsify_no_board(
    new_workshop: Made, honest_run: Honest, strangers: dict[str, Any], act: str, jobs: int
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    origin = honest_run[0].cache if act == "plant" else place.out
    entries = [place.spec(board, act, cache=place.cache, results=origin) for board in ALL]
    entries += [place.spec(board, ATTACKS[act], results=place.out) for board in ALL]
    run = place.run(entries, jobs=jobs, out_dir=place.out)
    assert run.values() == of_honest(run, honest_run)
    assert run.results.failed_entries == []
    for name, scores in of_strangers(run):
        assert scores == strangers[name]
    assert (place.out / "leaderboard.json").is_file()
    if act == "plant":
        planted = {path.name for path in (honest_run[0].cache / "tracks").iterdir()}
        assert planted & {path.name for path in (place.cache / "tracks").iterdir()}
        with pytest.raises(StoreError, match=r"results\.sqlite"):
            place.run([], out_dir=place.out)
    else:
        assert any(str(place.cache) in text for text in run.warned)
        assert any(CHANGED in text for text in run.warned)
        assert all(str(place.cache) in text or CHANGED in text for text in run.warned)
        again = place.run([], out_dir=place.out)
        assert again.values() == of_honest(again, honest_run)
        assert again.warned == []
        # In a new folder of results they are computed from the kept files.
        second = place.run([], out_dir=place.folder / "second")
        assert second.values() == of_honest(second, honest_run)
    assert left_running(place.plugins) == []


@pytest.mark.parametrize("jobs", [1, 2])
def test_files_that_were_damaged_between_runs_are_made_again(
    new_workshop: Made, honest_run: Honest, jobs: int
) -> None:
    """Results that were forged do not count, so that kept files are read."""
    place = new_workshop(suite=ONE_EPISODE)
    place.run([], out_dir=place.out)
    with sqlite3.connect(place.out / "results.sqlite") as database:
        database.execute("UPDATE results SET scores = replace(scores, '0.', '0.9')")
    database.close()
    damaged = [*place.cache.glob("*/*.cache"), *place.cache.glob("timelines/*")]
    for number, path in enumerate(damaged):
        flip(path, (number + jobs) % 2)
    run = place.run([], jobs=jobs, out_dir=place.out)
    assert run.values() == of_honest(run, honest_run)
    assert run.results.failed_entries == []
    assert any("results.sqlite" in text and "nearest" in text for text in run.warned)
    read = [path for path in damaged if path.parent.name != "timelines"]
    assert len(read) >= 6
    for path in read:
        assert any(str(path) in text for text in run.warned)
    again = place.run([], out_dir=place.folder / "second")
    assert again.values() == of_honest(again, honest_run)
    assert again.warned == []


def flip(path: Path, part: int) -> None:
    """Flip the bits of a byte; part: 0 for the digest at the beginning, 1 for the content."""
    content = bytearray(path.read_bytes())
    content[(10, len(content) // 2)[part]] ^= 0xFF
    path.write_bytes(content)
