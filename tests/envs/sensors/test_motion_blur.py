"""Images of a camera whose shutter is open for a while."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from roadscope.envs import find_rig
from roadscope.envs.imaging import Pinhole
from roadscope.envs.sensors import Rig, Sensing, motion_during
from tests.envs.worlds import platoon


def carrier(**changes: object) -> Rig:
    camera = find_rig("wide").camera
    pinhole = Pinhole.centred(160, 120, 105.0)
    spec = replace(camera.spec, pinhole=pinhole, full_well=1e12, read_noise=0.0, **changes)
    return replace(find_rig("lux"), camera=replace(camera, spec=spec, first_stamp_s=0.05))


def image(rig: Rig) -> np.ndarray:
    frame, _ = Sensing(rig, 3).sense_image(platoon(), 4)
    return frame.camera.pixels.astype(np.float64)


def test_images_are_sharp_unless_the_camera_says_otherwise() -> None:
    still = image(carrier())
    assert np.abs(still - image(carrier(exposure_s=0.03))).max() <= 1
    smeared = image(carrier(motion_blur=True, exposure_s=0.03))
    assert not np.array_equal(still, smeared)
    # Ground beside the camera runs through the image, what drives along ahead does not.
    change = np.abs(smeared - still).mean(axis=2)
    assert change[80:].mean() > 5 * change[:40].mean()


@pytest.mark.slow
def test_longer_exposures_smear_more() -> None:
    still = image(carrier())
    changes = [
        np.abs(image(carrier(motion_blur=True, exposure_s=s)) - still).mean()
        for s in (0.004, 0.012, 0.036)
    ]
    assert changes == sorted(changes)
    assert changes[0] < changes[-1]


def test_motion_is_that_of_the_timeline() -> None:
    motion = motion_during(platoon(), carrier().camera, 2.0)
    np.testing.assert_allclose(motion.camera, [10, 0, 0], atol=1e-6)
    np.testing.assert_allclose(motion.turning, 0, atol=1e-9)
    np.testing.assert_allclose(motion.actors, np.tile([10, 0], (3, 1)), atol=1e-6)


def test_truth_and_scans_know_nothing_of_it() -> None:
    pairs = [
        Sensing(carrier(motion_blur=blurred), 3).advance(platoon(), 0.3)
        for blurred in (False, True)
    ]
    assert [truth for _, truth in pairs[0]] == [truth for _, truth in pairs[1]]
    assert [frame.lidar for frame, _ in pairs[0]] == [frame.lidar for frame, _ in pairs[1]]
