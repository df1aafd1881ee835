"""The tracker that the README prints, as it is printed there."""

import re
from pathlib import Path

import pytest

from roadscope.benchmarks.check.plugin import load, looked_at
from roadscope.benchmarks.check.trackers import PROMISES

README = Path(__file__).parents[1] / "README.md"
PRINTED = re.compile(r"<!-- a tracker of ten lines -->\n```python\n(.*?)```", re.DOTALL)


@pytest.fixture
def spec(tmp_path: Path) -> str:
    (printed,) = PRINTED.findall(README.read_text())
    (tmp_path / "my_tracker.py").write_text(printed)
    return f"{tmp_path / 'my_tracker.py'}:Mine"


def test_it_has_ten_lines() -> None:
    (printed,) = PRINTED.findall(README.read_text())
    lines = printed[printed.index("class Mine") :].splitlines()
    assert len([line for line in lines if line.strip()]) == 10


def test_it_keeps_every_promise(spec: str) -> None:
    plugin, promises = load(spec)
    assert promises == PROMISES
    for promise in promises:
        item = looked_at(promise, plugin)
        assert item.good, f"{promise.words}: {item.words}"
