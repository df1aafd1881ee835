import numpy as np

from roadscope.envs.world import OBSTACLE_KIND, kinds_of, obstacle_prisms


def test_an_obstacle_is_a_box_where_it_stands():
    prisms = obstacle_prisms(np.array([[10.0, 2.0, np.pi / 2, 4.0, 1.0, 0.8]]))
    assert len(prisms) == 1
    assert (prisms.bottoms[0], prisms.tops[0]) == (0.0, 0.8)
    corners = prisms.footprints[0]
    np.testing.assert_allclose(corners.min(axis=0), [9.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [10.5, 4.0], atol=1e-12)
    x, y = corners[:4].T
    area = (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2
    np.testing.assert_allclose(area, 4.0)
    assert (kinds_of(prisms.owners) == OBSTACLE_KIND).all()


def test_no_obstacles_are_no_prisms():
    assert len(obstacle_prisms(np.empty((0, 6)))) == 0
