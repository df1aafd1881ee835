import re

import pytest

from roadscope.commands import terminal


@pytest.fixture
def clock(monkeypatch):
    """A clock that only goes on when told, in seconds."""
    now = [100.0]
    monkeypatch.setattr(terminal, "monotonic", lambda: now[0])
    return now


def steps_logged(text, stage):
    return [int(step) for step in re.findall(rf"^{stage} (\d+)/\d+", text, re.MULTILINE)]


def test_a_pipe_gets_a_line_every_ten_seconds_and_at_the_end_of_a_stage(clock, capsys):
    with terminal.progress_bars() as tell:
        for done in range(11):
            tell("episodes", done, 10)
            clock[0] += 4.0
        tell("scores", 0, 2)
        tell("scores", 2, 2)
    written = capsys.readouterr()
    assert written.out == ""
    assert steps_logged(written.err, "episodes") == [0, 3, 6, 9, 10]
    assert steps_logged(written.err, "scores") == [0, 2]
    assert "\x1b" not in written.err
    assert "\r" not in written.err


def test_quiet_is_quiet(clock, capsys):
    with terminal.progress_bars(quiet=True) as tell:
        for done in range(11):
            tell("episodes", done, 10)
            clock[0] += 30.0
    assert capsys.readouterr() == ("", "")
