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


def stems(scans: ScanFolder) -> list[str]:
    return [path.name.removesuffix(".npy") for path in scans.files]


def test_decimal_names_are_ordered_as_numbers(tmp_path):
    names = ["1700000000.25", "1700000000.3", "1700000000.351", "1700000000.4"]
    scans = ScanFolder.find(folder_of(tmp_path, names))
    assert stems(scans) == names
    assert "read as decimal numbers: 1700000000.25 comes before 1700000000.3" in scans.notes[0]
    assert scans.stamps_s == pytest.approx([float(name) for name in names])
    assert "names are taken for stamps in s" in " ".join(scans.notes)


@pytest.mark.parametrize("form", ["lidar_{}", "{}_top", "a1-{}"])
def test_decimals_in_names_are_ordered_as_numbers(tmp_path, form):
    stamps = [round(1700000000 + 0.1 * k + 0.003 * (k % 7), 3) for k in range(30)]
    scans = ScanFolder.find(folder_of(tmp_path, [form.format(stamp) for stamp in stamps]))
    assert stems(scans) == [form.format(stamp) for stamp in stamps]
    assert scans.stamps_s == pytest.approx(stamps)
    assert "the names of scans are read as decimal numbers" in scans.notes[0]


@pytest.mark.parametrize("form", ["{}", "scan_{}"])
def test_a_minus_in_front_is_a_sign_if_some_names_have_none(tmp_path, form):
    scans = ScanFolder.find(folder_of(tmp_path, [form.format(k) for k in range(-3, 27)]))
    assert stems(scans) == [form.format(k) for k in range(-3, 27)]
    assert scans.stamps_s == pytest.approx([0.1 * k for k in range(30)])
    others = tmp_path / "others"
    others.mkdir()
    scans = ScanFolder.find(folder_of(others, [f"scan_-{k}" for k in range(12)]))
    assert stems(scans) == [f"scan_-{k}" for k in range(12)]


HOLE = [k for k in range(30) if not 14 <= k <= 17]


@pytest.mark.parametrize(
    "name",
    [
        lambda ms: f"{ms / 1000:.2f}",
        lambda ms: f"{17 * 10**8 + ms // 1000}_{ms % 1000 * 10**6:09d}",
        lambda ms: f"{17 * 10**8 + ms // 1000}-{ms % 1000:03d}",
        lambda ms: f"lidar_{17 * 10**8 + ms / 1000:.3f}",
        lambda ms: f"2024-01-05_23-59-{57 + ms // 1000:02d}-{ms % 1000:03d}",
        lambda ms: (
            f"20240105235957.{ms % 1000:03d}"
            if ms < 1000
            else f"2024010523595{7 + ms // 1000}.{ms % 1000:03d}"
        ),
        lambda ms: f"{ms // 100:06d}_{17 * 10**8 + ms / 1000:.3f}",
    ],
)
def test_gaps_are_found_in_stamps_of_all_forms(tmp_path, name):
    times_ms = [50 + 100 * k for k in HOLE if k < 29]
    scans = ScanFolder.find(folder_of(tmp_path, [name(ms) for ms in times_ms]))
    assert stems(scans) == [name(ms) for ms in times_ms]
    assert np.subtract(scans.stamps_s, scans.stamps_s[0]) == pytest.approx(
        [(ms - 50) / 1000 for ms in times_ms], abs=1e-5
    )
    assert any("scans are up to 0.5 s apart, after" in note for note in scans.notes)
    assert scans.measured


@pytest.mark.parametrize(
    "name",
    [
        lambda k: f"cloud{k:04d}_{3 * k + 1:05d}",
        lambda k: f"{100 * k + 50 + k % 3:06d}",
        lambda k: f"2024-01-05_12-00-00_{k:06d}",
    ],
)
def test_gaps_are_found_in_counters_of_all_forms(tmp_path, name):
    scans = ScanFolder.find(folder_of(tmp_path, [name(k) for k in HOLE]))
    assert scans.stamps_s == pytest.approx([0.1 * k for k in HOLE], abs=0.01)
    assert any("4 numbers are missing in the names of scans" in note for note in scans.notes)


def test_numbers_that_several_scans_share_are_not_used_and_a_note_says_so(tmp_path):
    names = [f"{drive:02d}_{k:06d}" for drive in (1, 2) for k in range(5)]
    scans = ScanFolder.find(folder_of(tmp_path, names))
    assert stems(scans) == names
    assert scans.stamps_s == pytest.approx([0.1 * k for k in range(10)])
    assert "not used: no number tells all of them apart" in scans.notes[0]
    np.save(tmp_path / "01_000003 (1).npy", POINTS)
    assert "they are of 2 forms, such as" in ScanFolder.find(tmp_path).notes[0]


def test_numbers_pick_lines_of_stamps_where_scans_are_missing(tmp_path):
    """KITTI's raw drive 2011_09_26_drive_0009 lacks four scans, and no line of timestamps.txt."""
    folder_of(tmp_path, [f"{k:010d}" for k in HOLE])
    lines = [f"2011-09-26 13:02:{25 + k // 10}.{k % 10}00000000\n" for k in range(30)]
    (tmp_path / "timestamps.txt").write_text("".join(lines))
    scans = ScanFolder.find(tmp_path)
    assert np.subtract(scans.stamps_s, scans.stamps_s[0]) == pytest.approx([k / 10 for k in HOLE])
    notes = " ".join(scans.notes)
    assert "scans are up to 0.5 s apart, after 0000000013.npy" in notes
    assert "30 lines for 26 scans: the number in the name of a scan says which line" in notes
    (tmp_path / "timestamps.txt").write_text("".join(lines[:28]))
    with pytest.raises(FormatError, match="or one for each number in their names, 0 to 29, got 28"):
        ScanFolder.find(tmp_path)


def test_stamps_without_the_gap_that_names_have_are_reported(tmp_path):
    folder_of(tmp_path, [f"{k:06d}" for k in HOLE], [0.1 * k for k in range(26)])
    assert any(
        "4 numbers are missing" in note and "where times.txt has no hole" in note
        for note in ScanFolder.find(tmp_path).notes
    )


def test_seconds_and_nanoseconds_without_zeros_are_recognized_by_even_steps(tmp_path):
    """0.9 s, 1 s and 50 ms, 1 s and 200 ms, ...: as decimals they would jump about."""
    stamps_ns = [900_000_000 + 150_000_000 * k for k in range(8)]
    names = [f"{ns // 10**9}.{ns % 10**9}" for ns in stamps_ns]
    scans = ScanFolder.find(folder_of(tmp_path, names))
    assert stems(scans) == names
    assert "seconds.nanoseconds" in scans.notes[0]


@given(st.permutations(range(12)), st.integers(0, 10**6))
def test_whole_numbers_count_scans_whatever_the_order_of_the_files(order, first):
    from roadscope.benchmarks.formats import in_order

    files = [Path(f"frame_{first + k}_lidar.npy") for k in order]
    ordered_files = in_order(files, (".npy",))
    assert [path.name for path in ordered_files.files] == [
        f"frame_{first + k}_lidar.npy" for k in range(12)
    ]
    assert ordered_files.numbers.tolist() == [first + k for k in range(12)]


def test_missing_numbers_are_gaps_in_time_and_reported(tmp_path):
    names = [f"{k:06d}" for k in range(30) if not 14 <= k <= 17]
    scans = ScanFolder.find(folder_of(tmp_path, names), rate_hz=20)
    assert scans.stamps_s == pytest.approx([int(name) / 20 for name in names])
    assert "4 numbers are missing in the names of scans, after 000013.npy" in scans.notes


def test_every_fifth_scan_counts_as_the_next(tmp_path):
    scans = ScanFolder.find(folder_of(tmp_path, [f"{5 * k:06d}" for k in range(6)]))
    assert scans.stamps_s == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert not any("missing" in note for note in scans.notes)


def test_names_in_microseconds_are_stamps(tmp_path):
    names = [f"n015__LIDAR_TOP__{1531883530449377 + 50_000 * k}" for k in range(5)]
    scans = ScanFolder.find(folder_of(tmp_path, names))
    assert np.diff(scans.stamps_s) == pytest.approx([0.05] * 4, abs=1e-6)
    assert scans.stamps_s[0] == pytest.approx(1531883530.449377)


def test_uneven_numbers_are_not_used_and_a_note_says_so(tmp_path):
    scans = ScanFolder.find(folder_of(tmp_path, ["0", "4", "5", "7", "20", "24"]))
    assert scans.stamps_s == pytest.approx([0.1 * k for k in range(6)])
    assert "the numbers in their names are uneven: not used" in scans.notes


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.3, 0.2, 0.1, 0.0], "line 2: expected stamps that rise, got '0.2'"),
        ([0.05, 0.15, 1.7e9, 1.7e9 + 0.1], "line 3: expected a stamp without a jump of 1.7e+09 s"),
        ([5e8, 5e8 + 0.1, 0.2, 0.3], "line 3: expected a stamp without a jump of -5e+08 s"),
        ([3600.0, 3600.1, 3600.2, 0.3, 0.4], "line 4: expected a stamp without a jump of -3.6e"),
    ],
)
def test_stamps_that_fall_or_jump_are_refused_by_line(tmp_path, times, message):
    folder_of(tmp_path, "abcde"[: len(times)], times)
    with pytest.raises(FormatError, match=r"times\.txt") as caught:
        ScanFolder.find(tmp_path)
    assert message in str(caught.value)


def test_one_late_stamp_and_gaps_are_reported(tmp_path):
    times = [0.0, 0.1, 0.2, 0.15, 0.4, 0.5, 2.6, 2.7]
    scans = ScanFolder.find(folder_of(tmp_path, "abcdefgh", times))
    assert scans.stamps_s == pytest.approx(times)
    notes = " ".join(scans.notes)
    assert "times.txt: 1 stamp does not rise, the first in line 4" in notes
    assert "scans are up to 2.1 s apart, after d.npy, f.npy" in notes


def test_hidden_files_are_no_scans(tmp_path):
    folder_of(tmp_path, ["0", "1", "2"])
    for k in range(3):
        (tmp_path / f"._{k}.npy").write_bytes(bytes([0, 5, 22, 7]) * 1024)
    assert stems(ScanFolder.find(tmp_path)) == ["0", "1", "2"]


def test_a_file_in_place_of_a_folder_is_reported(tmp_path):
    folder_of(tmp_path, ["0"])
    with pytest.raises(FormatError, match=r"0\.npy: a file; expected a folder"):
        ScanFolder.find(tmp_path / "0.npy")
