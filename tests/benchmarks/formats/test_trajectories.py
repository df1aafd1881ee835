"""Files of poses: what is written is read again, what is malformed is refused."""

import numpy as np
import pytest

from roadscope.core import Pose
from roadscope.formats import FormatError, read_trajectory, write_trajectory
from roadscope.odometry import exp_se3


@pytest.fixture
def poses():
    rng = np.random.default_rng(0)
    return [Pose(exp_se3(3 * rng.standard_normal(6))) for _ in range(20)]


@pytest.mark.parametrize("form", ["kitti", "tum"])
def test_written_poses_are_read_again(tmp_path, poses, form):
    path, stamps = str(tmp_path / "poses.txt"), [0.1 * k for k in range(20)]
    write_trajectory(path, poses, stamps_s=stamps, form=form)
    trajectory = read_trajectory(path, form)
    for one, other in zip(poses, trajectory.poses, strict=True):
        assert np.allclose(one.matrix, other.matrix, atol=1e-12)
    assert (
        trajectory.stamps_s is None
        if form == "kitti"
        else trajectory.stamps_s == pytest.approx(stamps)
    )


def test_tum_reads_comments_and_knows_which_line_is_wrong(tmp_path):
    path = tmp_path / "tum.txt"
    path.write_text("# time x y z\n\n0.5 1 2 3 0 0 0 1\n  # more\n0.6 1 2 3 0 0 1 0\n")
    trajectory = read_trajectory(path, "tum")
    assert trajectory.stamps_s == (0.5, 0.6)
    assert trajectory.poses[1].yaw == pytest.approx(np.pi, abs=1e-9)
    path.write_text("# time\n0.5 1 2 3 0 0 0 1\n0.5 1 2 3 0 0 0 1\n")
    with pytest.raises(FormatError, match=r"tum.txt, line 3: expected a timestamp later"):
        read_trajectory(path, "tum")


@pytest.mark.parametrize(
    ("form", "text", "message"),
    [
        ("kitti", "1 0 0 0 0 1 0 0 0 0 1\n", "line 1: expected 12 columns"),
        ("kitti", "1 0 0 0 0 2 0 0 0 0 1 0\n", "line 1: expected a rotation"),
        ("kitti", "1 0 0 0 0 1 0 0 0 0 1 x\n", "line 1: expected t2 as a number"),
        ("tum", "0 1 2 3 0 0 0 1\n1 1 2 nan 0 0 0 1\n", "line 2: expected tz as a finite number"),
        ("tum", "0 1 2 3 0 0 0 2\n", "line 1: expected a quaternion qx qy qz qw of length 1"),
        ("tum", "0 1 2 3 0 0 0\n", "line 1: expected 8 columns"),
        ("evo", "", "no format of trajectories 'evo'; known: kitti, tum"),
    ],
)
def test_malformed_files_are_refused(tmp_path, form, text, message):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(FormatError, match=message):
        read_trajectory(path, form)


def test_an_empty_file_has_no_poses(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text("")
    assert read_trajectory(path, "tum").poses == read_trajectory(path, "kitti").poses == ()
