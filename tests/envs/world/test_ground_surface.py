import numpy as np

from roadscope.envs.world import surface_of
from tests.envs.worlds import circle, crossing, straight


def test_lines_lie_on_lane_borders_and_inner_ones_are_dashed() -> None:
    lines = surface_of(straight(lanes=3, width_m=4.0)).lines
    sides = np.round(lines[:, 1], 6)
    assert set(sides) == {-2.0, 2.0, 6.0, 10.0}
    assert np.allclose(lines[:, 1], lines[:, 3])
    assert np.array_equal(lines[:, 5] == 1, np.isin(sides, [2.0, 6.0]))
    for side in (-2.0, 2.0, 6.0, 10.0):
        covered = np.abs(np.diff(lines[sides == side][:, [0, 2]], axis=1)).sum()
        assert 296 <= covered <= 301


def test_no_line_crosses_a_junction() -> None:
    lines = surface_of(crossing()).lines
    middles = (lines[:, :2] + lines[:, 2:4]) / 2
    assert not (np.abs(middles) < 1.6).all(axis=1).any()
    assert np.isclose(np.abs(middles), 2.0).any(axis=1).all()
    away = middles[np.abs(middles).max(axis=1) > 6]
    assert len(away) > 4 * 110 * 2 * 0.9


def test_strips_cover_the_lanes() -> None:
    strips = surface_of(circle(25.0)).strips
    ends = np.linalg.norm(strips[:, [0, 1]], axis=1)
    assert np.allclose(ends, 25.0, atol=1e-6)
    chords = np.linalg.norm((strips[:, :2] + strips[:, 2:4]) / 2, axis=1)
    assert (25.0 - chords < 0.1).all()
    assert np.allclose(strips[:, 4], 2.0)
