import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import toy_paper
from rich.console import Console

from roadscope.benchmarks.papers import (
    FAILS,
    HOLDS,
    OPEN,
    POINTS,
    YES_OR_NO,
    ClaimRange,
    FigureKey,
    ReproductionRow,
    Verdict,
    differences,
    judge,
    judge_share,
    measure_paper,
    reproduce_module,
    reproduction_tables,
    summarise,
    verdict_table,
    write_reproduction,
)

KEY = FigureKey("one", "pag", "error")


# Parts that are kept.


@pytest.fixture
def log(tmp_path, monkeypatch):
    path = tmp_path / "log"
    monkeypatch.setenv("TOY_PAPER_LOG", str(path))
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path / "cache"))
    return path


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_parts_of_all_seeds_are_measured_once_and_stored(log, jobs):
    done = []
    measured = measure_paper("toy_paper", 3, lambda *progress: done.append(progress), jobs=jobs)
    assert measured[toy_paper.KEY] == [0.0, 1.0, 2.0]
    assert measured[toy_paper.TWICE] == [0.0, 2.0, 4.0]
    assert np.array_equal(measured[toy_paper.FEW], [0.0, np.nan, np.nan], equal_nan=True)
    assert toy_paper.HIDDEN not in measured
    assert done == [(k, 6) for k in range(7)]
    calls = sorted(log.read_text().splitlines())
    assert calls == [f"{part} {20000 + k}" for part in ("long", "short") for k in range(3)]
    again = measure_paper("toy_paper", 4, jobs=jobs)
    assert sorted(log.read_text().splitlines()) == sorted([*calls, "long 20003", "short 20003"])
    assert again[toy_paper.KEY] == [0.0, 1.0, 2.0, 3.0]


def test_a_damaged_part_is_measured_again(log, tmp_path):
    measure_paper("toy_paper", 1)
    (cached_file, *_) = sorted((tmp_path / "cache" / "papers").iterdir())
    cached_file.write_bytes(cached_file.read_bytes()[:-3])
    with pytest.warns(UserWarning, match=cached_file.name):
        assert measure_paper("toy_paper", 1)[toy_paper.KEY] == [0.0]
    assert len(log.read_text().splitlines()) == 3


def test_a_reproduction_is_written_as_json(log, tmp_path):
    result = reproduce_module("toy_paper", 3)
    write_reproduction(result, tmp_path / "toy.json")
    content = json.loads((tmp_path / "toy.json").read_text())
    assert content == json.loads(json.dumps(asdict(result)))
    assert [each["verdict"] for each in content["verdicts"]] == [OPEN]
    with pytest.raises(ValueError, match="at least one seed"):
        reproduce_module("toy_paper", 0)


# Intervals and verdicts.


def test_interval_is_students_and_within_what_can_be():
    from scipy.stats import t

    values = [1.0, 2.0, 4.0, 4.5]
    row = summarise(KEY, "m", [*values, np.nan])
    low, high = t.interval(0.95, 3, loc=np.mean(values), scale=np.std(values, ddof=1) / 2)
    assert (row.low, row.high) == pytest.approx((max(low, 0), high))
    row = summarise(KEY, "share", [1.0, 0.5, 0.0])
    assert (row.low, row.high) == (0.0, 1.0)
    assert summarise(KEY, POINTS, [1.0, -1.0, 0.0]).low < 0
    one = summarise(KEY, "m", [2.0, np.nan])
    assert (one.ours, one.low, one.high, one.n) == (2.0, None, None, 1)
    with pytest.raises(ValueError, match=r"the paper gives 0\.5 m for 'error'"):
        summarise(KEY, "m", [np.nan], 0.5)


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ([0.8, 0.9, 0.85], HOLDS),
        ([1.2, 1.3, 1.25], FAILS),
        ([0.8, 1.3, 0.9], OPEN),
        ([0.9], HOLDS),
        ([1.1, np.nan], FAILS),
        ([np.nan], OPEN),
    ],
)
def test_a_claim_is_judged_by_the_interval_of_its_figure(values, verdict):
    assert judge("small", "ours", "m", values, ClaimRange(high=1.0)).verdict == verdict


def test_a_share_of_seeds_has_wilsons_interval():
    z = 1.959964
    for yes, n, verdict in ((30, 30, HOLDS), (3, 30, FAILS), (14, 30, OPEN), (0, 1, FAILS)):
        judged = judge_share("often", "ours", [1.0] * yes + [0.0] * (n - yes))
        assert judged.verdict == verdict
        if n > 1:
            share = yes / n
            middle = (share + z**2 / 2 / n) / (1 + z**2 / n)
            half = z * np.sqrt(share * (1 - share) / n + (z / 2 / n) ** 2) / (1 + z**2 / n)
            interval = pytest.approx((100 * (middle - half), 100 * (middle + half)))
            assert (judged.low, judged.high) == interval


def test_differences_are_of_the_same_seed():
    other = KEY._replace(method="distance")
    measured = {KEY: [1.0, 2.0, np.nan], other: [0.5, 3.0, 1.0]}
    assert np.array_equal(differences(measured, KEY, other), [0.5, -1.0, np.nan], equal_nan=True)


# Tables.


def row(method, quantity, paper, ours=0.5, unit="m", half=0.1):
    return ReproductionRow("one", method, quantity, unit, paper, ours, ours - half, ours + half, 30)


def printed(tables) -> str:
    console = Console(width=80)
    with console.capture() as captured:
        for table in tables:
            console.print(table)
    return captured.get()


def words(rows) -> list[list[str]]:
    return [line.split() for line in printed(reproduction_tables(rows)).splitlines() if line]


def test_intervals_and_the_papers_figures_stand_below_ours():
    rows = [
        row(method, quantity, paper, unit=unit)
        for method, paper in (("single", 0.25), ("ours", None))
        for quantity, unit in (("position", "m"), ("heading", "deg"))
    ]
    lines = words(rows)
    assert lines[0] == ["position,", "m", "heading,", "deg"]
    assert lines[2:5] == [
        ["single", "0.5000", "0.500"],
        ["95", "%", "0.400", "-", "0.600", "0.400", "-", "0.600"],
        ["paper", "0.25", "0.25"],
    ]
    assert ["paper"] not in [line[:1] for line in lines[5:]]


def test_methods_of_the_paper_with_many_quantities_stand_beside_each_other():
    rows = [
        row(method, f"quantity {k}", paper)
        for method, paper in (("literal", 1.0), ("reading", 1.0), ("other", None))
        for k in range(7)
    ]
    lines = words(rows)
    assert lines[0] == ["paper", "literal", "reading"]
    assert len(lines) == 9
    everything = printed(reproduction_tables(rows, everything=True))
    assert "other" in everything


def test_claims_are_answered_in_words_and_what_is_missing_by_a_dash():
    claims = [
        ReproductionRow("claims", "ours", name, YES_OR_NO, None, value, None, None, 1)
        for name, value in (("close", 1.0), ("closer", 0.0), ("unknown", None))
    ]
    assert words(claims)[2] == ["ours", "yes", "no", "-"]


@pytest.mark.parametrize("columns", [1, 5, 9])
@pytest.mark.parametrize("ours", [0.036, 1136.02, 81234.5])
def test_tables_fit_80_columns(columns, ours):
    rows = [
        row(method, f"quantity of {i}", 94.8, ours, "ms", 2 * ours)
        for method in ("a-method-of-23-letters-", "b")
        for i in range(columns)
    ]
    text = printed(reproduction_tables(rows, everything=True))
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= 80


def test_verdicts_fit_80_columns_whole():
    long = Verdict("what the paper claims " * 5, "single frame", "m more", FAILS, -1e-4, -1, 2, 30)
    text = printed([verdict_table([long, replace(long, verdict=OPEN, low=None, high=None)])])
    assert "…" not in text
    assert text.count(FAILS) == text.count(OPEN) == 1
