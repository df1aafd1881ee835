"""A calibration as a TOML or JSON file, and read back."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np

from roadscope.core import RecordError
from roadscope.core.projection import Projection
from roadscope.fusion.calibration import CalibrationError, CalibrationResult

KEYS = ("matrix", "width", "height", "origin", "reprojection_px", "points")
LOWEST_M = 0.05
"""Height of the lowest camera that is believed."""


def write_calibration(path: Path | str, result: CalibrationResult, origin: str) -> None:
    """Write matrix, size of the image, error and where it comes from.

    A path that ends in .json gets JSON, any other TOML.
    """
    projection, path = result.projection, Path(path)
    if path.suffix.lower() == ".json":
        path.write_text(_json(result, origin), encoding="utf-8")
        return
    rows = ",\n".join(
        f"    [{', '.join(repr(float(v)) for v in row)}]" for row in projection.matrix
    )
    text = (
        "# Maps homogeneous points of the ego frame, metres, to homogeneous pixels.\n"
        f"matrix = [\n{rows},\n]\n"
        f"width = {projection.width}\nheight = {projection.height}\n"
        f"reprojection_px = {result.reprojection_px:.4f}\npoints = {int(result.inliers.sum())}\n"
        f"origin = {_quoted(origin)}\n"
    )
    path.write_text(text, encoding="utf-8")


def _json(result: CalibrationResult, origin: str) -> str:
    projection = result.projection
    content = {
        "matrix": projection.matrix.tolist(),
        "width": projection.width,
        "height": projection.height,
        "reprojection_px": round(result.reprojection_px, 4),
        "points": int(result.inliers.sum()),
        "origin": origin,
    }
    return json.dumps(content, indent=1) + "\n"


def read_calibration(path: Path | str) -> Projection:
    """Read a projection; a file that holds none is refused with what is wrong in it."""
    path = Path(path)
    kind = "JSON" if path.suffix.lower() == ".json" else "TOML"
    try:
        text = path.read_text(encoding="utf-8")
        table = json.loads(text) if kind == "JSON" else tomllib.loads(text)
    except OSError as error:
        raise CalibrationError(f"cannot read {path}: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{path} is not a {kind} file: {error}") from error
    if not isinstance(table, dict):
        raise CalibrationError(f"{path}: expected names with values, got {type(table).__name__}")
    unknown = [key for key in table if key not in KEYS]
    missing = [key for key in KEYS[:3] if key not in table]
    if unknown or missing:
        what = f"unknown key '{unknown[0]}'" if unknown else f"no key '{missing[0]}'"
        raise CalibrationError(f"{path}: {what}; known: {', '.join(KEYS)}")
    try:
        matrix = np.array(table["matrix"], np.float64)
    except (ValueError, TypeError) as error:
        raise CalibrationError(f"{path}: matrix: expected 3 rows of 4 numbers") from error
    if matrix.shape != (3, 4):
        raise CalibrationError(f"{path}: matrix: expected 3 rows of 4 numbers, got {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise CalibrationError(f"{path}: matrix: expected finite numbers")
    for key in ("width", "height"):
        if type(table[key]) is not int:
            raise CalibrationError(f"{path}: {key}: expected whole pixels, got {table[key]!r}")
    try:
        projection = Projection(matrix, table["width"], table["height"])
    except RecordError as error:
        raise CalibrationError(f"{path}: {error}") from error
    if projection.height_m < LOWEST_M:
        raise CalibrationError(
            f"{path}: matrix: expected a camera above the ground, got one at "
            f"{projection.height_m:.2f} m"
        )
    return projection


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")
    return f'"{escaped}"'
