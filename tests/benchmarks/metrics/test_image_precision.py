import numpy as np
import pytest

from roadscope.benchmarks.metrics import LabelledImage, image_precision

LARGE = 32.0**2


def random_images(rng: np.random.Generator, count: int) -> list[tuple[np.ndarray, ...]]:
    images = []
    for _ in range(count):
        corner = rng.uniform(0, 80, (int(rng.integers(0, 7)), 2))
        objects = np.concatenate([corner, corner + rng.uniform(8, 60, corner.shape)], axis=1)
        detected_boxes = objects[rng.random(len(objects)) < 0.8]
        detected_boxes = np.repeat(detected_boxes, rng.integers(1, 3, len(detected_boxes)), axis=0)
        shifted = detected_boxes + rng.normal(0, 3, detected_boxes.shape)
        corner = rng.uniform(0, 80, (int(rng.integers(0, 4)), 2))
        clutter = np.concatenate([corner, corner + rng.uniform(8, 60, corner.shape)], axis=1)
        boxes = np.concatenate([shifted, clutter])
        boxes[:, 2:] = np.maximum(boxes[:, 2:], boxes[:, :2] + 1)
        images.append((boxes, np.round(rng.random(len(boxes)), 3), objects))
    return images


def areas(boxes: np.ndarray) -> np.ndarray:
    return (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("large", [False, True])
def test_it_is_that_of_coco(seed: int, large: bool) -> None:
    coco = pytest.importorskip("pycocotools.coco", reason="pycocotools is not installed")
    evaluation = pytest.importorskip("pycocotools.cocoeval")
    images = random_images(np.random.default_rng(seed), 25)
    span = [LARGE, 1e10] if large else [0.0, 1e10]
    truth, detections = coco.COCO(), coco.COCO()
    annotations = [
        {
            "id": 1 + 100 * i + k,
            "image_id": i,
            "category_id": 1,
            "iscrowd": 0,
            "area": float(area),
            "bbox": [*box[:2], *(box[2:] - box[:2])],
        }
        for i, (_, _, objects) in enumerate(images)
        for k, (box, area) in enumerate(zip(objects, areas(objects), strict=True))
    ]
    results = [
        {
            "id": 1 + 100 * i + k,
            "image_id": i,
            "category_id": 1,
            "score": float(score),
            "area": float(area),
            "iscrowd": 0,
            "bbox": [*box[:2], *(box[2:] - box[:2])],
        }
        for i, (boxes, scores, _) in enumerate(images)
        for k, (box, score, area) in enumerate(zip(boxes, scores, areas(boxes), strict=True))
    ]
    for data, rows in ((truth, annotations), (detections, results)):
        data.dataset = {
            "images": [{"id": i} for i in range(len(images))],
            "categories": [{"id": 1}],
            "annotations": rows,
        }
        data.createIndex()
    judge = evaluation.COCOeval(truth, detections, "bbox")
    judge.params.areaRng, judge.params.areaRngLbl = [span], ["all"]
    judge.params.iouThrs, judge.params.maxDets = np.array([0.5]), [100]
    judge.evaluate()
    judge.accumulate()
    expected = judge.eval["precision"][0, :, 0, 0, 0].mean()
    labelled = [
        LabelledImage(
            boxes, scores, objects, (areas(objects) >= span[0]), (areas(boxes) >= span[0])
        )
        for boxes, scores, objects in images
    ]
    assert image_precision(labelled, 0.5).ap == pytest.approx(expected, abs=1e-9)


def test_perfect_detections_have_one_and_none_have_nothing() -> None:
    boxes = np.array([[0.0, 0, 10, 10], [20, 20, 40, 40]])
    yes = np.ones(2, bool)
    perfect = image_precision([LabelledImage(boxes, np.array([0.9, 0.8]), boxes, yes, yes)])
    assert perfect.ap == 1.0
    missed = image_precision([LabelledImage(boxes[:0], np.empty(0), boxes, yes, yes[:0])])
    assert missed.ap == 0.0
    nothing = image_precision([LabelledImage(boxes, np.ones(2), boxes[:0], yes[:0], yes)])
    assert np.isnan(nothing.ap)
