import numpy as np
import pytest
import toy_boxes

from roadscope.benchmarks import CAMERA_NOISES, LIT, CameraNoise, Episode, NoisyCamera
from roadscope.benchmarks.nodes import lit_share
from roadscope.core import Category, Truth
from roadscope.envs.imaging import Pinhole

LONG, WIDE = Pinhole.centred(1280, 960, 1600.0), Pinhole.centred(640, 480, 420.0)


def truth(
    heights_px: list[float],
    *,
    hidden: float = 0.0,
    far_m: float = 20.0,
    copies: int = 400,
    category: Category = Category.PEDESTRIAN,
) -> Truth:
    tall = np.repeat(heights_px, copies)
    n = len(tall)
    left = np.full(n, 300.0)
    boxes = np.column_stack([left, np.full(n, 200.0), left + tall / 2, 200.0 + tall])
    return toy_boxes.truth(
        np.tile([far_m, 0, 1], (n, 1)),
        categories=np.full(n, category),
        sizes=np.ones((n, 3)),
        returns=0,
        visible_pixels=np.full(n, 500),
        occluded_fraction=np.full(n, hidden),
        image_boxes=boxes,
    )


def share(model: CameraNoise, scene: Truth, **air: object) -> float:
    detections = NoisyCamera(model, 3, **air).of(scene, LONG)  # type: ignore[arg-type]
    return len(detections) / len(scene)


QUIET = CameraNoise(clutter=0.0)


def test_small_hidden_and_foggy_ones_are_missed_more() -> None:
    large, small = share(QUIET, truth([120.0])), share(QUIET, truth([20.0]))
    assert large == pytest.approx(0.97, abs=0.03)
    assert small == pytest.approx(0.97 / 2, abs=0.08)
    assert share(QUIET, truth([120.0], hidden=0.7)) == pytest.approx(0.97 / 2, abs=0.08)
    assert share(QUIET, truth([120.0], far_m=60.0), extinction_per_m=0.08) < 0.3
    dark = truth([120.0], far_m=90.0)
    cars = truth([120.0], far_m=90.0, category=Category.CAR)
    assert share(QUIET, dark, night=True) < share(QUIET, cars, night=True) - 0.2


def test_scores_separate_objects_from_false_alarms() -> None:
    model = CameraNoise(clutter=50.0)
    detections = NoisyCamera(model, 1).of(truth([120.0], copies=50), LONG)
    real = np.abs(detections.boxes[:, 0] - 300) < 20
    assert real.sum() >= 40
    assert np.median(detections.scores[real]) > np.median(detections.scores[~real]) + 0.4
    assert (detections.boxes[:, :2] >= 0).all()
    assert (detections.boxes[:, 2] <= 1280).all()


def test_wrong_families_grow_with_smallness() -> None:
    wrong = {}
    for tall in (30.0, 150.0):
        detections = NoisyCamera(QUIET, 2).of(truth([tall]), LONG)
        wrong[tall] = float((detections.categories != Category.PEDESTRIAN).mean())
    assert wrong[30.0] > 3 * wrong[150.0]


def test_the_same_seed_brings_the_same_and_names_take_options() -> None:
    scene = truth([60.0], copies=20)
    model = CAMERA_NOISES.make("noisy-camera?clutter=3")
    assert NoisyCamera(model, 5).of(scene, WIDE) == NoisyCamera(model, 5).of(scene, WIDE)
    for text in ("miss=1.5", "miss=None", "gap=None", "half_px=0"):
        with pytest.raises(ValueError, match=f"{text.partition('=')[0]} must be"):
            CAMERA_NOISES.make(f"noisy-camera?{text}")


def test_the_worse_the_light_the_fewer_objects_are_detected() -> None:
    for kind in LIT:
        conditions = [(f"{kind}:{severity}",) for severity in range(1, 6)]
        left = [lit_share(Episode("street", 0, "wide", faults=each)) for each in conditions]
        assert left == sorted(left, reverse=True)
        assert left[0] < 1.0
        shares = [share(QUIET, truth([120.0]), lit=each) for each in left]
        assert shares[0] > shares[2] > shares[4]
    both = lit_share(Episode("street", 0, "wide", faults=("night:2", "glare:4")))
    assert both == pytest.approx(LIT["night"][1] * LIT["glare"][3])
    assert lit_share(Episode("street", 0, "wide", faults=("fog:3",))) == 1.0
