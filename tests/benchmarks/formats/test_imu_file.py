"""Files of inertial samples."""

from itertools import combinations

import numpy as np
import pytest

from roadscope.benchmarks.formats import find_imu, parse_mounting, rising_rows
from roadscope.formats import FormatError, read_imu

ROWS = np.column_stack([10 + 0.0025 * np.arange(5), np.tile([0.1, 0.2, 0.3, 1, 2, 9.8], (5, 1))])


def written(path, rows=ROWS, head="", separator=" ", stamps="%.9f"):
    np.savetxt(path, rows, [stamps] + ["%.9g"] * 6, separator, header=head, comments="")
    return path


def test_numbers_pick_lines_of_stamps_where_files_of_a_raw_drive_are_missing(tmp_path):
    (tmp_path / "data").mkdir()
    numbers = [k for k in range(40) if not 14 <= k <= 17]
    for k in numbers:
        row = 0.001 * np.arange(25)
        row[11:14], row[17:20] = (0, 0, 9.8), (0, 0, 0.01 * k)
        np.savetxt(tmp_path / "data" / f"{k:010d}.txt", row[None])
    lines = [f"2011-09-26 13:02:{k // 10:02d}.{k % 10}00000000\n" for k in range(40)]
    (tmp_path / "timestamps.txt").write_text("".join(lines))
    samples, left_out = read_imu(tmp_path)
    assert not left_out
    assert samples.stamps_s - samples.stamps_s[0] == pytest.approx(
        0.1 * np.array(numbers), abs=1e-6
    )
    assert samples.angular_velocity[:, 2] == pytest.approx(0.01 * np.array(numbers))


@pytest.mark.parametrize(
    ("head", "separator"),
    [
        ("", " "),
        ("", ","),
        ("stamp,wx,wy,wz,ax,ay,az", ","),
        ("# s rad/s m/s^2", " "),
        ("stamp wx wy wz ax ay az\n# s rad/s, m/s^2", " "),
        ("# s, rad/s, m/s^2\nstamp,wx,wy,wz,ax,ay,az", ","),
        ('"stamp","wx","wy","wz","ax","ay","az"', ","),
        ("%time,field.x,field.y,field.z,field.ax,field.ay,field.az", ","),
    ],
)
def test_samples_are_read(tmp_path, head, separator):
    path = written(tmp_path / "imu.csv", head=head, separator=separator)
    samples, left_out = read_imu(str(path))
    assert not left_out
    assert samples.stamps_s == pytest.approx(ROWS[:, 0])
    assert samples.angular_velocity == pytest.approx(ROWS[:, 1:4])
    assert samples.specific_force == pytest.approx(ROWS[:, 4:])


def test_nanoseconds_are_known(tmp_path):
    rows = ROWS * [1e9, 1, 1, 1, 1, 1, 1]
    samples, _ = read_imu(written(tmp_path / "i", rows, stamps="%.0f"))
    assert samples.stamps_s == pytest.approx(ROWS[:, 0])


MANY = np.column_stack([0.0025 * np.arange(400), np.tile(ROWS[0, 1:], (400, 1))])


@pytest.mark.parametrize(("row", "stamp"), [(5, 1e6), (200, -3.0), (200, MANY[199, 0])])
def test_a_line_out_of_order_costs_no_other(tmp_path, row, stamp):
    rows = MANY.copy()
    rows[row, 0], rows[30, 2] = stamp, np.inf
    samples, left_out = read_imu(written(tmp_path / "imu.csv", rows))
    assert left_out == 2
    assert samples.stamps_s == pytest.approx(np.delete(MANY[:, 0], [30, row]))


def test_the_first_line_may_be_none_of_names(tmp_path):
    rows = MANY.copy()
    rows[[0, 7], 0] = np.nan
    samples, left_out = read_imu(written(tmp_path / "imu.csv", rows))
    assert (len(samples.stamps_s), left_out) == (398, 2)
    _, left_out = read_imu(written(tmp_path / "imu.csv", rows, head="n wx wy wz ax ay az"))
    assert left_out == 2


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        (np.vstack([MANY[:50], MANY[:20], MANY[10:40]]), 51),
        (MANY - 0.5 * np.eye(1, 7) * (np.arange(400) >= 200)[:, None], 201),
        (np.column_stack([MANY[:, 0].round(2), MANY[:, 1:]]), 2),
    ],
)
def test_a_file_in_disorder_is_refused(tmp_path, rows, line):
    """Parts joined askew, a clock that was set back, stamps that were rounded."""
    path = written(tmp_path / "imu.csv", rows)
    with pytest.raises(
        FormatError, match=f"line {line}: expected a stamp above the stamp of .*, got"
    ):
        read_imu(path)


def test_the_longest_rising_subsequence_of_rows_remains():
    """Beside every subset of a few rows."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        stamps = rng.integers(0, 8, rng.integers(1, 9)).astype(float)
        row_indices = rising_rows(stamps)
        assert (np.diff(stamps[row_indices]) > 0).all()
        chains = (
            subset
            for size in range(1, len(stamps) + 1)
            for subset in combinations(stamps.tolist(), size)
            if (np.diff(subset) > 0).all()
        )
        assert len(row_indices) == max(map(len, chains))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (ROWS[:1], "expected two or more lines of stamp wx .*, got 1"),
        (ROWS * [1e6, 1, 1, 1, 1, 1, 1], "in seconds .* or in nanoseconds .*, got steps of 2500"),
        (ROWS / [1, 1, 1, 1, 10, 10, 10], r"9.8 at rest, got a median of 1.01; they may be in g"),
        (ROWS - [0, 0, 0, 0, 0, 0, 9.8], "got a median of .*; .*gravity may be subtracted"),
        (ROWS + 20 * np.eye(1, 7, 1), r"in rad/s, up to 6, got up to 20.1; they may be in degrees"),
        (np.where(ROWS == 0.2, np.nan, ROWS), "expected two or more lines of stamp wx .*, got 0"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, rows, message):
    path = written(tmp_path / "imu.txt", rows)
    with pytest.raises(FormatError, match=message):
        read_imu(path)


def test_too_few_columns_are_named(tmp_path):
    path = tmp_path / "imu.txt"
    path.write_text("1 2 3\n")
    with pytest.raises(FormatError, match=r"imu.txt, line 1: expected 7 columns \(stamp wx"):
        read_imu(path)


def test_the_file_lies_in_the_folder_or_beside_it(tmp_path):
    scans = tmp_path / "scans"
    scans.mkdir()
    assert find_imu(scans) is None
    beside = written(tmp_path / "imu.txt")
    assert find_imu(scans) == beside
    inside = written(scans / "imu.csv")
    assert find_imu(scans) == inside


def test_a_mounting_is_metres_and_degrees():
    pose = parse_mounting("1, 2,3 0 0 90")
    assert pose.apply(np.array([[1.0, 0, 0]])) == pytest.approx(np.array([[1.0, 3, 3]]))
    with pytest.raises(FormatError, match=r"expected a mounting x,y,z,roll,pitch,yaw.*'1,2,x'"):
        parse_mounting("1,2,x")
