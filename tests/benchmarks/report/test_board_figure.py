from xml.etree import ElementTree

import pytest
from made_up_pages import HOSTILE, results

from roadscope.benchmarks.report import draw_boards, save_all

SVG = "{http://www.w3.org/2000/svg}"


def words_of(path):
    return ["".join(word.itertext()) for word in ElementTree.parse(path).iter(f"{SVG}text")]


def test_every_entry_of_a_board_stands_once_in_rank_order(tmp_path):
    draw_boards(results(), tmp_path / "boards.svg")
    words = words_of(tmp_path / "boards.svg")
    assert [word for word in words if word in ("poor", "good", "good on oracle")] == [
        "good",
        "poor",
        "good on oracle",
    ]
    assert {"tracking board", "HOTA (higher is better)", "ms p50 (lower is better)"} <= set(words)


@pytest.mark.parametrize("entry", HOSTILE)
def test_a_name_of_any_kind_is_shown_as_it_is(tmp_path, entry):
    draw_boards(results(entry=entry), tmp_path / "boards.svg")
    assert entry in "".join(words_of(tmp_path / "boards.svg"))


def test_it_is_saved_with_the_boards_and_the_same_results_give_the_same_bytes(tmp_path):
    path = tmp_path / "boards.svg"
    assert path in save_all(results(), tmp_path)
    before = path.read_bytes()
    draw_boards(results(), path)
    assert path.read_bytes() == before
    draw_boards(results(more=1), path)
    assert path.read_bytes() != before
