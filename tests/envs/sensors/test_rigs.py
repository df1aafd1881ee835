import math
from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import RecordError
from roadscope.envs import find_rig
from roadscope.envs.sensors import CAMERAS, RIGS, SPECS, load_rig, scaled_noise

CAMERA = 'lidar = "lux"\n[camera]\nsensor = "wide"\n'


@pytest.fixture
def write(tmp_path):
    def write_rig(text: str, name: str = "mine.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write_rig


@pytest.mark.parametrize("name", RIGS)
def test_presets_carry_what_they_say(name):
    made, place = find_rig(name), RIGS[name]
    assert made.name == name
    limit = {} if place.detection_limit is None else {"detection_limit": place.detection_limit}
    assert made.lidar.spec == replace(SPECS[place.sensor], **limit)
    assert (made.camera is None) == (place.camera is None)
    if made.camera is not None:
        assert made.camera.spec == CAMERAS[place.camera]
        assert made.calibration().pose("camera") == made.camera.ego_from_camera
    assert made.calibration().pose("lidar") == made.lidar.ego_from_lidar


def test_lux_sits_low_on_the_front_bumper():
    assert np.allclose(find_rig("lux").lidar.ego_from_lidar.translation, (5.0, 0.0, 0.55))


def test_an_unknown_rig_is_refused_with_what_there_is():
    with pytest.raises(RecordError, match=r"no rig 'luxx' \(did.*'lux'\?\); known: lux, vlp16"):
        find_rig("luxx")


def test_a_file_changes_mount_and_figures(write):
    made = find_rig(
        write('lidar = "vlp16"\nz_m = 2.1\nyaw_deg = 90\nrange_noise_m = 0.05\ndropout = 0.1\n')
    )
    assert made.name == "mine"
    assert np.allclose(made.lidar.ego_from_lidar.translation, (2.5, 0.0, 2.1))
    assert made.lidar.ego_from_lidar.yaw == pytest.approx(math.pi / 2)
    assert (made.lidar.spec.range_noise_m, made.lidar.spec.dropout) == (0.05, 0.1)
    assert np.array_equal(made.lidar.spec.elevations, SPECS["vlp16"].elevations)


def test_a_table_adds_a_camera(write):
    made = find_rig(
        write(
            'lidar = "vlp16"\n[camera]\nsensor = "wide"\nz_m = 1.2\nyaw_deg = 90\nwidth_px = 320\n'
            "rate_hz = 10\nexposure_s = 0.02\nmotion_blur = true\nread_noise = 3\n"
        )
    ).camera
    assert made is not None
    assert np.allclose(made.ego_from_camera.translation, (2.0, 0.0, 1.2))
    assert np.allclose(made.ego_from_camera.rotation[:, 2], (0, 1, 0))
    eye = made.spec.pinhole
    assert (eye.width, eye.height, eye.focal_px, eye.centre_px) == (
        320,
        480,
        (420, 420),
        (160, 240),
    )
    assert (made.spec.period_s, made.spec.exposure_s, made.spec.read_noise) == (0.1, 0.02, 3)
    assert made.spec.motion_blur
    assert made.spec.vignetting == CAMERAS["wide"].vignetting


def test_a_table_that_changes_nothing_is_the_presets_camera(write):
    made = find_rig(write('lidar = "hdl32e"\ncamera = { sensor = "wide" }\n', "wide.toml"))
    assert made == find_rig("wide")


def test_a_camera_may_lean(write):
    made = find_rig(write('lidar = "lux"\ncamera = { sensor = "wide", roll_deg = 90 }\n')).camera
    assert made is not None
    right = made.ego_from_camera.rotation[:, 0]
    assert np.allclose(right, (0, 0, -1))


def test_pitch_down_lowers_what_lies_ahead(write):
    made = load_rig(write('lidar = "lux"\npitch_deg = 2\n'))
    ahead = made.lidar.ego_from_lidar.apply(np.array([10.0, 0.0, 0.0]))
    assert ahead[2] == pytest.approx(0.55 - 10 * math.sin(math.radians(2)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('lidar = "hdl128"', r"no LiDAR 'hdl128'; known: lux, vlp16, hdl32e, hdl64e"),
        ("x_m = 1.0", r"no key 'lidar'; it names one of: lux"),
        ('lidar = "lux"\nrange_nois_m = 1', r"unknown key 'range_nois_m' \(did you mean"),
        ('lidar = "lux"\nrange_noise_m = -0.1', r"range_noise_m: .*from 0 up, got -0.1"),
        ('lidar = "lux"\nx_m = nan', r"x_m: expected a finite number, got nan"),
        ('lidar = "lux"\nroll_deg = inf', r"roll_deg: expected a finite number"),
        ('lidar = "lux"\nz_m = "high"', r"z_m: expected a number, got 'high'"),
        ('lidar = "lux"\nz_m = true', r"z_m: expected a number, got True"),
        ('lidar = "lux"\nz_m = -1', r"lidar: expected a sensor above the ground"),
        ('lidar = "lux"\ndropout = 1.5', r"dropout: expected a probability below 1"),
        ('lidar = ["lux"]', r"no LiDAR \['lux'\]; known"),
        ('lidar = "lux"\nname = 3', r"name: expected text, got 3"),
        ("lidar = ", r"is not a TOML file"),
        ('lidar = "lux"\ncamera = "wide"', r"camera: expected a table \[camera\], got 'wide'"),
        ('lidar = "lux"\n[camera]', r"\[camera\] no key 'sensor'; it names one of: bumblebee"),
        ('lidar = "lux"\n[camera]\nsensor = "wyde"', r"\[camera\] no camera 'wyde'; known: bumb"),
        (CAMERA + "focal = 3", r"unknown key 'focal' \(did you mean 'focal_px'"),
        (CAMERA + "width_px = 0", r"width_px: expected whole pixels, 1 to 8192, got 0"),
        (CAMERA + "height_px = 4.5", r"height_px: expected whole pixels"),
        (CAMERA + "focal_px = -1", r"focal_px: expected a number above 0, got -1"),
        (CAMERA + "rate_hz = 0", r"rate_hz: expected a number above 0, got 0"),
        (CAMERA + "rate_hz = nan", r"rate_hz: expected a finite number"),
        (CAMERA + "exposure_s = 1", r"exposure_s: expected above 0, up to period_s, got 1"),
        (CAMERA + "motion_blur = 1", r"motion_blur: expected true or false, got 1"),
        (CAMERA + "z_m = 0", r"z_m: expected a camera above the ground, got 0"),
    ],
)
def test_bad_files_are_refused_by_name(write, text, message):
    path = write(text)
    with pytest.raises(RecordError, match=message) as caught:
        load_rig(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(RecordError, match=r"cannot read rig file .*none.toml"):
        find_rig(tmp_path / "none.toml")


@pytest.mark.parametrize("factor", [0.0, 0.5, 2.0])
def test_noise_scales(factor):
    before, after = find_rig("hdl32e"), scaled_noise(find_rig("hdl32e"), factor)
    assert after.lidar.spec.range_noise_m == factor * before.lidar.spec.range_noise_m
    assert after.lidar.spec.dropout == factor * before.lidar.spec.dropout
    assert after.lidar.ego_from_lidar == before.lidar.ego_from_lidar
    assert (after == before) == (factor == 1.0)


@pytest.mark.parametrize("factor", [-1.0, math.nan, math.inf])
def test_impossible_noise_factors_are_refused(factor):
    with pytest.raises(RecordError, match="noise factor"):
        scaled_noise(find_rig("lux"), factor)
