import numpy as np

from roadscope.benchmarks.nodes import targets_of
from roadscope.core import Category, Pose, Projection, Truth

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
PROJECTION = Projection.of(
    np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]),
    Pose.from_parts(OPTICAL, np.array([0.0, 0.0, 1.4])),
    640,
    480,
)
BOX, NONE = (300.0, 200, 320, 260), (0.0, 0, 0, 0)
ROWS = {
    "seen by both": (20.0, 30, 500, 0.1, BOX, True),
    "few returns, many pixels": (20.0, 1, 500, 0.1, BOX, True),
    "many returns, few pixels": (20.0, 9, 20, 0.1, BOX, True),
    "seen by none": (20.0, 1, 20, 0.1, BOX, False),
    "not in the image": (20.0, 30, 0, 0.1, NONE, False),
    "hidden": (20.0, 30, 500, 0.95, BOX, False),
    "too far": (80.0, 30, 500, 0.1, BOX, False),
}


def truths() -> tuple[Truth, Truth]:
    far, returns, pixels, hidden, boxes, _ = zip(*ROWS.values(), strict=True)
    n = len(ROWS)
    shared = {
        "ids": np.arange(n),
        "categories": np.full(n, Category.PEDESTRIAN),
        "centres": np.array([[100.0 + x, 5.0, 1.0] for x in far]),
        "sizes": np.ones((n, 3)),
        "yaws": np.zeros(n),
        "velocities": np.zeros((n, 2)),
        "occluded_fraction": np.array(hidden),
        "world_from_ego": Pose.planar(100.0, 5.0, 0.0),
        "stamp_s": 0.0,
        "sources": np.empty(0, np.int64),
    }
    zero = np.zeros(n, np.int64)
    scan = Truth(**shared, lidar_returns=np.array(returns), visible_pixels=zero)
    shared |= {"image_boxes": np.array(boxes)}
    return scan, Truth(**shared, lidar_returns=zero, visible_pixels=np.array(pixels))


def test_who_is_to_be_found() -> None:
    found = targets_of(*truths(), np.empty((0, 2)), PROJECTION)
    said = dict(zip(ROWS, found.eligible.tolist(), strict=True))
    assert said == {name: row[-1] for name, row in ROWS.items()}
    assert np.allclose(found.centres[0], [20.0, 0.0, 1.0])


def test_parked_cars_are_neither_missed_nor_made_up() -> None:
    scan, image = truths()
    found = targets_of(scan, image, np.array([[112.0, 3.0]]), PROJECTION)
    assert len(found) == len(ROWS) + 1
    assert not found.eligible[-1]
    assert np.allclose(found.centres[-1], [12.0, -2.0, 0.75])
    assert (found.image_boxes[-1, 2:] > found.image_boxes[-1, :2]).all()
