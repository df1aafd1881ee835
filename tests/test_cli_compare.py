import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
from simulated_runs import job, run, run_of


@pytest.fixture
def results(tmp_path) -> Path:
    """Return a folder of four runs: before, the same, worse, and one that failed."""
    rng = np.random.default_rng(0)
    before = rng.random((6, 3))
    worse = before.copy()
    worse[:, 1] -= 1 + 0.1 * rng.random(6)
    contents = {
        "before": run_of(before),
        "same": run_of(before),
        "worse": run_of(worse),
        "failed": run([job("mine", seed, {}, reason="boom") for seed in range(6)]),
        "old": {"manifest": {}, "rows": []},
    }
    for name, content in contents.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "leaderboard.json").write_text(json.dumps(content))
    return tmp_path


def test_equal_runs(results, answer) -> None:
    status, out, _ = answer(
        "compare", results / "before", results / "same", "--fail-on-regression", "--all"
    )
    assert status == 0
    assert "m0" in out


def test_a_regression_is_named_and_fails_if_asked(results, answer) -> None:
    both = results / "before", results / "worse" / "leaderboard.json"
    status, out, _ = answer("compare", *both, "--out", results / "new" / "found.json")
    assert status == 0
    assert "m1" in out
    assert "m2" not in out
    assert json.loads((results / "new" / "found.json").read_text())["regressed"] is True
    status, _, errors = answer("compare", *both, "--fail-on-regression")
    assert status == 1
    assert "m1" in errors
    assert "m0" not in errors
    assert answer("compare", *reversed(both), "--fail-on-regression")[0] == 0
    assert answer("compare", *both, "--metric", "m0", "--fail-on-regression")[0] == 0


def test_json_is_all_that_is_printed(results, answer) -> None:
    both = results / "before", results / "worse"
    status, out, errors = answer("compare", *both, "--json", "--fail-on-regression")
    assert (status, json.loads(out)["regressed"]) == (1, True)
    assert "m1" in errors
    assert answer("compare", *both, "--quiet") == (0, "", "")


def test_failures_fail(results, answer) -> None:
    status, out, errors = answer(
        "compare", results / "before", results / "failed", "--fail-on-regression"
    )
    assert status == 1
    assert "boom" in out
    assert "mine" in errors


def test_two_entries_of_one_file(tmp_path, answer) -> None:
    path = tmp_path / "leaderboard.json"
    jobs = [
        job(entry, seed, {"hota": 0.1 * seed + offset * (1 + 0.01 * seed)})
        for entry, offset in (("nearest", 0.2), ("existence", 0.5))
        for seed in range(5)
    ]
    path.write_text(json.dumps(run(jobs)))
    pair = "--entry", "nearest", "--entry", "existence"
    status, out, _ = answer("compare", path, *pair)
    assert status == 0
    assert "better" in out
    backwards = "--entry", "existence", "--entry", "nearest", "--fail-on-regression"
    assert answer("compare", path, *backwards)[0] == 1


def test_bad_input_is_answered_in_one_line(results, answer) -> None:
    for arguments in (
        [results / "before"],
        [results / "none", results / "before"],
        [results / "before", results / "old"],
        [results / "before", results / "same", "--metric", "hota"],
        [results / "before", "--entry", "mine", "--entry", "other"],
        [results / "before", "--entry", "mine"],
        [results / "before", results / "same", *["--entry", "mine"] * 3],
    ):
        status, out, errors = answer("compare", *arguments)
        assert (status, out) == (1, "")
        assert errors.startswith("error: ")
        assert errors.count("\n") == 1
