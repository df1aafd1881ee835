import re
import time

import pytest

from roadscope.commands import headline, progress_bars


class ManualClock:
    """A clock that only advances by hand."""

    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return ManualClock()


@pytest.fixture
def keep_kernels(tmp_path, monkeypatch):
    """Return a function that keeps so many pieces of machine code in all; 7 are kept already."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    def keep(count):
        for number in range(count):
            (tmp_path / f"kernel.{number}.nbc").touch()

    keep(7)
    return keep


def steps_logged(text, stage):
    return [int(step) for step in re.findall(rf"^{stage} (\d+)/\d+", text, re.MULTILINE)]


def test_a_pipe_gets_lines_and_one_at_the_end_of_a_stage(clock, keep_kernels, capsys):
    with progress_bars(clock=clock) as tell:
        for done in range(11):
            tell("episodes", done, 10)
            clock.now_s += 1.0
        tell("scores", 0, 2)
        tell("scores", 2, 2)
    written = capsys.readouterr()
    assert written.out == ""
    assert steps_logged(written.err, "episodes") == [0, 2, 4, 6, 8, 10]
    assert steps_logged(written.err, "scores") == [0, 2]
    assert "kernels" not in written.err
    assert "\x1b" not in written.err
    assert "\r" not in written.err


def test_lines_are_fewer_after_a_minute(clock, keep_kernels, capsys):
    with progress_bars(clock=clock) as tell:
        for done in range(0, 31):
            tell("episodes", done, 100)
            clock.now_s += 4.0
    late = [step for step in steps_logged(capsys.readouterr().err, "episodes") if step > 15]
    assert late == [17, 20, 23, 26, 29]


def test_a_pipe_gets_lines_while_a_stage_compiles_its_kernels(clock, keep_kernels, capsys):
    with progress_bars(clock=clock) as tell:
        tell("episodes", 1, 10)
        for new in (3, 5):
            keep_kernels(7 + new)
            clock.now_s += 2.0
            written = []
            for _ in range(100):
                written += capsys.readouterr().err.splitlines()
                if written:
                    break
                time.sleep(0.1)
            tell("episodes", 1, 10)
    lines = [*written, *capsys.readouterr().err.splitlines()]
    assert lines[-1] == "episodes 1/10, 4 s; compiling kernels, once per installation, 5 so far"


def test_quiet_is_quiet(clock, capsys):
    with progress_bars(quiet=True, clock=clock) as tell:
        for done in range(11):
            tell("episodes", done, 10)
            clock.now_s += 30.0
    assert capsys.readouterr() == ("", "")


def test_a_headline_is_one_line_without_control_characters(capsys):
    headline("odometry \x1b[31mred\nnext.py:Mine")
    assert capsys.readouterr().out == "odometry ?[31mred next.py:Mine\n"
