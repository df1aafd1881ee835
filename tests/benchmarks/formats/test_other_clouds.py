"""Scans in PLY, LAS and LAZ files, as other libraries write them."""

import laspy
import numpy as np
import pytest

from roadscope.formats import FormatError, ScanFolder, read_scan

POINTS = np.random.default_rng(0).uniform(1, 30, (50, 3)).astype(np.float32)
INTENSITY = np.linspace(0, 1, 50).astype(np.float32)
TIMES_S = np.linspace(0, 0.1, 50)
HEAD = "ply\nformat {}\ncomment made by a test\nelement vertex {}\n"
PLACE = "property float x\nproperty float y\nproperty float z\n"


def ply(encoding="ascii 1.0", count=50, properties=PLACE, rest="", body=b""):
    return (HEAD.format(encoding, count) + properties + rest + "end_header\n").encode() + body


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_files_of_trimesh_are_read(tmp_path, encoding):
    import trimesh  # half a second, that only this test needs

    cloud = trimesh.PointCloud(POINTS)
    (tmp_path / "0.ply").write_bytes(cloud.export(file_type="ply", encoding=encoding))
    assert read_scan(tmp_path / "0.ply", 0.0).points == pytest.approx(POINTS, abs=1e-5)


@pytest.mark.parametrize("order", ["<", ">"])
def test_fields_of_vertices_are_used_and_faces_are_not(tmp_path, order):
    names = ["x", "y", "z", "scalar_Intensity", "t"]
    rows = np.empty(50, [(name, f"{order}f4") for name in names[:4]] + [("t", f"{order}f8")])
    for name, values in zip(names, [*POINTS.T, INTENSITY, TIMES_S + 7], strict=True):
        rows[name] = values
    encoding = f"binary_{'little' if order == '<' else 'big'}_endian 1.0"
    properties = f"{PLACE}property float32 scalar_Intensity\nproperty double t\n"
    faces = "element face 1\nproperty list uchar int vertex_indices\n"
    body = rows.tobytes() + b"\3" + np.arange(3, dtype=f"{order}i4").tobytes()
    (tmp_path / "0.ply").write_bytes(ply(encoding, 50, properties, faces, body))
    scan = read_scan(tmp_path / "0.ply", 0.0)
    assert np.array_equal(scan.points, POINTS)
    assert scan.intensity == pytest.approx(INTENSITY)
    assert scan.time_offset_s == pytest.approx(TIMES_S - 0.05, abs=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "expected a PLY header"),
        (b"ply\nformat ascii 1.0\n", "expected a PLY header"),
        (ply("ebcdic 1.0"), "line 2: expected a format"),
        (ply(properties="property float x\nproperty float y\n"), "expected properties x, y and z"),
        (ply(properties=PLACE + "property half w\n"), "property, a type of number"),
        (ply(count=3, body=b"1 2 3\n4 5 6\n"), "expected 3 points"),
        (ply(count=1, body=b"1 2 a\n"), "line 9: expected 3 numbers"),
        (ply(count=1, body=b"1\n"), "line 9: expected 3 numbers, got .1"),
        (ply("binary_little_endian 1.0", body=b"12"), "expected 600 bytes after the header"),
        (ply(count=1, properties="element face 1\n" + PLACE), "expected properties x, y and z"),
    ],
)
def test_damaged_ply_files_are_refused(tmp_path, content, message):
    (tmp_path / "0.ply").write_bytes(content)
    with pytest.raises(FormatError, match=message):
        read_scan(tmp_path / "0.ply", 0.0)


def write_las(path, offset=0.0, points=POINTS):
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = [0.001] * 3, [offset] * 3
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = (points + np.float64(offset)).T
    cloud.intensity = (65535 * INTENSITY).astype(np.uint16)
    cloud.gps_time = 4e5 + TIMES_S
    cloud.write(path)


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_files_of_laspy_are_read(tmp_path, ending):
    for k in range(2):
        write_las(tmp_path / f"{k}.{ending}")
    first, second = ScanFolder.find(tmp_path)
    assert first.points == pytest.approx(POINTS, abs=1e-3)
    assert first.intensity == pytest.approx(INTENSITY, abs=1e-4)
    assert second.time_offset_s == pytest.approx(TIMES_S - 0.05, abs=1e-6)


def test_coordinates_of_a_map_are_refused(tmp_path):
    write_las(tmp_path / "0.las", offset=4.5e5)
    with pytest.raises(FormatError, match="coordinates of a map"):
        read_scan(tmp_path / "0.las", 0.0)


@pytest.mark.parametrize("ending", ["las", "laz"])
@pytest.mark.parametrize("length", [0, 100, 0.6])
def test_damaged_las_files_are_refused(tmp_path, ending, length):
    path = tmp_path / f"0.{ending}"
    write_las(path)
    content = path.read_bytes()
    path.write_bytes(content[: length if isinstance(length, int) else int(length * len(content))])
    with pytest.raises(FormatError, match=f"0.{ending}: expected"):
        read_scan(path, 0.0)


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_an_extra_that_is_missing_is_named(tmp_path, ending, uninstall):
    write_las(tmp_path / f"0.{ending}")
    uninstall("laspy")
    with pytest.raises(FormatError, match=r"laspy is not installed: .*\[bags\]"):
        read_scan(tmp_path / f"0.{ending}", 0.0)


def test_a_layout_is_for_files_without_names(tmp_path):
    write_las(tmp_path / "0.las")
    with pytest.raises(FormatError, match="its fields have names"):
        ScanFolder.find(tmp_path, columns=("x", "y", "z"))
