"""What every fusion does."""

from dataclasses import replace

import numpy as np
import pytest
from toy_camera import LOOK

from roadscope.core import Category, Detections, ImageDetections, RecordError
from roadscope.fusion import FUSIONS, ClocksApartError, ClusterBoxes, projected_boxes


def scene(seed: int, many: int = 8) -> tuple[Detections, ImageDetections]:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-20, 50, many), rng.uniform(-15, 15, many)
    categories = rng.choice([Category.CAR, Category.CYCLIST, Category.PEDESTRIAN], many)
    sizes = rng.uniform(0.4, 4.0, (many, 3))
    lidar = Detections(
        np.column_stack([x, y, sizes[:, 2] / 2]),
        sizes,
        rng.uniform(-3, 3, many),
        categories.astype(np.int8),
        rng.uniform(0, 1, many),
        "ego",
        2.0,
    )
    corner = rng.uniform(0, 400, (many, 2))
    boxes = np.concatenate([corner, corner + rng.uniform(5, 80, (many, 2))], axis=1)
    camera = ImageDetections(
        boxes, rng.permutation(categories).astype(np.int8), rng.uniform(0, 1, many), 2.02
    )
    return lidar, camera


@pytest.mark.parametrize("name", list(FUSIONS))
@pytest.mark.parametrize("seed", range(4))
def test_outputs_are_sound_and_repeatable(name: str, seed: int) -> None:
    lidar, camera = scene(seed)
    fusion = FUSIONS.make(name)
    fused = fusion.fuse(lidar, camera, LOOK)
    assert fused == fusion.fuse(lidar, camera, LOOK)
    assert fused.stamp_s == 2.0
    assert np.allclose(fused.masses.sum(axis=1), 1.0)
    assert (fused.has_box == (fused.distances_m >= 0)).all()
    known = fused.has_box
    assert np.isfinite(fused.centres).all()
    assert (fused.sizes[known] > 0).all()
    assert (fused.lidar_rows < len(lidar)).all()


@pytest.mark.parametrize("name", list(FUSIONS))
def test_no_detections_give_no_targets(name: str) -> None:
    fusion, none = FUSIONS.make(name), ImageDetections.empty(2.02)
    assert len(fusion.fuse(Detections.empty(2.0), none, LOOK)) == 0
    alone = fusion.fuse(None, none, LOOK)
    assert (len(alone), alone.stamp_s) == (0, 2.02)
    with pytest.raises(RecordError, match="one sensor at least"):
        FUSIONS.make(name).fuse(None, None, LOOK)


@pytest.mark.parametrize("name", list(FUSIONS))
def test_one_sensor_is_enough(name: str) -> None:
    lidar, camera = scene(3)
    alone = FUSIONS.make(name).fuse(None, camera, LOOK)
    assert len(alone) == len(camera)
    assert alone.by_camera.all()
    assert not alone.by_lidar.any()
    assert alone.stamp_s == camera.stamp_s
    other = FUSIONS.make(name).fuse(lidar, None, LOOK)
    assert len(other) == len(lidar)
    assert other.by_lidar.all()
    assert not other.by_camera.any()


@pytest.mark.parametrize("name", list(FUSIONS))
def test_what_does_not_belong_together_is_refused(name: str) -> None:
    lidar, camera = scene(3)
    late = replace(camera, stamp_s=camera.stamp_s + 3600)
    with pytest.raises(ClocksApartError, match=r"scan is stamped 2 s, the image 3602\.02 s"):
        FUSIONS.make(name).fuse(lidar, late, LOOK)
    with pytest.raises(RecordError, match="calibration is of images of 640 x 480, but a box is"):
        FUSIONS.make(name).fuse(lidar, replace(camera, boxes=camera.boxes + 700), LOOK)
    with pytest.raises(RecordError, match="images of 640 x 480, but this one has 320 x 240"):
        FUSIONS.make(name).fuse(lidar, replace(camera, size_px=(320, 240)), LOOK)
    four = np.tile([0.2, 0.2, 0.2, 0.2, 0.2], (len(camera), 1))
    with pytest.raises(RecordError, match="cyclist, pedestrian and ignorance, got 5 columns"):
        FUSIONS.make(name).fuse(lidar, replace(camera, masses=four), LOOK)
    with pytest.raises(RecordError, match="expected a Projection, got ndarray"):
        FUSIONS.make(name).fuse(lidar, camera, LOOK.matrix)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", list(FUSIONS))
def test_a_detection_wholly_sure_of_the_wrong_class_spoils_its_own_target_alone(name: str) -> None:
    lidar, camera = scene(5)
    boxes, inside = projected_boxes(lidar, LOOK)
    camera = replace(camera, boxes=np.where(inside[:, None], boxes, camera.boxes))
    masses = [np.tile(row, (len(lidar), 1)) for row in ([1.0, 0, 0, 0], [0, 0, 0.6, 0.4])]
    masses[1][0] = (0, 0, 1, 0)
    fused = FUSIONS.make(name).fuse(
        replace(lidar, masses=masses[0]), replace(camera, masses=masses[1]), LOOK
    )
    assert (fused.masses >= 0).all()
    np.testing.assert_allclose(fused.masses.sum(axis=1), 1.0)


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("li2021?threshold_1=1.5", r"threshold_1: expected a share from 0 to below 1, got 1\.5"),
        ("li2021?threshold_2=-0.1", "threshold_2: expected a share"),
        ("li2021?rank=score", "rank: expected one of class, any, got 'score'"),
        ("union?least_iou=0", "least_iou: expected between 0 and 1, got 0"),
        ("bayes?prior=1", "prior: expected between 0 and 1, got 1"),
        ("weighted-boxes?least_iou=2", "least_iou must be between 0 and 1"),
        ("icp-boxes?gate=-1", "gate: expected positive widths, got -1"),
        ("icp-boxes?turns=-1", "turns: expected a number from 0 up, got -1"),
    ],
)
def test_settings_that_make_no_sense_are_refused(spec: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        FUSIONS.make(spec)


@pytest.mark.parametrize("setting", [{"eps_m": 0.0}, {"min_points": 0}, {"min_score": 2.0}])
def test_clusters_are_made_with_settings_that_make_sense(setting: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(setting))}: expected"):
        ClusterBoxes(**setting)
