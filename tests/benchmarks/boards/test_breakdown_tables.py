import io

import pytest
from rich.console import Console

from roadscope.benchmarks.boards.breakdown_tables import (
    HEADINGS,
    SHOWN,
    breakdown_tables,
    heading,
    note,
)
from roadscope.benchmarks.boards.results import BreakdownError, Results, check_breakdown
from roadscope.benchmarks.boards.rows import Row
from roadscope.benchmarks.boards.standing import Standing
from roadscope.benchmarks.metrics.breakdown import BANDS
from roadscope.benchmarks.suite import load_suite
from roadscope.envs.traffic.scenarios import SCENARIOS

PLACES = (
    Standing("detection", "distance-residual", None, 1, 1, 1),
    Standing("detection", "oracle", "upper mark"),
)


def row(metric, by, band, value=0.5, entry="distance-residual", samples=10) -> Row:
    return Row("detection", entry, metric, value, 0.4, 0.6, 3, "1", "higher", by, band, samples)


def results(*parts: Row) -> Results:
    whole = [
        Row("detection", place.entry, "f1", 0.5, 0.4, 0.6, 3, "1", "higher") for place in PLACES
    ]
    return Results({}, tuple(whole), (), parts, PLACES)


def printed(found: Results, by: str, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width)
    for table in breakdown_tables(found, "detection", by, width):
        console.print(table)
    return console.file.getvalue()


def test_entries_by_bands_with_what_was_to_be_found() -> None:
    text = printed(
        results(
            row("detection_rate", "range", "20-40", 0.25, samples=321),
            row("detection_rate", "range", "0-20", 0.75, samples=1234),
            row("precision", "range", "0-20", 0.61),
            row("precision", "range", "40-60", 1.0),
            row("detection_rate", "range", "0-20", 1.0, "oracle", samples=1234),
        ),
        "range",
    )
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert lines[0] == "detected by range, m"
    assert lines[1] == "detector 0-20 20-40"
    assert "distance-residual 0.75 0.25" in lines
    assert "oracle 1.00 -" in lines
    assert "to be found 1234 321" in lines
    assert "40-60" not in text
    assert "returns" not in text
    assert "precision by range, m" in lines
    assert "distance-residual 0.61" in lines


def test_what_weather_hides_is_counted() -> None:
    unseen = Row("detection", "oracle", "unseen_per_frame", 1.25, 1.0, 1.5, 3, "1/frame", "lower",
                 "weather", "fog", 60)  # fmt: skip
    text = printed(results(row("detection_rate", "weather", "fog", samples=40), unseen), "weather")
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert lines[-2:] == ["to be found 40", "too few returns 75"]


def test_there_is_no_precision_by_what_false_alarms_do_not_have() -> None:
    text = printed(results(row("detection_rate", "occlusion", "none")), "occlusion")
    assert "detected by occlusion" in text
    assert "precision" not in text
    assert "there is no precision" in note("detection", "occlusion")


@pytest.mark.parametrize("width", [50, 80])
@pytest.mark.parametrize("by", ["range", "category", "occlusion", "points"])
def test_every_score_of_a_band_has_a_table_and_a_dash_where_it_is_not_known(by, width) -> None:
    first, *others = BANDS[by].labels
    parts = [row(metric, by, band, 12.34) for metric in SHOWN["detection"] for band in others]
    text = printed(results(*parts, row("detection_rate", by, first)), by, width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    for metric in SHOWN["detection"]:
        assert f"{HEADINGS[metric]} by " in text
    assert text.count("12.34") == len(parts)
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert any(line.startswith("oracle - -") for line in lines)


def test_what_false_detections_belong_to_is_said_of_the_board_that_it_holds_for() -> None:
    assert "by their own" in note("detection", "range")
    assert note("camera", "range") == note("detection", "weathers") == ""


@pytest.mark.parametrize("width", [30, 50, 80, 120])
def test_bands_that_do_not_fit_continue_below(width) -> None:
    parts = [
        row("detection_rate", "scenario", name, samples=1000 + i)
        for i, name in enumerate(SCENARIOS)
    ]
    text = printed(results(*parts), "scenario", width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    words = text.split()
    assert " ".join(words).count("detected by scenario") == 1 + words.count("continued") > 1
    shown = [int(word) for word in words if word.isdigit()]
    assert shown == list(range(1000, 1000 + len(SCENARIOS)))


def test_eight_scenarios_fit_80_columns() -> None:
    names = load_suite("detection").scenarios
    found = results(*(row("detection_rate", "scenario", name, samples=12345) for name in names))
    assert len(names) == 8
    assert "continued" not in printed(found, "scenario")


def test_the_twelve_scenarios_of_the_tracking_suite_take_two_tables() -> None:
    names = load_suite("tracking").scenarios
    found = results(*(row("detection_rate", "scenario", name) for name in names))
    assert len(names) == 12
    assert printed(found, "scenario").count("detected by scenario") == 2


def test_long_headings_are_broken() -> None:
    assert heading("motorway") == "motor-\nway"
    assert heading("200+") == "200+"
    assert heading("my-extraordinary-road") == "my\nextraor-\ndinary\nroad"


@pytest.mark.parametrize(
    ("spec", "lines"),
    [
        ("noisy?miss=0.2&clutter=2", ["noisy?", "miss=0.2&", "clutter=2"]),
        ("fused?lidar=cluster-boxes&camera=network",
         ["fused?", "lidar=cluster-boxes&", "camera=network"]),
        ("distance-l-shape?eps_m=0.8", ["distance", "l-shape?", "eps_m=0.8"]),
        ("examples/mine.py:Mine?gate_m=2.5", ["examples/", "mine.py:", "Mine?", "gate_m=2.5"]),
        ("/a/an_extraordinarily_long_name.py:Mine",
         ["/", "a/", "an_extraordinarily_lon", "g_name.py:", "Mine"]),
        ("mine.detectors:Mine", ["mine.detectors:", "Mine"]),
        ("fog:3 + night:2", ["fog:3", "night:2"]),
    ],
)  # fmt: skip
@pytest.mark.parametrize("width", [50, 80])
def test_specs_are_broken_at_their_arguments_and_fit(spec, lines, width) -> None:
    assert heading(spec).split("\n") == lines
    text = printed(results(row("detection_rate", "condition", spec)), "condition", width)
    assert max(map(len, text.splitlines())) <= width


def test_unknown_breakdowns_are_refused_with_what_there_is() -> None:
    with pytest.raises(
        BreakdownError, match=r"no detection breakdown 'rnage' \(did you mean 'range'"
    ):
        results().breakdown("rnage")
    with pytest.raises(BreakdownError, match="no tracking breakdown 'range'; known: weather, scen"):
        check_breakdown("range", ["tracking"])
    check_breakdown("range", ["detection", "tracking"])
