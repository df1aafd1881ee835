"""What a plug-in writes into the results file is in no board."""

from collections.abc import Callable

import pytest

from roadscope.benchmarks import StoreError
from tests.torture.acts import ALL
from tests.torture.boards import ONE_EPISODE, Run, Workshop

Made = Callable[..., Workshop]
Honest = tuple[Workshop, Run]


def attackers(place: Workshop, act: str) -> list[str]:
    """Return a hostile entry of each board."""
    return [place.spec(board, act, results=place.out) for board in ALL]


def expected(run: Run, honest: Run) -> dict[str, object]:
    """Return what an honest run has in the place of each entry of a run."""
    return {place: honest.values()[place] for place in run.values()}


@pytest.mark.parametrize("jobs", [1, 2])
def test_forged_rows_are_not_in_this_run_and_are_noticed_by_the_next(
    new_workshop: Made, honest_run: Honest, jobs: int
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    honest = place.run(attackers(place, "honest"), out_dir=None)
    run = place.run(attackers(place, "forge_results"), jobs=jobs)
    assert run.values() == expected(run, honest_run[1])
    assert [s.rank for s in run.results.standings] == [s.rank for s in honest.results.standings]
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
