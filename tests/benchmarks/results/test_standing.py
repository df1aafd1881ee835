from dataclasses import replace

import numpy as np
import pytest

from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.metrics import ratio
from roadscope.benchmarks.results import EntryResult, JobScores, standings

SEEDS = 12
HARDNESS = np.random.default_rng(0).uniform(0.2, 0.9, SEEDS)


def job(entry: str, seed: int, scores) -> JobScores:
    return JobScores("detection", entry, "motorway", seed, "clear", "", scores)


def record(entry: str, hits, *, mark: str | None = None, failed: int = 0) -> EntryResult:
    sound = tuple(job(entry, seed, {"f1": ratio(float(h), 1000)}) for seed, h in enumerate(hits))
    reason = None if sound else f"{entry}: KeyError"
    board = board_named("detection")
    return EntryResult(board, entry, mark, sound, len(sound) + failed, reason)


def noisy(shift: float, seed: int) -> np.ndarray:
    return 1000 * HARDNESS + shift + np.random.default_rng(seed).normal(0, 5, SEEDS)


def test_what_is_hard_for_all_does_not_blur_ranks() -> None:
    """Episodes differ by hundreds, entries by tens: only a paired comparison tells them apart."""
    a, b, c = standings(
        [record("b", noisy(-30, 1)), record("a", noisy(0, 2)), record("c", noisy(-31, 3))]
    )
    assert (a.entry, a.rank, a.rank_low, a.rank_high) == ("a", 1, 1, 1)
    assert {(b.rank_low, b.rank_high), (c.rank_low, c.rank_high)} == {(2, 3)}
    assert (a.behind, a.behind_low, a.behind_high) == (0.0, 0.0, 0.0)
    assert b.behind == pytest.approx(0.03, abs=0.006)
    assert 0 < b.behind_low < b.behind < b.behind_high


def test_marks_come_last_and_have_no_rank() -> None:
    places = standings(
        [
            record("oracle", [1000] * SEEDS, mark="upper mark"),
            record("all", [0] * SEEDS, mark="lower mark"),
            record("mine", noisy(0, 1)),
        ]
    )
    assert [(s.entry, s.rank) for s in places] == [("mine", 1), ("oracle", None), ("all", None)]
    assert (places[0].rank_low, places[0].rank_high) == (1, 1)


def test_an_entry_that_fails_comes_after_all_others_and_has_no_rival() -> None:
    good, bad, none = standings(
        [
            record("bad", noisy(50, 1)[:5], failed=SEEDS - 5),
            record("good", noisy(0, 2)),
            record("none", [], failed=SEEDS),
        ]
    )
    assert [s.entry for s in (good, bad, none)] == ["good", "bad", "none"]
    assert (good.rank_low, good.rank_high) == (1, 1)
    assert bad.rank == 2
    assert bad.rank_low is None
    assert bad.behind == pytest.approx(-0.05, abs=0.006)
    assert none.behind is None
    assert (none.rank, none.reason, none.place) == (None, "none: KeyError", "failed")
    assert good.reason is bad.reason is None


def test_an_entry_that_fails_everywhere_is_last_whatever_its_name_and_has_no_figures() -> None:
    nothing = replace(record("b", [0]), sound=(job("b", 0, {}),))
    places = standings([record("a", [], failed=2), replace(nothing, episodes=2)])
    assert [(place.entry, place.rank) for place in places] == [("b", 1), ("a", None)]


def test_one_seed_decides_nothing_about_ranks() -> None:
    best, other = standings([record("a", [600]), record("b", [400])])
    assert (best.rank, best.rank_low, best.rank_high) == (1, None, None)
    assert other.behind == pytest.approx(0.2)
    assert other.behind_low is None


def test_one_entry_and_no_entry() -> None:
    assert standings([]) == []
    (only,) = standings([record("a", noisy(0, 1))])
    assert (only.rank, only.rank_low, only.rank_high) == (1, 1, 1)


@pytest.mark.slow
def test_true_ranks_lie_within_their_intervals() -> None:
    """Entries 1 to 5 are truly apart by less than the noise: 95 % each, over 60 draws."""
    truth, inside, certain = np.array([0.0, -4.0, -8.0, -12.0, -60.0]), 0, 0
    for draw in range(60):
        entries = [record(str(i), noisy(s, 10 * draw + i)) for i, s in enumerate(truth)]
        for place in standings(entries):
            inside += place.rank_low <= 1 + int(place.entry) <= place.rank_high
            certain += place.rank_low == place.rank_high
    assert inside / 300 > 0.93
    assert certain / 300 > 0.2
