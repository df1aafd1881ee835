"""Settings shared by all tests."""

import gc
import os
import signal
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from importlib import metadata
from pathlib import Path

import pytest
from hypothesis import settings

# Processes that tests start, and the next run, read byte code instead of compiling all sources.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Workers share the cores. This stands before the first import of NumPy.
for library in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# Shared machines stall for longer than any deadline; a fixed seed keeps CI repeatable.
settings.register_profile("roadscope", deadline=None, max_examples=50, derandomize=True)
settings.load_profile("roadscope")


LONGEST = tuple(
    f"tests/{name}.py"
    for name in (
        "benchmarks/papers/test_li2021_claims",
        "torture/test_all_entries",
        "commands/test_help",
        "test_tutorials",
        "benchmarks/train/test_train_driver",
        "odometry/test_empty_roads",
        "test_cli",
        "benchmarks/test_clusters",
        "torture/test_deadlines",
        "torture/test_loading",
        "odometry/test_convoys",
        "torture/test_trust_and_sandbox",
        "research/test_shipped_traits",
        "test_examples",
        "benchmarks/papers/test_figures",
        "benchmarks/test_workers_speed",
        "benchmarks/test_run",
        "benchmarks/isolation/test_cost",
        "benchmarks/test_keys",
        "torture/test_kept_files",
        "benchmarks/boards/test_sixth_board",
        "envs/gym/test_agent_traffic",
        "benchmarks/test_target_views",
        "benchmarks/papers/test_zhang2022",
        "benchmarks/papers/test_zhang2017",
        "fusion/test_fused_tracks",
        "test_site",
        "envs/traffic/test_scenarios",
        "research/test_zhang2017_calibration",
    )
)
"""Files that take half a minute and more, the longest first: nothing runs beside what a worker
begins last."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """Start no workers for a single file: it runs in one of them anyway, and they take seconds."""
    files = {argument.partition("::")[0] for argument in config.args}
    alone = len(files) == 1 and files.pop().endswith(".py")
    return 0 if alone else None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect no garbage meanwhile, nor look later at what is collected: it stays."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> Generator[None, object, object]:
    """Let most cases of tests marked `sampled` be slow, and long files be first."""
    _make_others_slow(items)
    result = yield
    counts = Counter(item.path for item in items)
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(
        key=lambda item: (
            places.get(item.nodeid.partition("::")[0], len(LONGEST)),
            -counts[item.path],
        )
    )
    return result


def _make_others_slow(items: list[pytest.Item]) -> None:
    """Mark the cases of tests marked `sampled(n)` slow, but n that are evenly spread."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("sampled"):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for of_test in cases.values():
        mark = of_test[0].get_closest_marker("sampled")
        assert mark is not None
        (count,) = mark.args
        quick = {len(of_test) * (2 * k + 1) // (2 * count) for k in range(count)}
        for number, item in enumerate(of_test):
            if number not in quick:
                item.add_marker(pytest.mark.slow)


@pytest.fixture(autouse=True, scope="session")
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Keep what tests cache away from the user's cache."""
    path = tmp_path_factory.mktemp("cache")
    before = os.environ.get("ROADSCOPE_CACHE")
    os.environ["ROADSCOPE_CACHE"] = str(path)
    yield path
    if before is None:
        del os.environ["ROADSCOPE_CACHE"]
    else:
        os.environ["ROADSCOPE_CACHE"] = before


@pytest.fixture
def answer(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Run the command line in this process; return its status, output and errors."""
    from roadscope.__main__ import main

    def run_it(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["roadscope", *map(str, arguments)])
        monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)
        handler = signal.getsignal(signal.SIGTERM)
        with pytest.raises(SystemExit) as ended:
            main()
        signal.signal(signal.SIGTERM, handler)
        text = capsys.readouterr()
        return int(ended.value.code or 0), text.out, text.err

    return run_it


@pytest.fixture
def uninstall(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Return a function that takes the name of a distribution, which is then not installed."""

    def hide(hidden: str) -> None:
        find = metadata.distribution

        def distribution_of(name: str) -> metadata.Distribution:
            if name == hidden:
                raise metadata.PackageNotFoundError(name)
            return find(name)

        monkeypatch.setattr(metadata, "distribution", distribution_of)

    return hide
