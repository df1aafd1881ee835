"""The page of a folder of boards: what it holds, its size, and texts that are never HTML."""

import json
import re
from html.parser import HTMLParser

import msgspec
import pytest
from made_up_pages import HOSTILE, moment, results

from roadscope.benchmarks import FolderError
from roadscope.benchmarks.metrics import Score
from roadscope.benchmarks.report import (
    MOST_BYTES,
    PAGE,
    Run,
    read_runs,
    save_all,
    save_moments,
    save_page,
)
from roadscope.benchmarks.results import JobScores, Results, results_of


class Reader(HTMLParser):
    """Collects elements, attributes and texts."""

    def __init__(self) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def read(text: str) -> Reader:
    reader = Reader()
    reader.feed(text)
    return reader


def content(text: str) -> list[dict[str, object]]:
    match = re.search(r'<script type="application/json" id="content">(.*?)</script>', text, re.S)
    assert match is not None
    boards: list[dict[str, object]] = json.loads(match[1])
    return boards


def test_a_page_has_every_entry_failure_and_moment(tmp_path) -> None:
    path = tmp_path / PAGE
    assert save_page([Run(results(), [moment("good")])], path) == []
    texts = " ".join(read(path.read_text()).texts)
    for wanted in ("good", "poor", "ZeroDivisionError: too small", "last words", "tiny 1"):
        assert wanted in texts
    (board,) = content(path.read_text())
    assert [each["kind"] for each in board["moments"]] == ["misses"]
    pairs = next(each for each in board["differences"] if each["metric"] == "hota")["pairs"]
    names = [entry["name"] for entry in board["entries"]]
    i, j, difference, low, high = pairs[0]
    assert {names[i], names[j]} == {"good", "poor"}
    assert (difference > 0) == (names[i] == "good")
    assert low <= difference <= high


def test_images_are_left_out_before_moments(tmp_path) -> None:
    path, images = tmp_path / PAGE, [bytes(range(256)) * 2000]
    moments = [moment("good", images=images), moment("poor", images=images)]
    left_out = save_page([Run(results(), moments)], path)
    assert left_out == []
    left_out = save_page([Run(results(), moments)], path, most_bytes=900_000)
    (board,) = content(path.read_text())
    assert [bool(each["images"]) for each in board["moments"]] == [True, False]
    assert any(" in 1 of " in text for text in left_out)
    assert path.stat().st_size <= 900_000


@pytest.mark.parametrize(("seeds", "has_intervals"), [(1, False), (4, True)])
def test_a_page_speaks_of_intervals_where_it_has_some(tmp_path, seeds, has_intervals) -> None:
    path = tmp_path / PAGE
    save_page([Run(results(seeds=seeds))], path)
    (board,) = content(path.read_text())
    pairs = [pair for each in board["differences"] for pair in each["pairs"]]
    assert any(low is not None for _, _, _, low, _ in pairs) == has_intervals
    texts = read(path.read_text()).texts
    (hint,) = [text for text in texts if text.startswith("Paired on")]
    assert ("95 %" in hint) == has_intervals
    assert any("Small figures are 95 %" in text for text in texts) == has_intervals


def test_a_page_has_rank_correlations_with_both_intervals(tmp_path) -> None:
    jobs = [
        JobScores("driving", f"idm on {k}", "motorway", seed, "clear", str(k), scores, None)
        for k in range(5)
        for seed in range(3)
        for scores in [
            {
                "recall": Score(k / 10, "1", "higher", 10),
                "reward": Score((0.1, 0.2, 0.3, 0.5, 0.4)[k], "1", "higher", 1),
            }
        ]
    ]
    save_page([Run(results_of(jobs, {"suite": "tiny"}))], tmp_path / PAGE)
    texts = [text.strip() for text in read((tmp_path / PAGE).read_text()).texts]
    at = texts.index("reward by recall")
    assert texts[at : at + 4] == ["reward by recall", "0.90", "[-.17, 1.00]", "[.90, .90]"]


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_name_is_text(tmp_path, name) -> None:
    path = tmp_path / PAGE
    save_page([Run(results(entry=name, reason=name, log=name), [moment(name)])], path)
    reader = read(path.read_text())
    assert not [tag for tag, _ in reader.elements if tag in ("img", "iframe", "b2")]
    assert not [key for _, named in reader.elements for key in named if key.startswith("on")]
    assert len([tag for tag, _ in reader.elements if tag == "script"]) == 2
    (board,) = content(path.read_text())
    shown = " ".join(name.split())
    assert shown in [entry["name"] for entry in board["entries"]]
    assert board["moments"][0]["entry"] == shown


def test_a_page_names_nothing_outside_of_it(tmp_path) -> None:
    path = tmp_path / PAGE
    save_page([Run(results(), [moment("good")])], path)
    reader = read(path.read_text())
    links = [
        value
        for tag, named in reader.elements
        for key, value in named.items()
        if key in ("src", "href", "action", "data", "srcset")
    ]
    assert links
    assert all(link.startswith(("#", "data:")) for link in links)
    assert "@import" not in path.read_text()
    policy = next(named for _, named in reader.elements if "http-equiv" in named)
    assert "default-src 'none'" in policy["content"]


def test_moments_that_do_not_fit_are_left_out_and_it_says_so(tmp_path) -> None:
    path = tmp_path / PAGE
    long = [moment("good", text=f"{k} " + 20_000 * "x") for k in range(100)]
    (message,) = save_page([Run(results(), long)], path)
    assert path.stat().st_size <= MOST_BYTES
    (board,) = content(path.read_text())
    shown_moments = len(board["moments"])
    assert 60 < shown_moments < 100
    assert f"{100 - shown_moments} of 100" in message
    assert message in " ".join(read(path.read_text()).texts)
    assert [each["text"].split()[0] for each in board["moments"]] == [
        str(k) for k in range(shown_moments)
    ]
    left_out = {each["name"]: each["left_out"] for each in board["entries"]}
    assert left_out == {"good": 100 - shown_moments, "poor": 0, "good on oracle": 0}


def with_failures(count: int) -> Results:
    """Return results in which an entry fails for many reasons, with much output."""
    failed = [
        JobScores("tracking", "bad", "merge", k, "clear", "pag", {}, f"bad: {k}", log=4000 * "x")
        for k in range(count)
    ]
    usual = results()
    return results_of([*usual.jobs, *failed], usual.manifest)


@pytest.mark.parametrize(
    ("boards", "failures", "limit", "cuts"),
    [
        (1, 0, MOST_BYTES, set()),
        (10, 0, MOST_BYTES, set()),
        (10, 40, MOST_BYTES, {"Breakdowns", "Captured"}),
        (10, 0, 110_000, {"Breakdowns", "Entries"}),
        (10, 0, 75_000, {"Breakdowns", "Entries", "Boards"}),
    ],
)
def test_a_page_is_never_larger_than_it_may_be(tmp_path, boards, failures, limit, cuts) -> None:
    path, moments = tmp_path / PAGE, [moment("good"), moment("good", text=1_500_000 * "x")]
    messages = save_page([Run(with_failures(failures), moments)] * boards, path, most_bytes=limit)
    assert path.stat().st_size <= limit
    first_words = [text.split()[0] for text in messages]
    assert len(first_words) == len(set(first_words))
    assert first_words[-1].isdecimal()  # The number of moments that are left out.
    assert cuts <= set(first_words)
    assert bool(cuts) == ("Breakdowns" in first_words)
    shown = " ".join(read(path.read_text()).texts)
    assert all(text in shown for text in messages)
    boards_shown = content(path.read_text())
    assert ("Boards" in first_words) == (len(boards_shown) < boards)
    assert all(len(each["text"]) < 100 for board in boards_shown for each in board["moments"])
    assert all(e["name"] == "good" for board in boards_shown for e in board["entries"][:1])


def test_what_was_saved_is_read(tmp_path) -> None:
    saved = results()
    save_all(saved, tmp_path)
    save_moments([moment("good")], tmp_path)
    other = results(suite="other", entry="third")
    save_all(other, tmp_path)
    save_moments([], tmp_path)
    latest, before = read_runs(tmp_path)
    assert (latest.results.manifest["suite"], before.results.manifest["suite"]) == ("other", "tiny")
    assert before.moments == [moment("good")]
    assert latest.moments == []
    assert before.results.rows == saved.rows
    assert before.results.standings == saved.standings
    assert before.results.failures == saved.failures
    save_page([latest, before], tmp_path / PAGE)
    assert len(content((tmp_path / PAGE).read_text())) == 2


def test_a_replay_that_cannot_be_read_is_reported(tmp_path) -> None:
    save_all(results(), tmp_path)
    (tmp_path / "replay.json").write_text('[{"board": 1}]')
    (run,) = read_runs(tmp_path)
    (message,) = save_page([run], tmp_path / PAGE)
    assert "replay.json" in message
    assert msgspec.json.decode((tmp_path / "replay.json").read_bytes())


@pytest.mark.parametrize("text", ["", "[]", '{"manifest": 1}', '{"manifest": {}, "rows": [1]}'])
def test_a_folder_without_boards_is_refused(tmp_path, text) -> None:
    with pytest.raises(FolderError, match="leaderboard --out"):
        read_runs(tmp_path)
    (tmp_path / "leaderboard.json").write_text(text)
    with pytest.raises(FolderError, match=r"leaderboard\.json"):
        read_runs(tmp_path)


def test_the_command_writes_the_page(tmp_path, answer) -> None:
    save_all(results(), tmp_path)
    status, out, errors = answer("report", tmp_path)
    assert (status, errors) == (0, "")
    assert str(tmp_path / PAGE) in out
    assert (tmp_path / PAGE).is_file()
    elsewhere = tmp_path / "new" / "mine.html"
    assert answer("report", tmp_path, "--out", elsewhere, "--quiet") == (0, "", "")
    assert elsewhere.is_file()
    assert answer("report", tmp_path / "nothing")[0] == 1
    assert answer("report", tmp_path, "--out", tmp_path / "page.txt")[0] == 1


@pytest.mark.parametrize("has_browser", [True, False])
def test_the_page_is_shown_in_a_browser_if_there_is_one(
    tmp_path, answer, monkeypatch, has_browser
) -> None:
    shown: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda address: shown.append(address) or has_browser)
    save_all(results(), tmp_path)
    status, _, errors = answer("report", tmp_path, "--open")
    assert status == 0
    assert shown == [(tmp_path / PAGE).as_uri()]
    assert (str(tmp_path / PAGE) in errors) == (not has_browser)
