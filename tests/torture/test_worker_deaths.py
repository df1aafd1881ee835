"""A plug-in that ends the worker process that asked it costs its own row."""

from collections.abc import Callable

from tests.torture.acts import ALL
from tests.torture.boards import ONE_EPISODE, Run, Workshop, left_running


def test_a_worker_that_was_killed_is_the_fault_of_who_killed_it(
    new_workshop: Callable[..., Workshop], honest_run: tuple[Workshop, Run]
) -> None:
    place = new_workshop(suite=ONE_EPISODE)
    killers, honest = ([place.spec(b, act) for b in ALL] for act in ("kill_worker", "honest"))
    run = place.run([*killers, *honest], jobs=2)
    for killer in killers:
        for reason in run.reasons(killer):
            assert reason is not None
            assert reason.startswith(killer)
            assert "worker" in reason
    assert [run.reasons(entry) for entry in honest] == [[None]] * len(ALL)
    expected = honest_run[1].values()
    assert run.values() == {place: expected[place] for place in run.values()}
    assert left_running(place.plugins) == []
