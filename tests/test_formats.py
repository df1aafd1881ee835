from pathlib import Path

import numpy as np
import pytest

from roadscope import Pose, formats

POSES = [Pose.from_euler(x, 2.0, 0.5, roll=0.0, pitch=0.1, yaw=0.2 * x) for x in range(4)]


@pytest.mark.parametrize("form", ["tum", "kitti"])
def test_a_trajectory_is_read_back_as_written(tmp_path: Path, form: str) -> None:
    path = str(tmp_path / "poses.txt")
    formats.write_trajectory(path, POSES, stamps_s=[0.0, 0.1, 0.2, 0.3], form=form)
    again = formats.read_trajectory(path, form)
    for pose, written in zip(again.poses, POSES, strict=True):
        np.testing.assert_allclose(pose.matrix, written.matrix, atol=1e-9)
    assert again.stamps_s == ((0.0, 0.1, 0.2, 0.3) if form == "tum" else None)


def test_paths_may_be_text_and_errors_name_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_text("stamp,wx,wy,wz,ax,ay,az\n0.0,0,0,0,0,0,9.8\n0.01,0,0,0,0,0,9.8\n")
    samples, left_out = formats.read_imu(str(path))
    assert len(samples.stamps_s) == 2
    assert left_out == 0
    path.write_text("0.0 0 0 0\n")
    with pytest.raises(formats.FormatError, match=r"imu\.csv, line 1"):
        formats.read_imu(str(path))


def test_empty_results_are_no_error(tmp_path: Path) -> None:
    path = str(tmp_path / "0000.txt")
    formats.write_kitti_results(path, [])
    assert len(formats.read_kitti_labels(path, results=True)) == 0
