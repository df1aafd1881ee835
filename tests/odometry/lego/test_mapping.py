"""Correction of poses by a map of earlier features."""

import numpy as np

from roadscope.odometry.lego import LegoMapping
from roadscope.odometry.loam import Features


def corner(place):
    """Smooth returns of two walls with a common corner, measured from a place."""
    along, up = (each.ravel() for each in np.meshgrid(np.arange(-8, 8, 0.5), np.arange(-1, 2, 0.5)))
    walls = np.concatenate(
        [
            np.column_stack([along, np.full(len(along), 9.0), up]),
            np.column_stack([np.full(len(along), 9.0), along, up]),
        ]
    )
    count, none = len(walls), np.empty(0, np.int64)
    rows = np.arange(count)
    return Features(
        np.empty((0, 3)),
        walls - place,
        none,
        np.zeros(count, np.int64),
        none,
        rows,
        none,
        rows,
        0,
        count,
    )


def at(place):
    pose = np.eye(4)
    pose[:3, 3] = place
    return pose


def test_the_map_corrects_only_observable_directions():
    """Two upright walls determine the horizontal position but not the height."""
    mapping = LegoMapping(every=1, reach_m=100.0, loop=False)
    mapping.take(corner(np.zeros(3)), np.eye(4))
    mapping.take(corner(np.array([1.0, 0.5, 0.0])), at([1.2, 0.4, 0.3]))
    put = (mapping.map_from_start @ at([1.2, 0.4, 0.3]))[:3, 3]
    assert np.allclose(put[:2], [1.0, 0.5], atol=0.02)
    assert abs(put[2] - 0.3) < 0.02


def test_only_every_nth_scan_is_matched_with_the_map():
    mapping = LegoMapping(every=3, reach_m=100.0, loop=False)
    for k in range(7):
        mapping.take(corner(np.array([k, 0.0, 0.0])), at([k, 0.0, 0.0]))
    assert [round(each.place[0]) for each in mapping.keyframes] == [0, 3, 6]
    never = LegoMapping(every=0, reach_m=100.0, loop=False)
    never.take(corner(np.zeros(3)), at([5.0, 0, 0]))
    assert not never.keyframes
    assert np.array_equal(never.map_from_start, np.eye(4))
