"""What pixels show is what scans and the boxes of the truth say."""

from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import (
    GROUND,
    GROUND_CLASS,
    SCENERY_CLASS,
    SKY,
    SKY_CLASS,
    Category,
    Projection,
    RecordError,
)
from roadscope.envs import find_rig
from roadscope.envs.sensors import Sensing
from roadscope.envs.traffic import Timeline, record

SEED, AT_S = 7, 1.5


@pytest.fixture(scope="module")
def timeline() -> Timeline:
    return record("street", SEED, 2.5)


def test_nothing_is_recorded_unless_it_is_asked_for(timeline: Timeline) -> None:
    plain, truth = Sensing(find_rig("wide"), SEED).sense_image_at(timeline, AT_S)
    assert truth.pixels is None
    with_truth, more = Sensing(find_rig("wide"), SEED, pixel_truth=True).sense_image_at(
        timeline, AT_S
    )
    assert plain == with_truth
    assert truth == replace(more, pixels=None)
    _, scan_truth = Sensing(find_rig("wide"), SEED, pixel_truth=True).sense(timeline, 3)
    assert scan_truth.pixels is None


def test_a_rig_without_camera_is_refused() -> None:
    with pytest.raises(RecordError, match="rig 'vlp16' has no camera"):
        Sensing(find_rig("vlp16"), SEED, pixel_truth=True)


@pytest.mark.parametrize("name", ["wide", "li2021"])
def test_pixels_are_those_of_the_boxes(timeline: Timeline, name: str) -> None:
    carrier = find_rig(name)
    _, truth = Sensing(carrier, SEED, pixel_truth=True).sense_image_at(timeline, AT_S)
    pixels, boxes = truth.pixels, truth.image_boxes
    assert pixels is not None
    assert boxes is not None
    assert carrier.camera is not None
    pinhole = carrier.camera.spec.pinhole
    assert pixels.depth.shape == (pinhole.height, pinhole.width)
    assert pixels.stamp_s == AT_S
    users = pixels.instances >= 0
    assert set(np.unique(pixels.instances[users])) <= set(truth.ids)
    rows = np.array([np.count_nonzero(pixels.instances == i) for i in truth.ids])
    assert rows.sum() > 1000
    assert np.array_equal(rows, truth.visible_pixels)
    for i in np.flatnonzero(rows):
        mine = pixels.instances == truth.ids[i]
        assert (pixels.categories[mine] == truth.categories[i]).all()
        down, across = np.nonzero(mine)
        left, top, right, bottom = boxes[i]
        assert across.min() >= np.floor(left)
        assert across.max() <= np.ceil(right)
        assert down.min() >= np.floor(top)
        assert down.max() <= np.ceil(bottom)
    assert ((pixels.depth == 0) == (pixels.instances == SKY)).all()
    for which, category in ((GROUND, GROUND_CLASS), (SKY, SKY_CLASS)):
        assert ((pixels.instances == which) == (pixels.categories == category)).all()
    others = (pixels.instances < GROUND) & (pixels.instances > SKY)
    assert (pixels.categories[others] == SCENERY_CLASS).all()
    assert {int(c) for c in np.unique(pixels.categories[users])} <= {int(c) for c in Category}


def test_depth_is_what_a_scan_of_the_same_moment_measures(timeline: Timeline) -> None:
    """Returns of a LiDAR without noise lie on the surface that the pixel under them shows.

    Both sensors are at different places, so that an object may be hidden from only one of them.
    """
    carrier = find_rig("wide")
    assert carrier.camera is not None
    quiet = replace(
        carrier.lidar.spec, range_noise_m=0.0, range_resolution_m=0.0, dropout=0.0, sweep_s=1e-6
    )
    mount = replace(carrier.lidar, spec=quiet, first_stamp_s=AT_S)
    sensing = Sensing(replace(carrier, lidar=mount), SEED, pixel_truth=True)
    frame, lidar_truth = sensing.sense(timeline, 0)
    _, truth = sensing.sense_image_at(timeline, AT_S)
    assert frame.lidar is not None
    assert truth.pixels is not None
    pinhole = carrier.camera.spec.pinhole
    projection = Projection.of(pinhole.intrinsics, carrier.camera.ego_from_camera, 640, 480)
    places, depths = projection.project(mount.ego_from_lidar.apply(frame.lidar.points))
    inside = (depths > 1) & (places >= 0).all(axis=1) & (places < (640, 480)).all(axis=1)
    columns, rows = np.floor(places[inside]).astype(int).T
    shown, expected_depths = truth.pixels.depth[rows, columns], depths[inside]
    near = np.abs(shown - expected_depths) < 0.02 * expected_depths + 0.05
    assert inside.sum() > 2000
    assert near.mean() > 0.9
    same = truth.pixels.instances[rows, columns] == lidar_truth.sources[inside]
    users = lidar_truth.sources[inside] >= 0
    assert users.sum() > 50
    assert same[users & near].mean() > 0.95
    assert (same & ~users & (lidar_truth.sources[inside] == GROUND))[near].sum() > 500
