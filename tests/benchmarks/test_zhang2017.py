"""The experiments run through; what they show is in the figures, not asserted here."""

import numpy as np
import pytest

from roadscope.benchmarks import zhang2017
from roadscope.benchmarks.papers import PAPERS, note_of
from roadscope.benchmarks.zhang2017_claims import floor_name, our_claims, paper_claims
from roadscope.benchmarks.zhang2017_drives import FOLLOWED_M
from roadscope.benchmarks.zhang2017_errors import (
    HEADING,
    LATERAL,
    LONGITUDINAL,
    POSITION,
    SILENT,
    TURNED,
    errors,
    rmse,
    typical,
)
from roadscope.benchmarks.zhang2017_floor import floor
from roadscope.benchmarks.zhang2017_methods import METHODS, MULTI, OURS, RANSAC, SINGLE, estimate
from roadscope.benchmarks.zhang2017_scene import film
from roadscope.detectors.pose.estimate import VehiclePose

SEED = 12345
"""Outside the seeds of the published figures."""
DRIVES = (*zhang2017.SIMULATED, *(f"following-{metres}" for metres in FOLLOWED_M))


@pytest.fixture(scope="module")
def run():
    return film("curve", SEED, frames=6)


def displaced(run, along=0.0, across=0.0, turn=0.0):
    x, y, yaw = run.truth.T
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = x + along * c - across * s, y + along * s + across * c
    return [VehiclePose(*place, 4.87, 1.85) for place in zip(x, y, yaw + turn, strict=True)]


def test_errors_are_along_and_across_the_car(run):
    found = rmse(run, errors(run, displaced(run, along=0.3, across=-0.4, turn=0.1)))
    assert found == pytest.approx(
        {LATERAL: 0.4, LONGITUDINAL: 0.3, HEADING: np.degrees(0.1), POSITION: 0.5}
    )


def test_half_a_turn_is_no_error_and_a_quarter_is_counted(run):
    half = errors(run, displaced(run, turn=np.pi))
    assert rmse(run, half)[HEADING] == pytest.approx(0, abs=1e-9)
    quarter = displaced(run)[:3] + displaced(run, turn=np.pi / 2)[3:]
    assert typical(run, errors(run, quarter))[TURNED] == 0.5


def test_frames_without_an_answer_are_counted(run):
    poses = [None, *displaced(run)[1:]]
    assert typical(run, errors(run, poses))[SILENT] == pytest.approx(1 / 6)
    assert np.isfinite(rmse(run, errors(run, poses))[POSITION])
    assert typical(run, errors(run, [None] * 6))[SILENT] == 1.0


@pytest.mark.parametrize("name", METHODS)
def test_every_method_answers_for_every_frame_near_the_truth(run, name):
    poses, spent = estimate(METHODS[name], run)
    assert len(poses) == len(run.shots)
    assert 0 < len(spent) <= len(poses)
    assert (spent >= 0).all()
    off = errors(run, poses)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.5
    assert np.abs(off[:, 2]).max() < np.radians(10)


def test_empty_frames_have_no_answer_and_stop_nothing():
    run = film("straight", SEED)
    empty = [k for k, shot in enumerate(run.shots) if not shot.target.any()]
    assert empty
    for name in (SINGLE, MULTI, RANSAC):
        poses, _ = estimate(METHODS[name], run)
        assert [k for k, pose in enumerate(poses) if pose is None] == empty


@pytest.fixture(scope="module")
def rows():
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(zhang2017, "FIRST_SEED", SEED)
        patched.setattr(zhang2017, "FLOOR_SEEDS", 1)
        patched.setattr(zhang2017, "FLOOR_DRAWS", 128)
        patched.setattr(zhang2017, "FOLLOWED_FRAMES", 5)
        patched.setattr(zhang2017, "BODIES", ("rounded",))
        patched.setattr(zhang2017, "film", few_frames)
        # How it depends on the frames is tested beside it.
        patched.setattr(zhang2017, "floor", lambda run, _, draws: floor(run, 1, draws=draws))
        done: list[tuple[int, int]] = []
        found = zhang2017.reproduce(2, lambda *progress: done.append(progress))
        assert done == [(1, 2), (2, 2)]
        return found


def few_frames(name, seed, frames=2, **changes):
    return film(name, seed, frames=frames, **changes)


def test_every_figure_of_the_paper_stands_beside_ours(rows):
    printed = {(row.experiment, row.method, row.quantity): row.paper for row in rows if row.paper}
    for drive, table in zhang2017.SIMULATED.items():
        for (of, method), figures in zhang2017.PAPER.items():
            for quantity, figure in figures.items():
                name = f"{drive}, rounded body ({table})"
                assert of != table or printed[name, method, quantity] == figure
    for method, figures in zhang2017.PAPER_TIMES.items():
        for quantity, figure in figures.items():
            assert printed[zhang2017.TIMES, method, quantity] == figure
    assert all(row.ours is not None for row in rows if row.paper is not None)


def test_every_method_and_the_floor_are_in_every_table(rows):
    methods = {row.method for row in rows if row.experiment == "curve, rounded body (table 2)"}
    assert methods == {*METHODS, *map(floor_name, OURS.values()), "the drive"}
    followed = {
        row.quantity for row in rows if row.experiment == "following, rounded body: heading RMSE"
    }
    assert followed == {f"{metres} m" for metres in FOLLOWED_M}
    assert {row.n for row in rows if row.method in METHODS} == {2}
    assert {row.n for row in rows if row.method.startswith("floor")} == {1}
    units = {(row.unit, row.method == "the drive") for row in rows}
    assert units == {(u, False) for u in ("m", "deg", "ms", "1", "share")} | {("count", True)}


def test_printed_positions_follow_from_their_parts():
    """Only two of the six printed sums do; where they do not, the note says what is printed."""
    for row in zhang2017.PAPER.values():
        assert row[POSITION] == pytest.approx(np.hypot(row[LATERAL], row[LONGITUDINAL]), abs=1e-4)
    assert "0.575" in (note_of("zhang2017", "curve, sharp body (table 2)") or "")
    assert note_of("zhang2017", "claims, sharp body") is None
    assert note_of("lu2018", "claims") is None
    assert set(PAPERS) >= {"lu2018", "zhang2017"}


def a_table(single=1.0, multi=0.8, ransac=2.0, ours=(0.3, 0.02, 0.01), floors=(0.2, 0.015, 0.008)):
    values = {SINGLE: single, MULTI: multi, RANSAC: ransac, **dict(zip(OURS, ours, strict=True))}
    values |= {floor_name(n): v for n, v in zip(OURS.values(), floors, strict=True)}
    scale = {"curve": 1.2, "following-40": 1.1, "following-50": 1.2}
    return {
        (drive, method): dict.fromkeys(
            (LATERAL, LONGITUDINAL, HEADING, POSITION), value * scale.get(drive, 1.0)
        )
        for drive in DRIVES
        for method, value in values.items()
    }


def test_claims_hold_on_figures_like_the_papers_and_fail_on_others():
    held = paper_claims(a_table(ransac=1.1))
    assert all(held.values())
    failed = paper_claims(a_table(multi=1.2, ransac=1.1))
    assert not failed["straight: multi below single in all four errors"]
    assert not failed["curve: single and multi below RANSAC in all four errors"]
    assert not failed["following from 30 m: multi below single"]


def test_what_is_asked_of_ours():
    assert all(our_claims(a_table(), 0.0).values())
    held = our_claims(a_table(ours=(0.3, 0.4, 0.01)), 0.1)
    assert not held["curve: more frames are better"]
    assert not held["curve: within twice the floor"]
    assert not held["no frame turned by 90 degrees on any drive"]
    without = {k: v for k, v in a_table().items() if not k[1].startswith("floor")}
    assert np.isnan(our_claims(without, 0.0)["curve: within twice the floor"])


def test_no_seeds_are_refused():
    with pytest.raises(ValueError, match="at least one seed is needed, got 0"):
        zhang2017.reproduce(0)


@pytest.mark.slow
def test_ours_is_below_the_papers_multi_frame_and_never_turned(monkeypatch):
    """In the mean over seeds; of single seeds some are above on the receding straight."""
    monkeypatch.setattr(zhang2017, "FIRST_SEED", SEED)
    monkeypatch.setattr(zhang2017, "FLOOR_SEEDS", 0)
    ours = {
        (row.experiment, row.method, row.quantity): row.ours
        for row in zhang2017.reproduce(3, jobs=-1)
    }
    for body in zhang2017.BODIES:
        for drive, table in zhang2017.SIMULATED.items():
            for quantity in (POSITION, HEADING):
                found = ours[f"{drive}, {body} body ({table})", "ours, 7 frames", quantity]
                assert found < zhang2017.PAPER[table, MULTI][quantity]
        turned = "no frame turned by 90 degrees on any drive"
        assert ours[zhang2017.CLAIMS.format(body), "ours", turned] == 1
