"""The plug-ins that the README prints, as they are printed there."""

import re
from pathlib import Path

import pytest

from roadscope.benchmarks.check import odometries, trackers
from roadscope.benchmarks.check.plugin import load, looked_at

README = Path(__file__).parents[1] / "README.md"
PRINTED = re.compile(r"<!-- an? (\w+) of ten lines -->\n```python\n(.*?)```", re.DOTALL)
PROMISES = {"tracker": trackers.PROMISES, "odometry": odometries.PROMISES}
NAMES = {"tracker": "Mine", "odometry": "MyOdometry"}


@pytest.fixture(params=PROMISES)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def printed(kind: str) -> str:
    (found,) = (text for name, text in PRINTED.findall(README.read_text()) if name == kind)
    return str(found)


@pytest.fixture
def spec(tmp_path: Path, kind: str, printed: str) -> str:
    path = tmp_path / f"my_{kind}.py"
    path.write_text(printed)
    return f"{path}:{NAMES[kind]}"


def test_it_has_ten_lines(kind: str, printed: str) -> None:
    lines = printed[printed.index(f"class {NAMES[kind]}") :].splitlines()
    assert len([line for line in lines if line.strip()]) == 10


def test_it_keeps_every_promise(kind: str, spec: str) -> None:
    plugin, promises = load(spec)
    assert promises == PROMISES[kind]
    for promise in promises:
        item = looked_at(promise, plugin)
        assert item.good, f"{promise.words}: {item.words}"


def test_the_odometry_follows(kind: str, spec: str) -> None:
    if kind != "odometry":
        pytest.skip("a tracker")
    plugin, promises = load(spec)
    words = looked_at(promises[-1], plugin).words
    assert float(words.split()[0]) < 0.5, words
