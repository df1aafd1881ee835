"""Calls of an episode have deadlines: the first, each later one, and all of them together."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from tests.torture.acts import ALL
from tests.torture.boards import LIMITS, ONE_EPISODE, TortureRun, Workshop, left_running

CASES = {
    "hang_in_third_call": (replace(LIMITS, call_s=0.4), "no answer within 0.4 s"),
    "dawdle": (replace(LIMITS, episode_s=0.6), "all calls of the episode took more than 0.6 s"),
}
"""By act the limits, and what the reason says; the first call of the one takes 0.6 s."""


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("act", CASES)
def test_an_entry_that_misses_a_deadline_is_one_row(
    new_workshop: Callable[..., Workshop],
    honest_run: tuple[Workshop, TortureRun],
    act: str,
    jobs: int,
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    limits, message = CASES[act]
    entries = [place.spec(board, act) for board in ALL]
    run = place.run(entries, jobs=jobs, limits=limits)
    for entry in entries:
        reasons = run.reasons(entry)
        assert len(reasons) == 1
        assert str(reasons[0]).startswith(entry)
        assert message in str(reasons[0])
    expected = honest_run[1].values()
    assert run.values() == {place: expected[place] for place in run.values()}
    assert left_running(place.plugins) == []
