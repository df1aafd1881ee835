"""A run whose worker processes die."""

from pathlib import Path

import pytest

import roadscope
from roadscope.benchmarks import EXTRAS, BackendError, RunError
from roadscope.core import Requirement

DEADLY = """
import os, signal
from roadscope.core import Detections

class Deadly:
    kind = "detector"

    def reset(self): ...

    def detect(self, frame):
        os.kill(os.getpid(), signal.SIGKILL)

class Finds:
    kind = "detector"

    def reset(self): ...

    def detect(self, frame):
        return Detections.empty(frame.stamp_s)
"""
SUITE = """
name = "tiny"
version = 1
rig = "lux"
scenarios = ["lu2018-three-vehicles", "lu2018-occlusion"]
split = "validation"
seeds = 1
duration_s = 0.5
[detection]
entries = ["pag"]
[tracking]
entries = ["nearest"]
detectors = ["pag"]
"""
EPISODES = 2


@pytest.fixture
def suite(tmp_path: Path) -> str:
    path = tmp_path / "tiny.toml"
    path.write_text(SUITE)
    return str(path)


@pytest.fixture
def plugins(tmp_path: Path) -> Path:
    path = tmp_path / "plugins.py"
    path.write_text(DEADLY)
    return path


@pytest.mark.slow
def test_an_entry_that_kills_the_run_s_workers_fails_alone(
    suite: str, plugins: Path, tmp_path: Path
) -> None:
    """Not isolated, a stranger's class ends the process that runs it."""
    deadly = f"{plugins}:Deadly"
    results = roadscope.leaderboard(
        suite,
        [deadly, f"{plugins}:Finds"],
        boards=["detection"],
        jobs=2,
        trust=True,
        out_dir=tmp_path / "out",
    )
    alone = roadscope.leaderboard(suite, boards=["detection"], out_dir=tmp_path / "alone")
    assert {failure.entry for failure in results.failures} == {deadly}
    assert len(results.failures) == EPISODES
    assert all("worker process died" in f.reason and deadly in f.reason for f in results.failures)
    for metric in ("f1", "ap", "position_rmse_m"):
        assert results.row("detection", "pag", metric) == alone.row("detection", "pag", metric)
    assert results.row("detection", f"{plugins}:Finds", "f1") is not None


@pytest.mark.slow
def test_what_depends_on_a_deadly_source_names_its_own_entry(
    suite: str, plugins: Path, tmp_path: Path
) -> None:
    Path(suite).write_text(
        SUITE.replace('detectors = ["pag"]', f'detectors = ["{plugins}:Deadly"]')
    )
    results = roadscope.leaderboard(
        suite, boards=["tracking"], jobs=2, trust=True, out_dir=tmp_path / "out"
    )
    failures = [f for f in results.failures if "worker process died" in f.reason]
    assert len(failures) == EPISODES
    assert all(failure.entry in failure.reason for failure in failures)
    assert all(failure.entry.startswith("nearest") for failure in failures)


@pytest.mark.parametrize(
    "arguments",
    [{"jobs": 0}, {"backend": "mpi"}, {"backend": "loky", "address": "tcp://localhost:1"}],
)
def test_impossible_workers_are_refused_before_anything_runs(
    suite: str, tmp_path: Path, arguments: dict[str, object]
) -> None:
    with pytest.raises(ValueError, match=r"jobs|backend") as caught:
        roadscope.leaderboard(suite, out_dir=tmp_path / "out", **arguments)
    assert ("jobs" in arguments) == isinstance(caught.value, RunError)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("backend", sorted(EXTRAS))
def test_a_missing_extra_is_named_before_anything_runs(
    suite: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, backend: str
) -> None:
    absent = Requirement("no-such-distribution", EXTRAS[backend].command)
    monkeypatch.setitem(EXTRAS, backend, absent)
    with pytest.raises(BackendError, match=rf"pip install 'roadscope\[{backend}\]'"):
        roadscope.leaderboard(suite, out_dir=tmp_path / "out", backend=backend)
    assert not (tmp_path / "out").exists()
