"""What every board says of itself fits together."""

import pytest

from roadscope import load_suite
from roadscope.benchmarks import CallTimes
from roadscope.benchmarks.boards import (
    BOARDS,
    RECORDED_BOARDS,
    Board,
    JobOptions,
    board_named,
    boards_of,
    call_cost,
    chosen_boards,
    episodes,
)
from roadscope.core import Spec, SpecError

EVERY = (*BOARDS.values(), *RECORDED_BOARDS.values())
ENTRY = {
    "detection": "pag",
    "tracking": "nearest",
    "camera": "colour-blobs",
    "fusion": "union",
    "odometry": "voxel-map",
    "driving": "idm",
}


@pytest.mark.parametrize("board", EVERY, ids=lambda board: board.name)
def test_a_board_is_consistent(board: Board) -> None:
    metrics = [column.metric for column in board.columns]
    assert metrics[0] == board.headline
    assert len(set(metrics)) == len(metrics)
    by = [breakdown.by for breakdown in board.breakdowns]
    assert len(set(by)) == len(by)
    assert set(board.conditions) <= set(by)
    assert not board.inputs_name or board.inputs_name in by
    assert board.headline in board.by_condition or board.name == "odometry"
    assert board.always_by is None or board.always_by[0] in by
    assert board_named(board.name) is board


@pytest.mark.parametrize("board", EVERY, ids=lambda board: board.name)
def test_every_column_of_a_board_is_explained_or_plain(board: Board) -> None:
    assert {"call_p50_ms", "wall_p50_ms"} <= {column.metric for column in board.columns}
    for column in board.columns:
        assert column.heading.strip()
        assert column.decimals >= 0


@pytest.mark.slow
@pytest.mark.parametrize("name", BOARDS)
def test_jobs_are_every_entry_on_every_episode_and_marks_where_they_are_wanted(name) -> None:
    board, suite = BOARDS[name], load_suite(BOARDS[name].default_suite)
    spec = board.check_entry(Spec.parse(ENTRY[name]))
    alone = board.jobs(suite, [spec], JobOptions(marks=False))
    marked = board.jobs(suite, [spec], JobOptions(marks=True))
    ranked = {job.entry for job in alone if job.mark is None}
    rows = {ENTRY[name]}
    if name == "driving":
        rows = {f"{ENTRY[name]} on {stack}" for stack in suite.boards[name].stacks}
    assert ranked == rows
    assert {job.episode for job in alone} == set(episodes(suite))
    assert {job.key for job in alone} <= {job.key for job in marked}
    assert len({job.key for job in marked}) == len(marked)
    others = {job.entry: job.mark for job in marked if job.entry not in rows}
    assert all(others.values())
    assert all(job.board is board for job in marked)


def test_a_drive_without_sensors_serves_all_faults() -> None:
    board, suite = BOARDS["driving"], load_suite("driving-faults")
    jobs = board.jobs(suite, [board.check_entry(Spec.parse("idm"))], JobOptions(marks=True))
    marked = [job for job in jobs if job.mark]
    ranked = [job for job in jobs if not job.mark]
    conditions = len({job.episode.condition for job in jobs})
    assert conditions == 5
    assert len(marked) == conditions * len({job.answers.path for job in marked})
    assert len(ranked) == len({job.answers.path for job in ranked})


def test_plug_ins_of_another_kind_are_refused_by_every_board() -> None:
    for name, board in BOARDS.items():
        for kind, text in ENTRY.items():
            if kind != name:
                with pytest.raises(SpecError):
                    board.check_entry(Spec.parse(text))


def test_boards_are_chosen_by_name_or_by_the_entries_of_a_suite() -> None:
    quick = load_suite("quick")
    assert [board.name for board in boards_of(quick)] == [
        board.name for board in chosen_boards(quick, None)
    ]
    assert [board.name for board in chosen_boards(quick, ["odometry"])] == ["odometry"]
    with pytest.raises(SpecError, match=r"'drift'.*detection"):
        chosen_boards(quick, ["drift"])
    with pytest.raises(SpecError, match=r"'drift'.*detection"):
        board_named("drift")


def test_cost_is_of_the_processor_and_of_the_clock_without_the_first_call() -> None:
    import numpy as np

    times = CallTimes(np.array([900.0, 1.0, 2.0, 3.0]), np.array([990.0, 10.0, 20.0, 30.0]))
    costs = call_cost(times)
    assert costs["call_p50_ms"].value == pytest.approx(2.0)
    assert costs["call_p99_ms"].value <= 3.0
    assert costs["wall_p50_ms"].value == pytest.approx(20.0)
    assert {score.unit for score in costs.values()} == {"ms"}
