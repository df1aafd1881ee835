import numpy as np
from toy_pictures import toy_pictures

from roadscope.benchmarks.train.calibration import calibrated, logistic
from roadscope.detectors.camera.decode import Peaks


def test_a_known_curve_is_found_again() -> None:
    rng = np.random.default_rng(0)
    odds = rng.normal(0, 2, 40000)
    right = rng.random(40000) < 1 / (1 + np.exp(-(0.7 * odds - 1.2)))
    slope, offset = logistic(odds, right)
    assert abs(slope - 0.7) < 0.03
    assert abs(offset + 1.2) < 0.05


def test_without_detections_heat_stays_as_it_is() -> None:
    assert logistic(np.empty(0), np.empty(0, bool)) == (1.0, 0.0)


def test_each_family_has_its_own_curve() -> None:
    pictures = toy_pictures(0, 40, (320, 640))
    peaks = [
        Peaks(
            # People are always right, cars never.
            x.boxes + np.where(x.families == 0, 1000.0, 0.0)[:, None],
            x.families, x.categories, np.zeros(len(x)),
        )
        for x in pictures.labels
    ]  # fmt: skip
    worth = calibrated(peaks, pictures.labels)
    assert worth.offsets[0] < -2
    assert worth.offsets[2] > 2
    assert worth.offsets[1] == 0
