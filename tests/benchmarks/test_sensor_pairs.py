import numpy as np
from toy_boxes import truth
from toy_camera import LOOK

from roadscope.benchmarks.nodes import targets_of
from roadscope.core import Category, Pose, Truth

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
    shared = {
        "positions": [[100.0 + x, 5.0, 1.0] for x in far],
        "categories": np.full(len(ROWS), Category.PEDESTRIAN),
        "sizes": np.ones((len(ROWS), 3)),
        "occluded_fraction": np.array(hidden),
        "world_from_ego": Pose.planar(100.0, 5.0, 0.0),
    }
    scan = truth(**shared, returns=returns)
    image_columns = {"visible_pixels": np.array(pixels), "image_boxes": np.array(boxes)}
    return scan, truth(**shared, returns=0, **image_columns)


def test_which_objects_are_to_be_detected() -> None:
    targets = targets_of(*truths(), np.empty((0, 2)), LOOK)
    eligible_by_name = dict(zip(ROWS, targets.eligible.tolist(), strict=True))
    assert eligible_by_name == {name: row[-1] for name, row in ROWS.items()}
    assert np.allclose(targets.centres[0], [20.0, 0.0, 1.0])


def test_parked_cars_are_neither_missed_nor_made_up() -> None:
    scan, image = truths()
    targets = targets_of(scan, image, np.array([[112.0, 3.0]]), LOOK)
    assert len(targets) == len(ROWS) + 1
    assert not targets.eligible[-1]
    assert np.allclose(targets.centres[-1], [12.0, -2.0, 0.75])
    assert (targets.image_boxes[-1, 2:] > targets.image_boxes[-1, :2]).all()
