import io

import pytest
from rich.console import Console

from roadscope.benchmarks import load_suite
from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.metrics import BANDS
from roadscope.benchmarks.report import breakdown_tables, note
from roadscope.benchmarks.results import Results, Row, Standing
from roadscope.envs.traffic import SCENARIOS

WIDTHS = (40, 80, 200)
PLACES = (
    Standing("detection", "distance-residual", None, 1, 1, 1),
    Standing("detection", "oracle", "upper mark"),
)
SHOWN = board_named("detection").shown_parts


def row(metric, by, band, value=0.5, entry="distance-residual", samples=10) -> Row:
    return Row("detection", entry, metric, value, 0.4, 0.6, 3, "1", "higher", by, band, samples)


def results(*parts: Row, places=PLACES) -> Results:
    whole = [
        Row(place.board, place.entry, "f1", 0.5, 0.4, 0.6, 3, "1", "higher") for place in places
    ]
    return Results({}, tuple(whole), (), parts, places)


def printed(of: Results, by: str, width: int = 80, board: str = "detection", **options) -> str:
    console = Console(file=io.StringIO(), width=width)
    for table in breakdown_tables(of, board, by, width, **options):
        console.print(table)
    return console.file.getvalue()


def lines_of(text: str) -> list[str]:
    return [" ".join(line.split()) for line in text.splitlines()]


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
    lines = lines_of(text)
    assert lines[0] == "detected by range, m"
    assert lines[1] == "detector 0-20 20-40"
    assert "distance-residual 0.75 0.25" in lines
    assert "oracle 1.00 -" in lines
    assert "to be found 1234 321" in lines
    assert "40-60" not in text
    assert "returns" not in text
    assert "precision by range, m" in lines
    assert "distance-residual 0.61" in lines


def test_one_metric_alone_where_it_is_asked_for() -> None:
    parts = [row(metric, "range", "0-20") for metric in ("detection_rate", "precision")]
    text = printed(results(*parts), "range", metrics=["precision"])
    assert "precision by" in text
    assert "detected by" not in text


def test_what_weather_hides_is_counted() -> None:
    unseen = Row(
        "detection",
        "oracle",
        "unseen_per_frame",
        1.25,
        1.0,
        1.5,
        3,
        "1/frame",
        "lower",
        "weather",
        "fog",
        60,
    )
    text = printed(results(row("detection_rate", "weather", "fog", samples=40), unseen), "weather")
    assert lines_of(text)[-2:] == ["to be found 40", "too few returns 75"]


def test_there_is_no_precision_by_what_false_alarms_do_not_have() -> None:
    text = printed(results(row("detection_rate", "occlusion", "none")), "occlusion")
    assert "detected by occlusion" in text
    assert "precision by" not in text
    assert "no precision" in note("detection", "occlusion")


def test_false_alarms_stand_beside_detection_rates() -> None:
    places = (Standing("camera", "network", None, 1, 1, 1),)
    parts = [
        Row("camera", "network", metric, value, None, None, 3, "1", "higher", "family", band, 9)
        for band, value in (("vehicle", 0.5), ("cyclist", 0.25))
        for metric in ("detection_rate", "false_alarms", "ap50")
    ]
    text = printed(results(*parts, places=places), "family", board="camera")
    assert "network 0.50 (0.50) 0.25 (0.25)" in lines_of(text)
    assert "detected (false alarms per image) by family" in lines_of(text)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("by", ["range", "category", "occlusion", "points"])
def test_every_figure_of_a_band_has_a_table_and_a_dash_where_it_is_not_known(by, width) -> None:
    first, *others = BANDS[by].labels
    parts = [row(column.metric, by, band, 2.34) for column in SHOWN for band in others]
    text = printed(results(*parts, row("detection_rate", by, first)), by, width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    words = " ".join(text.split())
    for column in SHOWN:
        assert f"{column.heading} by " in words
    assert text.count("2.34") == len(parts)
    assert any(line.startswith("oracle - -") for line in lines_of(text))


def test_what_false_detections_belong_to_is_said_of_the_board_that_it_holds_for() -> None:
    assert "by their own" in note("detection", "range")
    assert note("camera", "range") == ""


@pytest.mark.parametrize("width", WIDTHS)
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


@pytest.mark.parametrize("width", WIDTHS)
def test_no_name_of_a_scenario_is_cut_and_none_has_a_hyphen_made_by_hand(width) -> None:
    names = load_suite("tracking").scenarios
    text = printed(
        results(*(row("detection_rate", "scenario", n) for n in names)), "scenario", width
    )
    assert set(names) <= set(text.split())


def test_an_entry_is_shown_whole_however_long_it_is() -> None:
    entry = "examples/perception/mine.py:MyDetector?gate_m=2.5&coast_frames=20"
    places = (Standing("detection", entry, None, 1, 1, 1),)
    of = results(row("detection_rate", "range", "0-20", entry=entry), places=places)
    text = printed(of, "range", 40)
    assert max(map(len, text.splitlines())) <= 40
    body = text.partition("──")[2].splitlines()[1:]
    names = [line.split()[0] for line in body if line.strip() and "to be found" not in line]
    assert "".join(names) == entry


@pytest.mark.parametrize(
    "spec",
    [
        "noisy?miss=0.2&clutter=2",
        "fused?lidar=cluster-boxes&camera=network",
        "/a/an_extraordinarily_long_name.py:Mine",
        "fog:3 + night:2",
        "bad\x1b[2J\nname",
    ],
)
@pytest.mark.parametrize("width", WIDTHS)
def test_specs_as_headings_are_shown_whole_and_fit(spec, width) -> None:
    text = printed(results(row("detection_rate", "condition", spec)), "condition", width)
    assert max(map(len, text.splitlines())) <= width
    assert "\x1b" not in text
    heading = text.partition("──")[0].splitlines()[1:]
    words = [word for line in heading for word in line.replace("─", "").split()]
    letters = "".join(word for word in words if word != "detector")
    assert letters == "".join(spec.replace("\x1b", "?").split())


def test_ranks_on_the_same_detections_are_in_brackets() -> None:
    places = tuple(Standing("tracking", name, None, 1, 1, 1) for name in ("gnn", "nearest"))
    figures = {("gnn", "pag"): 0.4, ("nearest", "pag"): 0.5, ("gnn", "noisy"): 0.9}
    parts = [
        Row("tracking", e, "hota", v, None, None, 3, "1", "higher", "detector", band, 9)
        for (e, band), v in figures.items()
    ]
    lines = lines_of(printed(results(*parts, places=places), "detector", board="tracking"))
    assert "gnn 0.40 (2) 0.90 (1)" in lines
    assert "nearest 0.50 (1) -" in lines
