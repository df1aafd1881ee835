"""Checks of the stamps of scans."""

import pytest

from roadscope.odometry import RESTART, Clock


def ticks(*stamps):
    clock = Clock()
    return [clock.tick(stamp) for stamp in stamps]


def test_steady_stamps_have_no_reason():
    tick_records = ticks(0.05, 0.15, 0.25, 0.45)
    assert [round(t.elapsed_s, 9) for t in tick_records] == [0.0, 0.1, 0.1, 0.2]
    assert not any(t.reason for t in tick_records)


def test_a_dropped_second_is_a_gap():
    assert "no scan for 1.1 s" in ticks(0.0, 0.1, 0.2, 1.3)[-1].reason


def test_one_wrong_stamp_causes_no_further_gaps():
    tick_records = ticks(0.0, 0.1, 0.2, 0.2001, 0.3, 0.4, 0.5)
    assert not any(t.reason for t in tick_records)


def test_one_gap_does_not_hide_the_next():
    tick_records = ticks(0.0, 0.1, 0.2, 1.3, 1.4, 2.5, 2.6)
    assert [bool(t.reason) for t in tick_records] == [False, False, False, True, False, True, False]


def test_repeated_and_backward_stamps_take_no_time():
    tick_records = ticks(0.0, 0.1, 0.1, 0.05, 0.2)
    assert [t.in_order for t in tick_records] == [True, True, False, False, True]
    assert [t.elapsed_s for t in tick_records[2:4]] == [0.0, 0.0]
    assert tick_records[-1].elapsed_s == 0.2 - 0.1


@pytest.mark.parametrize("wrong", [RESTART, RESTART + 1, RESTART + 4])
def test_a_few_wrong_stamps_lose_no_time(wrong):
    """Stamps before a reset of the clock is accepted have no elapsed time; it is added later."""
    right = [0.1 * k for k in range(20 + wrong + 3)]
    stamps = [s - 2.0 if 20 <= k < 20 + wrong else s for k, s in enumerate(right)]
    tick_records = ticks(*stamps)
    assert sum(t.elapsed_s for t in tick_records) == pytest.approx(right[-1])
    assert "again where it was" in tick_records[20 + wrong].reason
    assert not any(t.reason for t in tick_records[20 + wrong + 1 :])


@pytest.mark.parametrize("back_s", [1.0, 4.0])
def test_a_gap_after_a_reset_of_the_clock_is_a_gap(back_s):
    right = [0.1 * k for k in range(60)]
    stamps = [s if k < 20 else s - back_s for k, s in enumerate(right)]
    tick_records = ticks(*stamps, stamps[-1] + 3.0, stamps[-1] + 5.0)
    assert [t.elapsed_s for t in tick_records[-2:]] == pytest.approx([3.0, 2.0])
    assert "no scan for 3 s" in tick_records[-2].reason


def test_a_reset_clock_is_accepted():
    tick_records = ticks(100.0, 100.1, *(0.1 * k for k in range(RESTART + 2)))
    assert not any(t.in_order for t in tick_records[2 : 2 + RESTART])
    assert all(t.in_order for t in tick_records[2 + RESTART :])


def test_a_stamp_that_is_not_finite_is_out_of_order():
    tick_records = ticks(0.0, float("nan"), 0.1)
    assert [t.in_order for t in tick_records] == [True, False, True]
