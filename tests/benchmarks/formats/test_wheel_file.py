"""Files of wheel speeds."""

import pytest

from roadscope.benchmarks.formats import find_wheels
from roadscope.formats import FormatError, read_wheels


@pytest.mark.parametrize(
    "text",
    ["10 7.5\n10.02 -7\n", "stamp,speed\n10,7.5\n10.02,-7\n", "10000000000 7.5\n10020000000 -7\n"],
)
def test_speeds_are_read(tmp_path, text):
    (tmp_path / "wheels.csv").write_text(text)
    wheels, left_out = read_wheels(find_wheels(tmp_path))
    assert not left_out
    assert wheels.stamps_s == pytest.approx([10, 10.02])
    assert wheels.speeds == pytest.approx([7.5, -7])


def test_the_file_lies_in_the_folder_or_beside_it(tmp_path):
    scans = tmp_path / "scans"
    scans.mkdir()
    assert find_wheels(scans) is None
    (tmp_path / "wheels.txt").write_text("0 1\n")
    assert find_wheels(scans) == tmp_path / "wheels.txt"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 1\n", "expected two or more lines of stamp speed, got 1"),
        ("0 1 2\n1 2 3\n", "line 1: expected 2 columns"),
        ("0 1\n0.02 nan\n", "expected two or more lines of stamp speed, got 1"),
        ("0 1\n0.02 x\n", "line 2: expected speed as a number, got 'x'"),
        ("0 100\n0.02 101\n", "in m/s, up to 90, got up to 101.0; they may be in km/h"),
        ("0 1\n20 1\n", "stamps in seconds .* or in nanoseconds .*, got steps of 20"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, text, message):
    (tmp_path / "wheels.txt").write_text(text)
    with pytest.raises(FormatError, match=message):
        read_wheels(tmp_path / "wheels.txt")
