"""A plug-in that ends the worker process that asked it costs its own row."""

from collections.abc import Callable

from tests.torture.boards import Run, Workshop, left_running


def test_a_worker_that_was_killed_is_the_fault_of_who_killed_it(
    new_workshop: Callable[..., Workshop], honest_run: tuple[Workshop, Run]
) -> None:
    board, place = "tracking", new_workshop()
    killer, honest = place.spec(board, "kill_worker"), place.spec(board, "honest")
    run = place.run([killer, honest], jobs=2, boards=[board])
    for reason in run.reasons(killer):
        assert reason is not None
        assert reason.startswith(killer)
        assert "worker" in reason
    assert run.reasons(honest) == [None, None]
    others = honest_run[1].values()
    assert run.values() == {k: v for k, v in others.items() if k.startswith(board)}
    assert left_running(place.plugins) == []
