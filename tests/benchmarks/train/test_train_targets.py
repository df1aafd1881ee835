import numpy as np

from roadscope.benchmarks.train import CropObjects, PixelSize, targets_of

CROP = PixelSize(96, 128)


def objects(*rows: tuple[list[float], int, int, bool]) -> CropObjects:
    boxes, families, categories, eligible = zip(*rows, strict=True)
    return CropObjects(
        np.array(boxes, float), np.array(families), np.array(categories), np.array(eligible)
    )


def test_a_box_is_taught_at_its_centre() -> None:
    made = targets_of(objects(([40, 20, 80, 60], 0, 2, True)), CROP)
    assert made.heat.shape == (3, 48, 64)
    assert made.heat[0, 20, 30] == 1.0
    assert (made.heat == 1.0).sum() == 1
    assert made.heat[1:].max() == 0.0
    np.testing.assert_array_equal(made.boxes[:, 20, 30], [40, 20, 80, 60])
    assert made.vehicles[20, 30] == 2
    assert abs(made.weights.sum() - 1) < 1e-5
    assert made.loss_mask.min() == 1.0


def test_objects_that_are_not_eligible_have_no_effect_on_the_loss() -> None:
    made = targets_of(objects(([40, 20, 80, 60], 2, 6, False)), CROP)
    assert made.heat.max() == 0.0
    assert made.loss_mask[2, 20, 30] == 0.0
    assert made.loss_mask[:2].min() == 1.0
    assert made.weights.max() == 0.0


def test_where_boxes_overlap_the_smaller_wins() -> None:
    small, large = ([56, 36, 64, 44], 2, 6, True), ([20, 0, 100, 80], 0, 3, True)
    for order in ((small, large), (large, small)):
        made = targets_of(objects(*order), CROP)
        np.testing.assert_array_equal(made.boxes[:, 20, 30], [56, 36, 64, 44])
        assert made.vehicles[20, 30] == -1
        assert made.heat[0, 20, 30] == made.heat[2, 20, 30] == 1.0


def test_an_eligible_centre_beside_another_object_counts() -> None:
    made = targets_of(
        objects(([40, 20, 80, 60], 0, 0, False), ([44, 24, 80, 60], 0, 0, True)), CROP
    )
    assert (made.loss_mask[made.heat == 1.0] == 1.0).all()


def test_boxes_at_the_border_have_a_centre_inside() -> None:
    made = targets_of(objects(([120, 88, 128, 96], 1, 5, True)), CROP)
    assert made.heat[1].max() == 1.0
