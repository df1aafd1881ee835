"""The plug-ins that the README prints, as they are printed there."""

import re
from pathlib import Path

import pytest
from toy_drive import driven, offset

from roadscope import ODOMETRIES

README = Path(__file__).parents[1] / "README.md"
PRINTED = re.compile(r"<!-- an? (\w+) of eleven lines -->\n```python\n(.*?)```", re.DOTALL)
NAMES = {"tracker": "Mine", "odometry": "MyOdometry"}


def printed(kind: str) -> str:
    (found,) = (text for name, text in PRINTED.findall(README.read_text()) if name == kind)
    return str(found)


def saved(folder: Path, kind: str) -> str:
    """Return the spec of a printed plug-in in a file of a reader."""
    path = folder / f"my_{kind}.py"
    path.write_text(printed(kind))
    return f"{path}:{NAMES[kind]}"


@pytest.mark.parametrize("kind", NAMES)
def test_it_has_eleven_lines(kind: str) -> None:
    text = printed(kind)
    lines = text[text.index(f"class {NAMES[kind]}") :].splitlines()
    assert len([line for line in lines if line.strip()]) == 11


@pytest.mark.parametrize("kind", NAMES)
def test_it_keeps_every_promise(kind: str, tmp_path: Path) -> None:
    from roadscope import check

    report = check(saved(tmp_path, kind), kind=kind, deadline_s=300.0)
    assert report.kind == kind
    assert report.items
    assert report.ok, str(report)


@pytest.mark.slow
def test_the_odometry_follows(tmp_path: Path) -> None:
    odometry = ODOMETRIES.make(saved(tmp_path, "odometry"))
    odometry.reset(None)
    drive, inputs = driven(25)
    estimates = [odometry.update(scan, imu) for scan, imu in inputs]
    distance_m, _ = offset(estimates[-1], drive.pose(inputs[-1][0].stamp_s))
    assert distance_m < 0.5
