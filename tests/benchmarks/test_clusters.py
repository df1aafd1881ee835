"""Workers of real local clusters, of Ray and of Dask, that the tests start.

Other workers: `test_workers.py`, `test_cli.py` and `tests/torture`.
"""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

import psutil
import pytest

MODULES = {"ray": "ray", "dask": "distributed"}
INSTALLED = [name for name, module in MODULES.items() if importlib.util.find_spec(module)]
CLUSTERS = [
    pytest.param(
        name, marks=pytest.mark.skipif(name not in INSTALLED, reason=f"{module} is not installed")
    )
    for name, module in MODULES.items()
]
TIMES = "_ms"
TOKEN = uuid4().hex + uuid4().hex
"""Ray's runs and clusters of these tests know one another by it."""
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
TASKS = """
import json, os, signal, sys, time
import psutil
from roadscope.benchmarks.isolation import open_plugin
from roadscope.benchmarks.kinds import KINDS, check_plugin_spec
from roadscope.benchmarks.workers import WorkerSettings, open_workers
from roadscope.core import Spec

STRANGER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "stranger.py:Stranger")

def deadly(item):
    if item == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    return item * item

def slow(item):
    with open(f"worker-{os.getpid()}", "w"):
        time.sleep(2)

def with_supervisor(item):
    spec = check_plugin_spec(Spec.parse(STRANGER), KINDS["detector"])
    with open_plugin(spec) as plugin:
        plugin.call("reset")
    return [os.getpid(), *[each.pid for each in psutil.Process().children(recursive=True)]]

def main(backend, *functions):
    with open_workers(WorkerSettings(2, backend, None)) as workers:
        results = [
            dict(workers.each(globals()[function], range(12), on_death=lambda item: None))
            for function in functions
        ]
    print(json.dumps(results))
"""
STRANGER = """
class Stranger:
    kind = "detector"

    def reset(self): ...

    def detect(self, frame): ...
"""
RAY = """
import ray
ray.init(address="local", num_cpus=2, include_dashboard=False, log_to_driver=False)
print("address", ray.get_runtime_context().gcs_address, flush=True)
input()
"""
DASK = """
from distributed import LocalCluster
if __name__ == "__main__":
    cluster = LocalCluster(n_workers=2, threads_per_worker=2, dashboard_address=None)
    print("address", cluster.scheduler_address, flush=True)
    input()
    cluster.close()
"""

pytestmark = pytest.mark.slow


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a suite, a stranger's class and what workers compute."""
    (tmp_path / "tiny.toml").write_text(SUITE)
    (tmp_path / "tasks.py").write_text(TASKS)
    (tmp_path / "stranger.py").write_text(STRANGER)
    return tmp_path


def environment(folder: Path, cache: str = "cache") -> dict[str, str]:
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])
    own = {"PYTHONPATH": path, "ROADSCOPE_CACHE": str(folder / cache)}
    return os.environ | own | {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": TOKEN}


def computed(folder: Path, backend: str, *functions: str) -> list[dict[int, Any]]:
    """Return what workers compute of twelve items by each function, in a process of its own.

    Nothing else may be on its standard output, also when a worker dies.
    """
    done = subprocess.run(
        [sys.executable, "-c", f"import tasks; tasks.main{(backend, *functions)}"],
        cwd=folder,
        env=environment(folder),
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return [
        {int(item): result for item, result in results.items()}
        for results in json.loads(done.stdout)
    ]


def scores(folder: Path, name: str, *options: str) -> dict[tuple[str, ...], Any]:
    """Return all scores of a run but times, each run with a cache of its own."""
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "roadscope",
            "leaderboard",
            "--suite",
            "tiny.toml",
            "--jobs",
            "2",
            "--json",
            *options,
        ],
        cwd=folder,
        env=environment(folder, name),
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    return {
        (job["board"], job["entry"], job["scenario"], job["inputs"], metric): score["value"]
        for job in json.loads(done.stdout)["scores"]
        for metric, score in job["scores"].items()
        if not metric.endswith(TIMES)
    }


@contextmanager
def cluster(folder: Path, backend: str) -> Iterator[str]:
    """Start a cluster in a process of its own and yield its address."""
    script = folder / f"{backend}_cluster.py"
    script.write_text({"ray": RAY, "dask": DASK}[backend])
    process = subprocess.Popen(
        [sys.executable, str(script)],
        cwd=folder,
        env=environment(folder),
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield next(line.split()[1] for line in process.stdout if line.startswith("address"))
    finally:
        process.communicate("\n", timeout=60)


@pytest.mark.parametrize("backend", CLUSTERS)
def test_a_deadly_item_costs_only_itself_and_supervisors_end_with_the_workers(
    folder: Path, backend: str
) -> None:
    results, processes = computed(folder, backend, "deadly", "with_supervisor")
    assert results == {item: None if item == 5 else item * item for item in range(12)}
    numbers = processes.values()
    workers = {first for first, *_ in numbers}
    below = {number for _, *rest in numbers for number in rest}
    assert 1 <= len(workers) <= 2
    assert len(below) >= len(workers)
    _, alive = psutil.wait_procs(_processes(workers | below), timeout=10)
    assert not alive


@pytest.mark.parametrize("backend", CLUSTERS)
def test_workers_end_with_a_killed_run(folder: Path, backend: str) -> None:
    """Agents of Ray itself, which no worker is, take longer."""
    run = subprocess.Popen(
        [sys.executable, "-c", f"import tasks; tasks.main({backend!r}, 'slow')"],
        cwd=folder,
        env=environment(folder),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 120
    while not (begun := list(folder.glob("worker-*"))) and time.monotonic() < deadline:
        time.sleep(0.05)
    workers = _processes({int(path.name.partition("-")[2]) for path in begun})
    run.kill()
    run.wait()
    assert workers
    _, alive = psutil.wait_procs(workers, timeout=30)
    assert not alive


def _processes(numbers: set[int]) -> list[psutil.Process]:
    return [psutil.Process(number) for number in numbers if psutil.pid_exists(number)]


@pytest.mark.skipif(not INSTALLED, reason="neither ray nor distributed is installed")
def test_scores_of_clusters_are_those_of_loky_to_the_bit(folder: Path) -> None:
    stranger = ("--entry", f"{folder}/stranger.py:Stranger")
    (folder / "stranger.py").write_text(
        "from roadscope.core import Detections\n"
        + STRANGER.replace(
            "def detect(self, frame): ...",
            "def detect(self, frame): return Detections.empty(frame.stamp_s)",
        )
    )
    expected = scores(folder, "loky", *stranger)
    assert expected
    for backend in INSTALLED:
        # All else is computed by the cluster itself.
        shutil.copytree(folder / "loky" / "sources", folder / backend / "sources")
        with cluster(folder, backend) as address:
            options = ["--backend", backend, "--address", address]
            assert scores(folder, backend, *stranger, *options) == expected, backend


@pytest.mark.parametrize("backend", CLUSTERS)
def test_a_cluster_that_does_not_answer_is_named_in_one_line(folder: Path, backend: str) -> None:
    address = {"ray": "127.0.0.1:9", "dask": "tcp://127.0.0.1:9"}[backend]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "roadscope",
            "leaderboard",
            "detection",
            "--suite",
            "tiny.toml",
            "--backend",
            backend,
            "--address",
            address,
            "--quiet",
        ],
        cwd=folder,
        env=environment(folder),
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 1
    assert "127.0.0.1:9" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
