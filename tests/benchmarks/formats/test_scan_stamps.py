"""Order and stamps of scans: by the numbers in their names, or by a file that is checked."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope.formats import FormatError, ScanFolder

POINTS = np.random.default_rng(0).uniform(1, 30, (40, 4))


def folder_of(folder: Path, names, times=None) -> Path:
    for name in names:
        np.save(folder / f"{name}.npy", POINTS)
    if times is not None:
        (folder / "times.txt").write_text("".join(f"{t}\n" for t in times))
    return folder


def stems(found: ScanFolder) -> list[str]:
    return [path.name.removesuffix(".npy") for path in found.files]


def test_decimal_names_are_ordered_as_numbers(tmp_path):
    names = ["1700000000.25", "1700000000.3", "1700000000.351", "1700000000.4"]
    found = ScanFolder.find(folder_of(tmp_path, names))
    assert stems(found) == names
    assert "read as decimal numbers: 1700000000.351 comes before 1700000000.4" in found.notes[0]
    assert found.stamps_s == pytest.approx([float(name) for name in names])
    assert "names are taken for stamps in s" in " ".join(found.notes)


def test_seconds_and_nanoseconds_without_zeros_are_told_by_even_steps(tmp_path):
    """0.9 s, 1 s and 50 ms, 1 s and 200 ms, ...: as decimals they would jump about."""
    stamps_ns = [900_000_000 + 150_000_000 * k for k in range(8)]
    names = [f"{ns // 10**9}.{ns % 10**9}" for ns in stamps_ns]
    found = ScanFolder.find(folder_of(tmp_path, names))
    assert stems(found) == names
    assert "seconds.nanoseconds" in found.notes[0]


@given(st.permutations(range(12)), st.integers(0, 10**6))
def test_whole_numbers_count_scans_whatever_the_order_of_the_files(order, first):
    from roadscope.benchmarks.formats import in_order

    files = [Path(f"frame_{first + k}_lidar.npy") for k in order]
    found = in_order(files, (".npy",))
    assert [path.name for path in found.files] == [
        f"frame_{first + k}_lidar.npy" for k in range(12)
    ]
    assert found.numbers.tolist() == [first + k for k in range(12)]


def test_missing_numbers_are_holes_in_time_and_told(tmp_path):
    names = [f"{k:06d}" for k in range(30) if not 14 <= k <= 17]
    found = ScanFolder.find(folder_of(tmp_path, names), rate_hz=20)
    assert found.stamps_s == pytest.approx([int(name) / 20 for name in names])
    assert "4 numbers are missing in the names of scans, after 000013.npy" in found.notes


def test_every_fifth_scan_counts_as_the_next(tmp_path):
    found = ScanFolder.find(folder_of(tmp_path, [f"{5 * k:06d}" for k in range(6)]))
    assert found.stamps_s == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert not any("missing" in note for note in found.notes)


def test_names_in_microseconds_are_stamps(tmp_path):
    names = [f"n015__LIDAR_TOP__{1531883530449377 + 50_000 * k}" for k in range(5)]
    found = ScanFolder.find(folder_of(tmp_path, names))
    assert np.diff(found.stamps_s) == pytest.approx([0.05] * 4, abs=1e-6)
    assert found.stamps_s[0] == pytest.approx(1531883530.449377)


def test_uneven_numbers_are_not_used_and_that_is_told(tmp_path):
    found = ScanFolder.find(folder_of(tmp_path, ["0", "4", "5", "7", "20", "24"]))
    assert found.stamps_s == pytest.approx([0.1 * k for k in range(6)])
    assert "the numbers in their names are uneven: not used" in found.notes


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.3, 0.2, 0.1, 0.0], "line 2: expected stamps that rise, got '0.2'"),
        ([0.05, 0.15, 1.7e9, 1.7e9 + 0.1], "line 3: expected a stamp without a jump of 1.7e+09 s"),
        ([5e8, 5e8 + 0.1, 0.2, 0.3], "line 3: expected a stamp without a jump of -5e+08 s"),
    ],
)
def test_stamps_that_fall_or_jump_are_refused_by_line(tmp_path, times, message):
    folder_of(tmp_path, "abcd", times)
    with pytest.raises(FormatError, match=r"times\.txt") as caught:
        ScanFolder.find(tmp_path)
    assert message in str(caught.value)


def test_one_late_stamp_and_holes_are_told(tmp_path):
    times = [0.0, 0.1, 0.2, 0.15, 0.4, 0.5, 2.6, 2.7]
    found = ScanFolder.find(folder_of(tmp_path, "abcdefgh", times))
    assert found.stamps_s == pytest.approx(times)
    notes = " ".join(found.notes)
    assert "times.txt: 1 stamps do not rise, the first in line 4" in notes
    assert "scans are up to 2.1 s apart, after d.npy, f.npy" in notes


def test_hidden_files_are_no_scans(tmp_path):
    folder_of(tmp_path, ["0", "1", "2"])
    for k in range(3):
        (tmp_path / f"._{k}.npy").write_bytes(bytes([0, 5, 22, 7]) * 1024)
    assert stems(ScanFolder.find(tmp_path)) == ["0", "1", "2"]


def test_a_file_in_place_of_a_folder_is_told(tmp_path):
    folder_of(tmp_path, ["0"])
    with pytest.raises(FormatError, match=r"0\.npy: a file; expected a folder"):
        ScanFolder.find(tmp_path / "0.npy")
