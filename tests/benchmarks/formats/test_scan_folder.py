"""Scans from files: all kinds bring the same points, malformed ones are refused."""

import re

import numpy as np
import pytest

from roadscope.formats import FormatError, ScanFolder, read_pcd, read_scan

ROWS = np.random.default_rng(0).uniform(1, 30, (40, 5)).astype(np.float32)
ROWS[:, 3] /= 30
ROWS[:, 4] = np.linspace(0.0, 0.1, 40)


def pcd(data, rows=ROWS, fields="x y z intensity t", size="4 4 4 4 4", kind="F F F F F"):
    head = (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {size}\nTYPE {kind}\nCOUNT 1 1 1 1 1\n"
        f"WIDTH {len(rows)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(rows)}\nDATA {data}\n"
    ).encode()
    if data == "binary":
        return head + rows.astype("<f4").tobytes()
    return head + "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in rows).encode()


def write(folder, kind):
    if kind == "bin":
        ROWS[:, :4].tofile(folder / "7.bin")
        return folder / "7.bin"
    if kind == "npy":
        np.save(folder / "7.npy", ROWS)
        return folder / "7.npy"
    (folder / "7.pcd").write_bytes(pcd(kind))
    return folder / "7.pcd"


@pytest.mark.parametrize("kind", ["bin", "npy", "ascii", "binary"])
def test_all_kinds_bring_the_same_points(tmp_path, kind):
    scan = read_scan(write(tmp_path, kind), 0.5)
    assert np.array_equal(scan.points, ROWS[:, :3])
    assert scan.intensity == pytest.approx(ROWS[:, 3], abs=1e-6)
    times = np.zeros(40) if kind == "bin" else ROWS[:, 4] - 0.05
    assert scan.time_offset_s == pytest.approx(times, abs=1e-6)
    assert scan.stamp_s == 0.5
    assert scan.ring.max() > 0


@pytest.mark.parametrize("upwards", [True, False])
def test_beams_are_those_of_the_file_in_either_order_of_numbers(tmp_path, upwards):
    beams = np.repeat([0, 1, 2, 4], 10)
    ways = np.linspace(0, 6, 40)
    tilt = np.deg2rad([-9.0, -3.1, -3.0, 2.0, 4.0])[beams]
    rows = ROWS.copy()
    rows[:, :3] = 10 * np.column_stack([np.cos(ways), np.sin(ways), np.tan(tilt)])
    rows[:, 4] = beams if upwards else 40 - beams
    (tmp_path / "0.pcd").write_bytes(pcd("binary", rows, fields="x y z intensity ring"))
    assert np.array_equal(read_scan(tmp_path / "0.pcd", 0.0).ring, beams)
    rows[:, 4] = np.array([7, 3, 9, 0, 5])[beams]
    (tmp_path / "0.pcd").write_bytes(pcd("binary", rows, fields="x y z intensity ring"))
    assert np.array_equal(read_scan(tmp_path / "0.pcd", 0.0).ring, np.repeat(np.arange(4), 10))


@pytest.mark.parametrize("unit", [1, 1e3, 1e6, 1e9])
def test_times_may_be_in_any_unit_and_begin_anywhere(tmp_path, unit):
    rows = ROWS.astype(float)
    rows[:, 4] = (rows[:, 4] + 3.0) * unit
    (tmp_path / "0.pcd").write_bytes(pcd("ascii", rows))
    scan = read_scan(tmp_path / "0.pcd", 0.0)
    assert scan.time_offset_s == pytest.approx(ROWS[:, 4] - 0.05, abs=1e-6)


def test_points_that_are_none_are_left_out(tmp_path):
    rows = ROWS.copy()
    rows[3, 0], rows[5], rows[6, 2] = np.nan, 0, 1e6
    np.save(tmp_path / "0.npy", rows)
    assert len(read_scan(tmp_path / "0.npy", 0.0)) == 37
    np.save(tmp_path / "1.npy", np.empty((0, 4)))
    assert len(read_scan(tmp_path / "1.npy", 0.0)) == 0


def test_folders_are_in_order_of_numbers(tmp_path):
    for k in (10, 9, 0):
        np.save(tmp_path / f"{k}.npy", ROWS[:, :3])
    scans = ScanFolder.find(tmp_path, rate_hz=20)
    assert [p.stem for p in scans.files] == ["0", "9", "10"]
    assert scans.stamps_s == pytest.approx((0, 0.45, 0.5))
    assert "8 numbers are missing in the names of scans, after 0.npy" in scans.notes
    (tmp_path / "times.txt").write_text("1.0\n1.1\n1.25\n")
    assert [s.stamp_s for s in ScanFolder.find(tmp_path)] == [1.0, 1.1, 1.25]
    (tmp_path / "times.txt").write_text("1.0\n")
    with pytest.raises(FormatError, match=r"expected 3 lines, one a scan, .*got 1"):
        ScanFolder.find(tmp_path)


def test_numbers_within_names_count_too(tmp_path):
    for name in ("scan_10_b", "scan_9_b", "scan_9_a", "a", "007", "6"):
        np.save(tmp_path / f"{name}.npy", ROWS[:, :3])
    (tmp_path / "6.npy").rename(tmp_path / "6.NPY")
    names = [p.stem for p in ScanFolder.find(tmp_path).files]
    assert names == ["a", "scan_9_a", "scan_9_b", "scan_10_b", "6", "007"]


@pytest.mark.parametrize("unit", [1, 1000, 1000000, 1000000000])
def test_the_unit_of_stamps_follows_from_the_steps_between_them(tmp_path, unit):
    for k in range(3):
        np.save(tmp_path / f"{k}.npy", ROWS[:, :3])
    stamps = [1700000000.25, 1700000000.375, 1700000000.5]
    (tmp_path / "times.txt").write_text("".join(f"{stamp * unit:.3f}\n" for stamp in stamps))
    assert ScanFolder.find(tmp_path).stamps_s == pytest.approx(stamps, abs=1e-6)


def test_stamps_of_no_known_unit_are_refused(tmp_path):
    for k in range(3):
        np.save(tmp_path / f"{k}.npy", ROWS[:, :3])
    (tmp_path / "times.txt").write_text("0\n7000\n14000\n")
    with pytest.raises(FormatError, match=r"0.01 to 5 s apart, in seconds .* got steps of 7000"):
        ScanFolder.find(tmp_path)


BAD_PCD = {
    "no header": (b"points", "expected a PCD header"),
    "no x": (pcd("ascii", fields="a y z intensity t"), "line 3: expected fields x, y and z"),
    "odd type": (pcd("ascii", kind="F F F F Q"), "line 5: expected TYPE F with SIZE 4 or 8"),
    "few sizes": (pcd("ascii", size="4 4 4 4"), "line 4: expected 5 values, one per field"),
    "odd size": (pcd("ascii", size="4 4 4 4 x"), "line 4: expected a whole number"),
    "another encoding": (pcd("packed"), "line 11: expected DATA ascii, binary, binary_compressed"),
    "no compressed data": (pcd("binary_compressed", ROWS[:0]) + b"abc", "expected 0 compressed"),
    "cut off": (pcd("binary")[:-8], "expected 800 bytes after the header"),
    "lines lost": (pcd("ascii")[:-60], "expected 40 points"),
    "words": (pcd("ascii").replace(pcd("ascii").split(b"\n")[11], b"a b c d e"), "line 12: "),
}


@pytest.mark.parametrize("name", BAD_PCD)
def test_malformed_pcd_is_refused(tmp_path, name):
    content, message = BAD_PCD[name]
    path = tmp_path / "bad.pcd"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=rf"bad\.pcd.*{re.escape(message)}"):
        read_pcd(path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("0.bin", b"\0" * 17, "expected float32 numbers of 4 bytes"),
        ("0.bin", b"\0" * 52, "got 52 bytes, in which no such points are recognised: name the"),
        ("0.npy", b"nothing", "expected an array saved by numpy"),
        ("0.txt", b"", "expected files .bin, .pcd, .npy, .ply"),
    ],
)
def test_other_files_are_refused(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError, match=re.escape(message)):
        list(ScanFolder.find(tmp_path))


def test_arrays_of_other_shapes_are_refused(tmp_path):
    for array in (np.zeros((4, 2)), np.zeros(5), np.array([["a", "b", "c"]])):
        np.save(tmp_path / "0.npy", array)
        with pytest.raises(FormatError, match=r"0\.npy: expected"):
            list(ScanFolder.find(tmp_path))
