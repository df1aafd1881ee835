"""The study beside the information floor runs through, and judges what is asked of ours."""

import pytest

from research import zhang2017_floor as study
from research.information_floor import floor
from research.zhang2017_floor import (
    ASKED,
    BEATEN_OR_NEAR,
    EXACT_INSIDE,
    EXACT_NEES,
    FLOOR,
    INFORMED_FLOOR,
    RMSE_BESIDE,
    TWICE_FLOOR,
    TWICE_INFORMED_FLOOR,
    asked_of_ours,
    judged,
    measure,
)
from roadscope.benchmarks.papers import (
    FOLLOWED_M,
    HEADING,
    INSIDE,
    MULTI,
    NEES,
    OURS,
    POSITION,
    SIMULATED,
    DriveMethod,
    frames_name,
    sense_drive,
)

SEED = 12345
DRIVES = (*SIMULATED, *(f"following-{metres}" for metres in FOLLOWED_M))
WINDOWS = tuple(frames_name(frames) for frames in OURS.values())


@pytest.fixture(scope="module")
def measured():
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(study, "BODIES", ("rounded",))
        patched.setattr(study, "FOLLOWED_FRAMES", 4)
        patched.setattr(study, "sense_drive", few_frames)
        # How a floor depends on the frames is tested beside it.
        patched.setattr(study, "floors", a_single_floor)
        values = {key: [value] for key, value in measure(SEED).items()}
        yield values, judged(values)


def few_frames(name, seed, frames=2, **changes):
    return sense_drive(name, seed, frames=frames, **changes)


def a_single_floor(run, frames, *, draws, knowledge):
    return dict.fromkeys(frames, floor(run, draws=draws // 4, knowledge=knowledge))


@pytest.mark.slow
def test_ours_and_both_floors_are_in_every_table(measured):
    values, _ = measured
    expected = {MULTI, *OURS}
    expected |= {label.format(w) for label in (FLOOR, INFORMED_FLOOR) for w in WINDOWS}
    for drive in (*DRIVES, "curve, noise x2"):
        body = "sharp" if "noise" in drive else "rounded"
        name = RMSE_BESIDE.format(drive, body)
        assert {method for experiment, method, _ in values if experiment == name} == expected


@pytest.mark.slow
def test_every_drive_and_window_has_its_consistency(measured):
    values, rows = measured
    for experiment in (NEES, EXACT_NEES):
        name = experiment.format("rounded")
        known = {(drive, window) for e, drive, window in values if e == name}
        assert known == {(drive, window) for drive in DRIVES for window in WINDOWS}
    for experiment in (INSIDE, EXACT_INSIDE):
        name = experiment.format("rounded")
        known = {(row.method, row.quantity) for row in rows if row.experiment == name}
        assert known == {(drive, window) for drive in DRIVES for window in WINDOWS}


@pytest.mark.slow
def test_every_drive_is_judged(measured):
    _, rows = measured
    goal_rows = [row for row in rows if row.experiment == ASKED.format("rounded")]
    assert {row.method for row in goal_rows} == set(DRIVES)
    assert {row.quantity for row in goal_rows} == {
        TWICE_FLOOR,
        TWICE_INFORMED_FLOOR,
        BEATEN_OR_NEAR,
    }


def a_table(ours=(0.3, 0.02, 0.01), floors=(0.2, 0.015, 0.008), multi=0.8):
    values = {MULTI: multi, **dict(zip(OURS, ours, strict=True))}
    for window, value in zip(WINDOWS, floors, strict=True):
        values |= {FLOOR.format(window): value, INFORMED_FLOOR.format(window): 0.9 * value}
    return {
        DriveMethod(drive, method): dict.fromkeys((HEADING, POSITION), value)
        for drive in DRIVES
        for method, value in values.items()
    }


def test_ours_is_held_to_twice_the_floor():
    assert all(asked_of_ours(a_table(), "curve").values())
    far = asked_of_ours(a_table(ours=(0.3, 0.4, 0.01)), "curve")
    assert not far[TWICE_FLOOR]
    assert far[BEATEN_OR_NEAR]


def test_an_estimator_that_knows_the_radius_has_a_floor_of_its_own():
    goals = asked_of_ours(a_table(ours=(0.38, 0.02, 0.01)), "curve")
    assert goals[TWICE_FLOOR]
    assert not goals[TWICE_INFORMED_FLOOR]


def test_where_the_floor_is_above_the_papers_figure_twice_the_floor_is_asked():
    # The paper's multi frame has 0.0239 m on the straight.
    floors = (0.3, 0.1, 0.03)
    near = a_table(ours=(0.5, 0.15, 0.05), floors=floors)
    far = a_table(ours=(0.5, 0.15, 0.07), floors=floors)
    assert asked_of_ours(near, "straight")[BEATEN_OR_NEAR]
    assert not asked_of_ours(far, "straight")[BEATEN_OR_NEAR]


def test_following_ours_is_compared_with_the_papers_method_on_the_same_seeds():
    above = a_table(ours=(1.0, 0.95, 0.9), multi=0.8)
    assert not any(
        asked_of_ours(above, f"following-{metres}")[BEATEN_OR_NEAR] for metres in FOLLOWED_M
    )
