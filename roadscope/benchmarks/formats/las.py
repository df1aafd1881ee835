"""Point clouds in LAS and LAZ files; the package laspy reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.table import FormatError
from roadscope.core.loading import Requirement

LASPY = Requirement("laspy", "pip install 'roadscope[bags]'")
FIELDS = ("intensity", "gps_time")
"""The fields of points that tell something about a scan."""


def read_las(path: Path | str) -> dict[str, np.ndarray]:
    """Return x, y and z of all points in metres, intensity, and gps_time if the file has it."""
    if LASPY.missing:
        raise FormatError(f"{path}: {LASPY.missing}")
    import laspy

    try:
        cloud = laspy.read(path)
        names = [name for name in FIELDS if name in cloud.point_format.dimension_names]
        places = {name: np.asarray(getattr(cloud, name), np.float64) for name in ("x", "y", "z")}
        return places | {name: np.asarray(cloud[name], np.float64) for name in names}
    except Exception as error:
        # Damaged files raise errors of every kind, those of the decompressor among them.
        raise FormatError(f"{path}: expected a LAS or LAZ file: {error}") from error
