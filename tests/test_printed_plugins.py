"""The plug-ins that the page `bring-your-own` prints, as they are printed there."""

import re
from pathlib import Path

import pytest
from toy_drive import driven, offset

from roadscope import ODOMETRIES

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "bring-your-own.md"
PRINTED = re.compile(r"<!-- an? (\w+)(?: of eleven lines)? -->\n```python\n(.*?)```", re.DOTALL)
NAMES = {
    "tracker": "Mine",
    "detector": "MyDetector",
    "odometry": "MyOdometry",
    "fusion": "MyFusion",
    "driver": "MyDriver",
}


def printed(kind: str) -> str:
    (found,) = (text for name, text in PRINTED.findall(PAGE.read_text()) if name == kind)
    return str(found)


def saved(folder: Path, kind: str) -> str:
    """Return the spec of a printed plug-in in a file of a reader."""
    path = folder / f"my_{kind}.py"
    path.write_text(printed(kind))
    return f"{path}:{NAMES[kind]}"


def test_the_readme_prints_the_same_tracker() -> None:
    assert PRINTED.findall((ROOT / "README.md").read_text()) == [("tracker", printed("tracker"))]


@pytest.mark.parametrize("kind", ["tracker", "odometry"])
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
