"""What a plug-in writes into the results file is in no board."""

from collections.abc import Callable

import pytest

from roadscope.benchmarks import StoreError
from tests.torture.boards import Run, Workshop

Made = Callable[..., Workshop]
Honest = tuple[Workshop, Run]


def attacked(place: Workshop, act: str, *, jobs: int) -> Run:
    entry = place.spec("tracking", act, results=place.out)
    return place.run([entry], jobs=jobs, boards=["tracking"])


def of_trackers(run: Run) -> dict[str, object]:
    return {k: v for k, v in run.values().items() if k.startswith("tracking")}


@pytest.mark.parametrize("jobs", [1, 2])
def test_forged_rows_are_not_in_this_run_and_are_noticed_by_the_next(
    new_workshop: Made, honest_run: Honest, jobs: int
) -> None:
    place = new_workshop()
    honest = place.run([place.spec("tracking", "honest")], boards=["tracking"], out_dir=None)
    run = attacked(place, "forge_results", jobs=jobs)
    assert of_trackers(run) == of_trackers(honest_run[1])
    assert [s.rank for s in run.results.standings] == [s.rank for s in honest.results.standings]
    again = place.run([], boards=["tracking"])
    assert of_trackers(again) == of_trackers(honest_run[1])
    assert any("results.sqlite" in text and "nearest" in text for text in again.warned)


def test_a_results_file_that_was_ruined_costs_no_board(
    new_workshop: Made, honest_run: Honest
) -> None:
    place = new_workshop()
    run = attacked(place, "ruin_results", jobs=1)
    assert of_trackers(run) == of_trackers(honest_run[1])
    assert (place.out / "leaderboard.json").is_file()
    with pytest.raises(StoreError, match=r"results\.sqlite"):
        place.run([], boards=["tracking"])
