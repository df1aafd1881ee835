import numpy as np
import pytest
from toy_lidar import cloud

from roadscope.detectors.clustering.breakpoint import INCIDENCE_RAD, cluster_breakpoint, reach


def test_reach_is_the_spacing_at_the_smallest_incidence():
    """Two beams a step apart on a wall met at 10 deg: its hits lie exactly that far apart."""
    step = np.radians(0.25)
    first = np.array([20.0, 0.0])
    wall = np.array([np.cos(INCIDENCE_RAD), np.sin(INCIDENCE_RAD)])
    beam = np.array([np.cos(step), np.sin(step)])
    along, _ = np.linalg.solve(np.column_stack([wall, -beam]), -first)
    assert reach(np.array([20.0]), np.array([step]))[0] == pytest.approx(abs(along), rel=1e-9)


def test_two_vehicles_are_two_clusters_and_all_layers_one():
    found = cloud([(25, 0, 4.6, 1.85, 1.5, 0), (24, 7, 4.6, 1.85, 1.5, 0)], ground=False)
    labels = cluster_breakpoint(found)
    near = np.abs(found.points[:, 1]) < 1.5
    assert len(np.unique(labels[near])) == 1
    assert len(np.unique(labels[~near])) == 1
    assert labels.max() == 1


def test_depth_jump_within_a_beam_separates():
    found = cloud([(25, 0, 4.6, 1.85, 1.5, 0), (45, 2, 4.6, 4, 1.5, 0)], ground=False)
    far = found.points[:, 0] > 30
    labels = cluster_breakpoint(found)
    assert not set(labels[far]) & set(labels[~far])


def test_seam_behind_the_sensor_is_no_break():
    azimuths = np.radians(np.arange(-180, 180, 0.5))
    found = cloud([(-15, 0, 2, 4, 1.5, 0)], ground=False, azimuths=azimuths)
    assert (cluster_breakpoint(found) == 0).all()


@pytest.mark.parametrize("count", [0, 1])
def test_nothing_to_link(count):
    found = cloud([(25, 0, 4.6, 1.85, 1.5, 0)], ground=False).select(np.arange(count))
    assert cluster_breakpoint(found).tolist() == [0] * count
