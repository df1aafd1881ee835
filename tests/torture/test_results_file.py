"""What a plug-in writes into the results file is in no board."""

import sqlite3
from collections.abc import Callable

import pytest

from roadscope.benchmarks import StoreError
from tests.torture.acts import ALL
from tests.torture.boards import ONE_EPISODE, Run, Workshop, workshop

Made = Callable[..., Workshop]
Honest = tuple[Workshop, Run]


def attackers(place: Workshop, act: str) -> list[str]:
    """Return a hostile entry of each board."""
    return [place.spec(board, act, results=place.out) for board in ALL]


def expected(run: Run, honest: Run) -> dict[str, object]:
    """Return what an honest run has in the place of each entry of a run."""
    return {place: honest.values()[place] for place in run.values()}


@pytest.fixture(scope="module")
def ranks(tmp_path_factory: pytest.TempPathFactory, honest_run: Honest) -> list[int | None]:
    """Return the ranks of all standings if nobody attacks."""
    folder = tmp_path_factory.mktemp("ranks") / "run"
    place = workshop(folder, honest_run[0].cache, ONE_EPISODE)
    run = place.run(attackers(place, "honest"), out_dir=None)
    return [standing.rank for standing in run.results.standings]


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("act", ["forge_results", "forge_results_well"])
def test_forged_rows_are_in_no_board(
    new_workshop: Made, honest_run: Honest, ranks: list[int | None], act: str, jobs: int
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    run = place.run(attackers(place, act), jobs=jobs)
    assert run.values() == expected(run, honest_run[1])
    assert [standing.rank for standing in run.results.standings] == ranks
    assert any("results were changed by another program" in text for text in run.warned)
    again = place.run([])
    assert again.values() == expected(again, honest_run[1])
    assert again.warned == []


def test_rows_that_were_forged_between_runs_do_not_count(
    new_workshop: Made, honest_run: Honest
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    place.run([])
    with sqlite3.connect(place.out / "results.sqlite") as database:
        database.execute("UPDATE results SET scores = replace(scores, '0.', '0.9')")
    database.close()
    again = place.run([])
    assert again.values() == expected(again, honest_run[1])
    assert any("results.sqlite" in text and "nearest" in text for text in again.warned)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_results_file_that_was_ruined_costs_no_board(
    new_workshop: Made, honest_run: Honest, jobs: int
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    run = place.run(attackers(place, "ruin_results"), jobs=jobs)
    assert run.values() == expected(run, honest_run[1])
    assert (place.out / "leaderboard.json").is_file()
    with pytest.raises(StoreError, match=r"results\.sqlite"):
        place.run([])
