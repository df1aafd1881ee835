import pytest

from roadscope.commands import terminal


@pytest.fixture
def clock(monkeypatch):
    """A clock that goes by what is told of it, in seconds."""
    now = [100.0]
    monkeypatch.setattr(terminal, "monotonic", lambda: now[0])
    return now


def test_a_log_gets_a_line_a_minute_of_how_far_a_stage_is(clock, capsys):
    with terminal.progress_bars() as tell:
        for done in range(10):
            tell("episodes", done, 10)
            clock[0] += 25.0
        lines = capsys.readouterr().err.splitlines()
    assert lines == ["episodes 3/10, 75 s", "episodes 6/10, 150 s", "episodes 9/10, 225 s"]


def test_what_is_soon_done_leaves_its_bars_alone(clock, capsys):
    with terminal.progress_bars() as tell:
        tell("episodes", 1, 2)
        assert capsys.readouterr().err == ""
    assert "episodes" in capsys.readouterr().err
