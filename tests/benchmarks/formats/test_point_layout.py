"""Which field of a scan's points is what: what is in it decides, not its name alone."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.benchmarks.formats import parse_columns, why_no_beams
from roadscope.core import RecordError
from roadscope.formats import FormatError, ScanFolder, read_scan, scan_of_points

BEAMS, COLUMNS = 16, 180


class Sweep:
    """A sweep of a scanner that turns clockwise, seen in a room."""

    def __init__(self, seed: int = 0, beams: int = BEAMS) -> None:
        rng = np.random.default_rng(seed)
        self.times_s = np.repeat(np.arange(COLUMNS) / COLUMNS * 0.1, beams)
        self.rings = np.tile(np.arange(beams), COLUMNS)
        turns = np.pi - 2 * np.pi * self.times_s / 0.1
        rises = np.deg2rad(np.linspace(-15, 15, beams))[self.rings]
        reach = rng.uniform(5, 40, COLUMNS).repeat(beams) + rng.normal(0, 0.02, len(turns))
        flat = reach * np.cos(rises)
        self.points = np.column_stack(
            [flat * np.cos(turns), flat * np.sin(turns), reach * np.sin(rises)]
        )
        self.intensities = rng.uniform(0, 255, len(turns)).round()

    def rows(self, *columns) -> np.ndarray:
        return np.column_stack([self.points, self.intensities, *columns]).astype(np.float32)


def write_pcd(path: Path, points: np.ndarray, **fields: np.ndarray) -> None:
    names = ["x", "y", "z", *fields]
    values = [*points.T, *fields.values()]
    layout = np.dtype([(name, "<f8") for name in names])
    rows = np.empty(len(points), layout)
    for name, column in zip(names, values, strict=True):
        rows[name] = column
    one = " ".join
    path.write_bytes(
        f"VERSION 0.7\nFIELDS {one(names)}\nSIZE {one('8' for _ in names)}\n"
        f"TYPE {one('F' for _ in names)}\nCOUNT {one('1' for _ in names)}\nWIDTH {len(rows)}\n"
        f"HEIGHT 1\nPOINTS {len(rows)}\nDATA binary\n".encode()
        + rows.tobytes()
    )


def notes_of(folder: Path) -> str:
    return " | ".join(ScanFolder.find(folder).notes)


# --- the width of raw files


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.sampled_from([3, 4, 5, 6]), st.booleans())
def test_the_number_of_floats_a_point_is_found(tmp_path_factory, seed, width, shuffled):
    sweep = Sweep(seed)
    rows = sweep.rows(sweep.rings, sweep.times_s)[:, :width]
    # So many points that any other width divides the file, too.
    rows = rows[: len(rows) // 60 * 60]
    if shuffled:
        rows = np.random.default_rng(seed).permutation(rows)
    path = tmp_path_factory.mktemp("raw") / "0.bin"
    rows.tofile(path)
    assert np.array_equal(read_scan(path, 0.0).points, rows[:, :3])


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10**6), st.sampled_from([4, 5, 6, 7, 8, 10]), st.sampled_from([1, 1e9]))
def test_wider_points_and_intensities_in_decibels_are_found(tmp_path_factory, seed, width, unit):
    """Eight floats are those of PCL: x y z padding, intensity ring time padding."""
    sweep, rng = Sweep(seed), np.random.default_rng(seed)
    some = np.ones(len(sweep.points))
    others = [some, 10 * some, unit * sweep.times_s, 20 * some, sweep.rings, some, 0 * some]
    if width < 7:
        others[0] = -rng.uniform(5, 30, len(some))
    rows = np.column_stack([sweep.points, *others])[:, :width].astype(np.float32)
    rows = rows[: len(rows) // 840 * 840]
    path = tmp_path_factory.mktemp("raw") / "0.bin"
    rows.tofile(path)
    assert np.array_equal(read_scan(path, 0.0).points, rows[:, :3])


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10**6), st.sampled_from([4, 5]), st.booleans())
def test_neighbours_of_far_and_near_beams_are_two_points(tmp_path_factory, seed, width, constant):
    """Lasers of a VLP-16 fire in such an order: a low one, then a high one."""
    sweep = Sweep(seed)
    order = np.arange(len(sweep.points)).reshape(-1, 2, BEAMS // 2).transpose(0, 2, 1).ravel()
    points = sweep.points * np.where(sweep.rings < BEAMS // 2, 0.2, 1.0)[:, None]
    rows = np.column_stack([points, 0 * sweep.intensities if constant else sweep.intensities])
    rows = np.column_stack([rows, sweep.times_s])[order, :width].astype(np.float32)
    path = tmp_path_factory.mktemp("raw") / "0.bin"
    rows.tofile(path)
    assert np.array_equal(read_scan(path, 0.0).points, rows[:, :3])


@pytest.mark.parametrize(("width", "kind"), [(12, "<f4"), (16, "<f4"), (4, "<f8")])
def test_points_that_are_not_recognised_are_refused(tmp_path, width, kind):
    sweep = Sweep()
    others = [sweep.intensities, sweep.rings, *(sweep.times_s + k for k in range(11))]
    np.column_stack([sweep.points, *others])[:, :width].astype(kind).tofile(tmp_path / "0.bin")
    message = (
        "look like float64, .* recognised: save them as float32"
        if kind == "<f8"
        else "no such points are recognised: name the col"
    )
    with pytest.raises(FormatError, match=message):
        ScanFolder.find(tmp_path)


def test_what_was_taken_from_a_raw_file_is_reported(tmp_path):
    sweep = Sweep()
    sweep.rows(sweep.rings, sweep.times_s).tofile(tmp_path / "0.pcd.bin")
    notes = notes_of(tmp_path)
    assert "points of 6 floats are read: x y z column 4 column 5 column 6" in notes
    assert "column 4 as intensity, column 5 as number of the beam, column 6 as time of" in notes
    (scan,) = ScanFolder.find(tmp_path)
    assert np.array_equal(scan.ring, sweep.rings)
    assert np.ptp(scan.time_offset_s) == pytest.approx(np.ptp(sweep.times_s), abs=1e-6)


def test_a_raw_file_that_may_be_two_things_is_refused_and_a_layout_helps(tmp_path):
    numbers = np.random.default_rng(0).uniform(1, 2, 6000).astype("<f4")
    numbers.tofile(tmp_path / "0.bin")
    with pytest.raises(FormatError, match=r"may have .* floats: name the columns"):
        ScanFolder.find(tmp_path)
    columns = parse_columns("x,y,z,_,intensity,_")
    (scan,) = ScanFolder.find(tmp_path, columns=columns)
    assert np.array_equal(scan.points, numbers.reshape(-1, 6)[:, :3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,intensity", "expected x, y and z, and each name once"),
        ("x,y,z,ring,ring", "expected x, y and z, and each name once"),
        ("x,y,z,tim", "no column 'tim'"),
    ],
)
def test_layouts_that_are_none_are_refused(text, message):
    with pytest.raises(FormatError, match=message):
        parse_columns(text)


def test_a_layout_whose_times_are_of_no_sweep_is_refused(tmp_path):
    sweep = Sweep()
    np.save(tmp_path / "0.npy", sweep.rows(30 * sweep.times_s))
    with pytest.raises(FormatError, match=r"'time': expected times of points over 5 ms to 1 s"):
        ScanFolder.find(tmp_path, columns=parse_columns("x y z intensity time"))


# --- fields whose name promises what they do not hold


def test_lasers_that_sweep_through_all_elevations_are_no_beams(tmp_path):
    """A Livox has such a field, `line`."""
    sweep = Sweep()
    write_pcd(tmp_path / "0.pcd", sweep.points, line=sweep.rings % 4)
    assert "field 'line' is not used as number of the beam: points of one number" in notes_of(
        tmp_path
    )
    (scan,) = ScanFolder.find(tmp_path)
    assert np.array_equal(scan.ring, sweep.rings)


@settings(deadline=None)
@given(st.integers(0, 10**6), st.floats(-10, 10), st.sampled_from([4, 16, 64]))
def test_beams_of_a_sensor_that_is_tilted_are_beams(seed, tilt_deg, beams):
    sweep, tilt = Sweep(seed, beams), np.deg2rad(tilt_deg)
    turned = np.array(
        [[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]]
    )
    numbers = np.random.default_rng(seed).permutation(beams)[sweep.rings]
    assert why_no_beams(sweep.points @ turned.T, numbers) == ""
    assert "all elevations" in why_no_beams(sweep.points, sweep.rings[::-1] % 2)


def test_of_two_fields_of_times_the_one_that_varies_is_used(tmp_path):
    sweep = Sweep()
    same = np.full(len(sweep.points), 1.7e9)
    write_pcd(
        tmp_path / "0.pcd", sweep.points, timestamp=same, offset_time=(1e9 * sweep.times_s).round()
    )
    assert "field 'timestamp' is not used as time of points: the same for all" in notes_of(tmp_path)
    (scan,) = ScanFolder.find(tmp_path)
    assert scan.time_offset_s == pytest.approx(sweep.times_s - sweep.times_s.max() / 2, abs=1e-6)


def test_beams_in_a_field_of_times_are_no_times(tmp_path):
    sweep = Sweep()
    write_pcd(tmp_path / "0.pcd", sweep.points, time=sweep.rings)
    notes = notes_of(tmp_path)
    assert "'time' is not used as time of points: its numbers are those of beams" in notes
    assert "points without times" in notes


@pytest.mark.parametrize("column", ["ring", "label", "elongation", "distance"])
def test_a_fifth_column_that_is_no_time_in_seconds_is_reported(tmp_path, column):
    sweep = Sweep()
    rng = np.random.default_rng(1)
    values = {
        "ring": sweep.rings,
        "label": rng.integers(0, 20, len(sweep.rings)),
        "elongation": rng.uniform(0, 0.9, len(sweep.rings)),
        "distance": np.linalg.norm(sweep.points, axis=1),
    }[column]
    np.save(tmp_path / "0.npy", sweep.rows(values))
    notes = notes_of(tmp_path)
    assert "points without times" in notes
    assert ("column 5 as number of the beam" in notes) == (column == "ring")
    assert ("column 5 is not used" in notes) == (column != "ring")


@pytest.mark.parametrize("order", ["firing", "by beam"])
def test_a_fifth_column_of_times_is_used_in_whatever_order_points_are(tmp_path, order):
    sweep = Sweep()
    rows = sweep.rows(sweep.times_s)
    rows = rows[np.argsort(sweep.rings, kind="stable")] if order == "by beam" else rows
    np.save(tmp_path / "0.npy", rows)
    (scan,) = ScanFolder.find(tmp_path)
    assert np.ptp(scan.time_offset_s) == pytest.approx(np.ptp(sweep.times_s), abs=1e-6)


# --- what is left out is counted


def test_points_without_an_intensity_are_used(tmp_path):
    sweep = Sweep()
    intensities = sweep.intensities.copy()
    intensities[::2] = np.nan
    write_pcd(tmp_path / "0.pcd", sweep.points, intensity=intensities, time=sweep.times_s)
    scans = ScanFolder.find(tmp_path)
    (scan,) = scans
    assert len(scan) == len(sweep.points)
    assert not scan.intensity[::2].any()
    assert scan.intensity.max() == 1
    assert scans.losses.notes() == ()


def test_what_is_left_out_is_counted_by_reason(tmp_path):
    sweep = Sweep()
    points, times = sweep.points.copy(), sweep.times_s.copy()
    points[0], points[1, 2], points[2, 0] = 0, np.nan, 9000
    times[3], times[4] = 3.6, np.nan
    write_pcd(tmp_path / "0.pcd", points, time=times)
    scans = ScanFolder.find(tmp_path)
    (scan,) = scans
    assert len(scan) == len(points) - 5
    assert np.ptp(scan.time_offset_s) == pytest.approx(np.ptp(sweep.times_s), abs=1e-6)
    assert len(list(scans)) == 1  # Read again, for a check: nothing counts twice.
    assert scans.losses.notes() == (
        "2 points left out: without a return (0 0 0 or not a number)",
        "1 point left out: farther than 5000 m",
        "2 points left out: with a time outside of the sweep",
    )


@pytest.mark.parametrize("place", ["map", "millimetres"])
def test_coordinates_of_a_map_and_millimetres_are_refused(tmp_path, place):
    points = Sweep().points
    points = points + np.array([450_000, 5_400_000, 120]) if place == "map" else 1000 * points
    for k in range(3):
        write_pcd(tmp_path / f"{k}.pcd", points)
    with pytest.raises(FormatError, match=r"farther than 5000 m: are they in coordinates of a map"):
        ScanFolder.find(tmp_path)


def test_damaged_scans_are_empty_and_reported_and_the_others_are_read(tmp_path):
    sweep = Sweep()
    for k in range(8):
        sweep.rows().tofile(tmp_path / f"{k}.bin")
    (tmp_path / "3.bin").write_bytes((tmp_path / "3.bin").read_bytes()[:-6])
    (tmp_path / "5.bin").write_bytes(b"")
    scans = ScanFolder.find(tmp_path)
    assert [len(scan) for scan in scans] == [
        0 if k in (3, 5) else len(sweep.points) for k in range(8)
    ]
    assert len(list(scans)) == len(list(scans.part(0, 8))) == 8
    note, empty = scans.losses.notes()
    assert note.startswith("1 scan is taken as empty: ")
    assert "3.bin" in note
    assert "1 scan is without points: " in empty


def test_a_link_to_a_missing_file_is_an_empty_scan_and_the_others_are_read(tmp_path):
    sweep = Sweep()
    for k in range(3):
        sweep.rows().tofile(tmp_path / f"{k}.bin")
    (tmp_path / "3.bin").symlink_to(tmp_path / "missing.bin")
    scans = ScanFolder.find(tmp_path)
    assert [len(scan) for scan in scans] == [len(sweep.points)] * 3 + [0]
    (note,) = scans.losses.notes()
    assert note.startswith("1 scan is taken as empty: ")
    for k in range(3):
        (tmp_path / f"{k}.bin").unlink()
    with pytest.raises(FormatError, match=r"3\.bin: cannot be read: No such file"):
        ScanFolder.find(tmp_path)


def test_a_scan_whose_times_are_odd_has_none_and_is_used(tmp_path):
    sweep = Sweep()
    for k in range(5):
        times = sweep.times_s * (1000 if k == 3 else 1)
        write_pcd(tmp_path / f"{k}.pcd", sweep.points, time=times)
    scans = list(ScanFolder.find(tmp_path))
    assert all(len(scan) == len(sweep.points) for scan in scans)
    assert [bool(scan.time_offset_s.any()) for scan in scans] == [True, True, True, False, True]


def test_arrays_become_a_scan_as_files_do(tmp_path):
    sweep = Sweep()
    points, times = sweep.points.copy(), sweep.times_s.copy()
    points[7], points[9, 1], times[11] = 0, np.nan, 5.0
    np.save(tmp_path / "0.npy", np.column_stack([points, sweep.intensities, times]))
    scan = scan_of_points(points, 2.0, intensities=sweep.intensities, times_s=times)
    assert scan == read_scan(tmp_path / "0.npy", 2.0)
    assert len(scan) == len(points) - 3
    with pytest.raises(RecordError, match="points"):
        scan_of_points(points[:, :2], 0.0)
    with pytest.raises(RecordError, match="time"):
        scan_of_points(points, 0.0, times_s=times[:-1])


@pytest.mark.parametrize("unit", [1e-3, 1000.0])
def test_points_in_another_unit_than_metres_are_refused(tmp_path, unit):
    """Of a small room: no point is too far in millimetres."""
    np.save(tmp_path / "0.npy", unit * Sweep().points / 10)
    with pytest.raises(FormatError, match="are they in metres from the sensor"):
        ScanFolder.find(tmp_path)


def test_arrays_with_names_and_range_images_are_read(tmp_path):
    sweep = Sweep()
    layout = np.dtype([(name, "f4") for name in ("x", "y", "z", "i", "ring", "t")])
    rows = np.empty(len(sweep.points), layout)
    columns = [*sweep.points.T, sweep.intensities, sweep.rings, sweep.times_s]
    for name, values in zip(layout.names, columns, strict=True):
        rows[name] = values
    np.save(tmp_path / "0.npy", rows)
    (named,) = ScanFolder.find(tmp_path)
    assert np.array_equal(named.ring, sweep.rings)
    assert named.time_offset_s.any()
    image = sweep.rows(sweep.times_s).reshape(COLUMNS, BEAMS, 5)
    np.save(tmp_path / "0.npy", image)
    (scan,) = ScanFolder.find(tmp_path)
    assert np.array_equal(scan.points, named.points)
    np.save(tmp_path / "0.npy", rows[["x", "y"]])
    with pytest.raises(FormatError, match="its fields have names: x, y; expected x, y and z"):
        ScanFolder.find(tmp_path)


@pytest.mark.parametrize("values", ["labels", "shuffled times"])
def test_a_field_named_as_times_that_fits_no_sweep_is_not_used(tmp_path, values):
    sweep, rng = Sweep(), np.random.default_rng(0)
    labels = rng.integers(0, 90, len(sweep.points))
    times = labels if values == "labels" else rng.permutation(sweep.times_s)
    write_pcd(tmp_path / "0.pcd", sweep.points, t=times)
    notes = notes_of(tmp_path)
    assert "'t' is not used as time of points: it does not follow a sweep" in notes
    assert "points without times" in notes


def test_times_of_two_units_one_after_the_other_are_used(tmp_path):
    sweep = Sweep()
    times = np.concatenate([sweep.times_s, 0.1 - sweep.times_s[::-1]])
    write_pcd(tmp_path / "0.pcd", np.vstack([sweep.points, -sweep.points]), t=times)
    assert "t as time of points in s" in notes_of(tmp_path)


def test_the_use_of_each_field_is_reported(tmp_path):
    sweep = Sweep()
    fields = {"reflectivity": sweep.intensities, "ring": sweep.rings, "t": 1e9 * sweep.times_s}
    write_pcd(tmp_path / "0.pcd", sweep.points, **fields)
    note_text = "reflectivity as intensity, ring as number of the beam, t as time of points in ns"
    assert note_text in notes_of(tmp_path)


def test_times_beside_the_scans_are_reported_and_a_damaged_file_loses_only_its_own(tmp_path):
    sweep = Sweep()
    scans, times = (tmp_path / name / "0000" for name in ("velodyne", "velodyne_times"))
    for folder in (scans, times):
        folder.mkdir(parents=True)
    for k in range(5):
        sweep.rows().tofile(scans / f"{k}.bin")
        sweep.times_s.astype("<f4").tofile(times / f"{k}.bin")
    (times / "3.bin").write_bytes(b"1234")
    scan_folder = ScanFolder.find(scans)
    assert "velodyne_times as time of points in s" in " ".join(scan_folder.notes)
    read = list(scan_folder)
    assert [len(scan) for scan in read] == [len(sweep.points)] * 5
    assert [bool(scan.time_offset_s.any()) for scan in read] == [True, True, True, False, True]
    (note,) = scan_folder.losses.notes()
    assert note.startswith("1 scan is read without a field: ")
    assert "velodyne_times" in note


@pytest.mark.parametrize(
    ("loss", "message"),
    [
        ("stray", "its times of points are over 4.39 s, which no sweep takes"),
        ("unit", "its times of points are over 99.4 s"),
        ("names", "no field 'ring'; no field 'time'"),
    ],
)
def test_scans_that_are_read_without_a_field_are_counted(tmp_path, loss, message):
    sweep = Sweep()
    for k in range(8):
        times = sweep.times_s.copy()
        if loss == "stray" and k in (3, 4):
            times[::10] += 4.29
        times *= 1000 if loss == "unit" and k in (3, 4) else 1
        fields = {"ring": sweep.rings, "time": times}
        write_pcd(
            tmp_path / f"{k}.pcd",
            sweep.points,
            **({} if loss == "names" and k in (3, 4) else fields),
        )
    scans = ScanFolder.find(tmp_path)
    assert [len(scan) for scan in scans] == [len(sweep.points)] * 8
    (note,) = scans.losses.notes()
    assert note.startswith("2 scans are read without a field: the first: ")
    assert message in note


def test_arrays_with_times_in_another_unit_are_refused():
    sweep = Sweep()
    with pytest.raises(RecordError, match="time: expected seconds, over up to 1 s, got 9"):
        scan_of_points(sweep.points, 0.0, times_s=1e9 * sweep.times_s)
