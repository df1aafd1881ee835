from pathlib import Path

import numpy as np
import pytest

from roadscope.core import Projection
from roadscope.fusion import (
    CalibrationError,
    CalibrationResult,
    read_calibration,
    write_calibration,
)

MATRIX = np.array([[320.0, -500, 0, 1], [240, 0, -500, 700], [1, 0, 0, 0.1]])


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    result = CalibrationResult(Projection(MATRIX, 640, 480), np.ones(9, bool), 0.7)
    write_calibration(path, result, 'board, "six" poses')
    assert read_calibration(path) == result.projection


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("matrix = [[1, 2], [3, 4]]\nwidth = 640\nheight = 480", "3 rows of 4"),
        ("matrix = [[1, 2, 3, 4], [3, 4]]\nwidth = 640\nheight = 480", "3 rows of 4"),
        ("matrix = [[0,0,0,1],[0,0,0,1],[1,0,0,1]]\nwidth = 640\nheight = 480", "inverted"),
        ("matrix = [[1,0,0,1],[0,1,0,1],[0,0,2,1]]\nwidth = 640\nheight = 480", "unit length"),
        ("matrix = [[1,0,0,1],[0,1,0,1],[0,0,1,1]]\nwidth = 640.5\nheight = 480", "whole pixels"),
        ("matrix = [[1, nan], [3, 4]]\nwidth = 640\nheight = 480", "3 rows of 4"),
        ("matrix = [[1,0,0,nan],[0,1,0,1],[0,0,1,1]]\nwidth = 6\nheight = 4", "finite"),
        ("matrix = [[1,0,0,1],[0,-1,0,1],[0,0,1,1]]\nwidth = 6\nheight = 4", "determinant"),
        ("matrix = [[1,0,0,1],[0,1,0,1],[0,0,1,1]]\nwidth = 6\nheight = 4", "above the ground"),
        ("width = 640\nheight = 480", "no key 'matrix'"),
        ("matrx = 3", "unknown key 'matrx'"),
        ("matrix =", "not a TOML file"),
    ],
)
def test_what_is_no_calibration_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=message):
        read_calibration(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"nowhere\.toml"):
        read_calibration(tmp_path / "nowhere.toml")
