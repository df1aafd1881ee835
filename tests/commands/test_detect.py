"""`roadscope detect` on folders of scans."""

import json
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from toy_bags import cloud, jpeg, write_bag
from toy_lidar import FRONT_M, HEIGHT_M, scan
from typer.testing import CliRunner

from roadscope.__main__ import app
from roadscope.benchmarks.formats import bottoms_from_centres, read_kitti_object_results
from roadscope.benchmarks.isolation import PluginError
from roadscope.formats import FormatError

SCANS = 3
CARS = ((17.0, 3.5, 4.4, 1.8, 1.5, 0.0), (25.0, -3.5, 4.4, 1.8, 1.5, 0.0))
"""x, y, length, width, height, yaw in the frame of `toy_lidar`."""
STRANGER = """
import numpy as np
from roadscope.core import Detections

class Echo:
    '''One box that tells what the frame has.'''

    def reset(self):
        self.count = 0

    def detect(self, frame):
        self.count += 1
        mount = frame.calibration.pose(frame.lidar.sensor)
        motion = frame.previous_from_ego
        ahead = 0.0 if motion is None else motion.translation[0]
        centre = [[10.0 + ahead, len(frame.lidar) / 1000, mount.translation[2]]]
        return Detections(centre, [[4.0, 2.0, 1.5]], [mount.yaw], [0], [0.5], "ego", frame.stamp_s)

class Nothing(Echo):
    def detect(self, frame):
        return Detections.empty(frame.stamp_s)

class Falls(Echo):
    def detect(self, frame):
        if self.count == 2:
            raise RuntimeError("fell")
        return super().detect(frame)

class Late(Echo):
    last = None

    def detect(self, frame):
        answer, self.last = self.last, super().detect(frame)
        return Detections.empty(frame.stamp_s) if answer is None else answer

class Elsewhere(Echo):
    def detect(self, frame):
        return super().detect(frame).moved(frame.calibration.pose(frame.lidar.sensor), "world")
"""


def rows_of(boxes=CARS):
    """A scan of 31 beams all around, x y z intensity, in the LiDAR's own axes."""
    around = np.radians(np.arange(-180, 180, 0.4))
    sweep = scan(boxes, elevations=np.arange(-15.0, 16.0), azimuths=around)
    return np.column_stack([sweep.points, sweep.intensity]).astype("<f4")


@pytest.fixture
def folder(tmp_path) -> Path:
    place = tmp_path / "scans"
    place.mkdir()
    for k in range(SCANS):
        rows_of().tofile(place / f"{k:06d}.bin")
    (tmp_path / "stranger.py").write_text(STRANGER)
    return place


def run(folder: Path, *options: str, detector: str | None = "", out: str = "out"):
    """The finished command, and what `detections.json` says if it is there.

    detector: a class of the stranger's. None leaves the choice to the command.
    """
    spec = f"{folder.parent}/stranger.py:{detector}" if detector else "distance-l-shape"
    place = folder.parent / out
    named = [] if detector is None or "--detector" in options else ["--detector", spec]
    done = CliRunner().invoke(app, ["detect", str(folder), "--out", str(place), *named, *options])
    file = place / "detections.json"
    return done, json.loads(file.read_text()) if file.is_file() else {}


def works(*folder_and_options, **named):
    """The same, of a command that must succeed."""
    done, document = run(*folder_and_options, **named)
    assert done.exit_code == 0, done.output
    return done, document


def labels(folder: Path, name: str, out: str = "out"):
    return read_kitti_object_results(folder.parent / out / "labels" / f"{name}.txt", 0)


def test_cars_are_where_they_stand(folder):
    _, written = works(folder)
    assert written["lidar_height_m"] == pytest.approx(HEIGHT_M, abs=0.03)
    assert [each["name"] for each in written["frames"]] == ["000000", "000001", "000002"]
    for frame in written["frames"]:
        boxes = sorted(frame["detections"], key=lambda box: box["centre_m"][0])
        assert [box["category"] for box in boxes] == ["car", "car"]
        for box, (x, y, _, _, height, _) in zip(boxes, CARS, strict=True):
            # The rear is seen, and its distance from the LiDAR; the length is a guess.
            assert box["centre_m"][0] == pytest.approx(x - FRONT_M, abs=0.6)
            assert box["centre_m"][1] == pytest.approx(y, abs=0.3)
            # The ground is below the LiDAR, the centre half of the height above it.
            assert box["centre_m"][2] == pytest.approx(height / 2 - HEIGHT_M, abs=0.25)
        rows = labels(folder, frame["name"])
        centres = np.array([box["centre_m"] for box in frame["detections"]])
        sizes = np.array([box["size_m"] for box in frame["detections"]])
        assert rows.bottoms == pytest.approx(bottoms_from_centres(centres, sizes), abs=1e-4)
        assert rows.scores == pytest.approx([b["score"] for b in frame["detections"]], abs=1e-5)


def test_height_is_named_or_of_the_ground(folder):
    done, written = works(folder, "--height", "1.25", detector="Echo")
    assert written["lidar_height_m"] == 1.25
    assert "1.25 m above the ground, as named" in done.stderr
    box = written["frames"][0]["detections"][0]
    # The plug-in puts a box of 1.25 m at the sensor's height: 0 in the LiDAR's axes.
    assert box["centre_m"] == pytest.approx([10, len(rows_of()) / 1000, 0], abs=1e-9)
    assert labels(folder, "000000").bottoms[0, 1] == pytest.approx(1.5 / 2)


def test_boxes_are_in_the_axes_of_a_turned_lidar_and_labels_ahead_of_the_vehicle(folder):
    _, written = works(folder, "--lidar-mounting", "0,0,0,0,0,90", detector="Echo")
    box, count = written["frames"][0]["detections"][0], len(rows_of()) / 1000
    assert box["centre_m"][:2] == pytest.approx([count, -10])
    assert box["yaw_rad"] == pytest.approx(0, abs=1e-9)
    assert labels(folder, "000000").bottoms[0, [0, 2]] == pytest.approx([-count, 10])


def test_every_scan_has_a_label_file(folder):
    _, written = works(folder, detector="Nothing")
    assert [len(labels(folder, f"{k:06d}")) for k in range(SCANS)] == [0] * SCANS
    assert [frame["detections"] for frame in written["frames"]] == [[]] * SCANS


def test_poses_give_the_motion_of_the_ego(folder):
    poses = folder.parent / "poses.txt"
    poses.write_text("".join(f"1 0 0 {0.5 * k} 0 1 0 0 0 0 1 0\n" for k in range(SCANS)))
    _, written = works(folder, "--poses", str(poses), detector="Echo")
    ahead = [frame["detections"][0]["centre_m"][0] for frame in written["frames"]]
    assert ahead == pytest.approx([10, 10.5, 10.5])


def test_a_detector_of_moving_objects_without_poses_brings_a_warning(folder):
    warning = "no --poses: the LiDAR is taken to stand still"
    assert warning in works(folder, "--detector", "zhang2017")[0].stderr
    assert warning in works(folder, detector="Echo")[0].stderr
    assert warning not in works(folder)[0].stderr
    poses = folder.parent / "poses.txt"
    poses.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * SCANS)
    assert warning not in works(folder, "--poses", str(poses), detector="Echo")[0].stderr
    assert warning not in works(folder, "--poses", str(poses), "--detector", "zhang2017")[0].stderr
    refused, _ = run(folder, "--poses", str(poses))
    assert "distance-l-shape has no use for poses" in str(refused.exception)


def test_an_answer_of_a_late_detector_is_put_to_its_scan(folder):
    for k in range(SCANS):
        rows_of()[: -k or None].tofile(folder / f"{k:06d}.bin")
    _, written = works(folder, detector="Late")
    counts = [[1000 * b["centre_m"][1] for b in frame["detections"]] for frame in written["frames"]]
    assert counts == [pytest.approx([len(rows_of())]), pytest.approx([len(rows_of()) - 1]), []]


def test_a_damaged_scan_is_empty_and_reported(folder):
    (folder / "000001.bin").write_bytes(b"damaged")
    done, written = works(folder)
    assert "1 scan is taken as empty" in done.stderr
    assert [bool(frame.get("problem")) for frame in written["frames"]] == [False, True, False]
    assert [len(frame["detections"]) for frame in written["frames"]] == [2, 0, 2]


def test_results_are_kept_when_a_plugin_fails(folder):
    done, written = run(folder, detector="Falls")
    assert isinstance(done.exception, PluginError)
    assert len(written["frames"]) == 2
    assert "2 of 3 frames" in done.stderr


def test_an_answer_in_another_frame_fails(folder):
    done, _ = run(folder, detector="Elsewhere")
    assert isinstance(done.exception, PluginError)
    assert "world" in str(done.exception)


def test_labels_of_other_scans_are_not_mixed_in(folder):
    assert run(folder, detector="Nothing")[0].exit_code == 0
    assert run(folder, detector="Nothing")[0].exit_code == 0
    (folder / "000001.bin").unlink()
    done, _ = run(folder, detector="Nothing")
    assert "labels of other scans, such as 000001.txt" in str(done.exception)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--detector", "oracle"], "made from the truth"),
        (["--detector", "noisy?miss=0.5"], "made from the truth"),
        (["--detector", "distance-l-shap"], "did you mean 'distance-l-shape'?"),
        (["--height", "0"], "expected metres above 0"),
        (["--lidar-mounting", "1,2"], "expected a mounting"),
        (["--layout", "x,y"], "expected x, y and z"),
    ],
)
def test_wrong_options_are_refused(folder, options, message):
    done, written = run(folder, *options)
    assert isinstance(done.exception, ValueError)
    assert message in str(done.exception)
    assert not written


def test_a_lidar_without_ground_needs_its_height(folder):
    for path in folder.iterdir():
        rows = rows_of()
        rows[rows[:, 2] >= 0].tofile(path)
    done, _ = run(folder)
    assert "--height METRES" in str(done.exception)
    assert run(folder, "--height", str(HEIGHT_M))[0].exit_code == 0


def test_flat_beams_do_not_show_the_height(folder):
    # Things 14 m away, which the lowest beam meets at the same height all around.
    posts = [(19.0, y, 0.5, 0.8, 1.7, 0.0) for y in np.arange(-6.0, 7.0, 1.0)]
    sweep = scan(posts)
    for path in folder.iterdir():
        np.column_stack([sweep.points, sweep.intensity]).astype("<f4").tofile(path)
    done, _ = run(folder, detector="Nothing")
    assert "--height METRES" in str(done.exception)


def test_json_is_the_only_output(folder):
    done, _ = run(folder, "--json", detector="Echo")
    summary = json.loads(done.stdout)
    assert summary["frames"] == SCANS
    assert summary["detections"] == {"car": SCANS}


# --------------------------------------------------------------------------------------------------
# Images, and both sensors.

CAMERA = """
import numpy as np
from roadscope.core import FusedDetections, ImageDetections

class Eye:
    '''A box around the brightest pixels, whose score tells the focal length.'''

    kind = "camera detector"

    def reset(self):
        pass

    def detect(self, frame):
        image = frame.camera
        rows, columns = np.nonzero(image.pixels[..., 0] > 200)
        box = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        score = image.intrinsics[0, 0] / 1000
        return ImageDetections([box], [6], [score], image.stamp_s, size_px=image.size_px)

class Join:
    def reset(self):
        pass

    def fuse(self, lidar, camera, projection):
        pairs = [[0, 0]] if lidar is not None and camera is not None else None
        return FusedDetections.of(lidar, camera, pairs=pairs)
"""
WIDTH, HEIGHT = 640, 480
P2 = np.array([[500.0, 0, 320, 0], [0, 500, 240, 0], [0, 0, 1, 0]])
CAMERA_FROM_LIDAR = np.array([[0.0, -1, 0, 0.1], [0, 0, -1, -0.2], [1, 0, 0, -0.3]])
CALIBRATION = "".join(
    f"{key}: {' '.join(map(str, matrix.ravel()))}\n"
    for key, matrix in {"P2": P2, "Tr": CAMERA_FROM_LIDAR}.items()
)
SPOT = (300, 200, 340, 260)


def write_images(place: Path, count: int = SCANS, ending: str = "png") -> None:
    place.mkdir(parents=True, exist_ok=True)
    for k in range(count):
        pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        left, top, right, bottom = SPOT
        pixels[top:bottom, left + k : right + k] = 255
        Image.fromarray(pixels).save(place / f"{k:06d}.{ending}", quality=95)


@pytest.fixture
def both(folder) -> Path:
    """A sequence of KITTI: velodyne, image_2 and calib.txt."""
    root = folder.parent / "sequence"
    root.mkdir()
    folder.rename(root / "velodyne")
    write_images(root / "image_2")
    (root.parent / "camera.py").write_text(CAMERA)
    (root / "calib.txt").write_text(CALIBRATION)
    return root


def fused_spec(folder: Path) -> str:
    camera, stranger = folder.parent / "camera.py", folder.parent / "stranger.py"
    return f"fused?lidar={stranger}:Echo&camera={camera}:Eye&fusion={camera}:Join"


def test_scans_are_kept_when_a_fused_run_is_stopped(both):
    done, written = run(both, "--detector", fused_spec(both).replace("Echo", "Falls"))
    assert isinstance(done.exception, PluginError)
    assert len(written["frames"]) == 2
    assert "2 of 3 frames" in done.stderr
    assert all(frame["problem"] for frame in written["frames"])
    assert all(frame["detections"][0]["sensors"] == ["lidar"] for frame in written["frames"])


def test_a_fused_run_that_is_stopped_among_images_keeps_all_scans(both):
    write_images(both / "image_2", SCANS - 1)
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)  # The toy fails on an image without its spot.
    Image.fromarray(pixels).save(both / "image_2" / f"{SCANS - 1:06d}.png")
    done, written = run(both, "--detector", fused_spec(both))
    assert isinstance(done.exception, PluginError)
    sensors = [frame["detections"][0]["sensors"] for frame in written["frames"]]
    assert sensors == [["lidar", "camera"], ["lidar", "camera"], ["lidar"]]
    assert [bool(frame.get("problem")) for frame in written["frames"]] == [False, False, True]
    assert "3 of 3 frames" in done.stderr
    assert "the LiDAR alone in 1" in done.stderr


@pytest.mark.parametrize(
    "option",
    [
        ("--height", "3"),
        ("--lidar-mounting", "0,0,0,0,0,90"),
        ("--poses", "nowhere"),
        ("--layout", "x,y,z"),
        ("--topic", "/points"),
    ],
)
def test_options_of_scans_are_refused_for_images_alone(both, option):
    for place in (both, both / "image_2"):
        done, written = run(place, *option, "--detector", f"{both.parent}/camera.py:Eye")
        assert isinstance(done.exception, FormatError)
        assert option[0] in str(done.exception)
        assert not written


def test_images_alone_have_the_calibration_and_the_stamps_of_scans(both):
    eye = ("--detector", f"{both.parent}/camera.py:Eye")
    (both / "velodyne" / "times.txt").write_text("5.0\n5.1\n5.3\n")
    done, written = works(both, *eye)
    # `Eye` tells the focal length by its score.
    assert [frame["detections"][0]["score"] for frame in written["frames"]] == [0.5] * SCANS
    assert [frame["stamp_s"] for frame in written["frames"]] == [5.0, 5.1, 5.3]
    assert "stamps of images are those of the scans" in done.stderr
    other = both.parent / "other.txt"
    other.write_text(CALIBRATION.replace("500.0", "700.0"))
    done, written = works(both / "image_2", *eye, "--calibration", str(other), out="other")
    assert [frame["detections"][0]["score"] for frame in written["frames"]] == [0.7] * SCANS
    assert "images are taken to be 10 a second" in done.stderr
    done, _ = run(both, *eye, "--calibration", str(both / "nowhere.txt"))
    assert "nowhere.txt: cannot be read" in str(done.exception)
    (both / "calib.txt").write_text("nothing\n")
    done, _ = works(both, *eye)
    assert "a calibration is not used" in done.stderr


@pytest.mark.parametrize(("beside", "detector"), [("velodyne", ""), ("image_2", "Eye")])
def test_a_rate_is_used_or_refused(both, beside, detector):
    place = both / beside
    named = ["--detector", f"{both.parent}/camera.py:{detector}"] if detector else []
    _, written = works(place, "--rate-hz", "5", *named)
    assert [frame["stamp_s"] for frame in written["frames"]] == [0.0, 0.2, 0.4]
    refused, _ = run(place, "--rate-hz", "0", *named)
    assert "a rate above 0 Hz" in str(refused.exception)
    (place / "times.txt").write_text("0.0\n0.1\n0.2\n")
    refused, _ = run(place, "--rate-hz", "5", *named)
    assert "--rate-hz 5 has no effect" in str(refused.exception)


def test_images_that_are_named_are_used_or_refused(both):
    images = both / "image_2"
    named = ("--images", str(images))
    refused, _ = run(images, *named, detector=None)
    assert "no scans" in str(refused.exception)
    (both / "calib.txt").unlink()
    for detector in (None, "Nothing"):
        refused, _ = run(both, *named, detector=detector)
        assert "the images cannot be used: no calibration" in str(refused.exception)


@pytest.mark.parametrize("ending", ["png", "jpg"])
def test_images_alone(folder, ending):
    place = folder.parent / "images"
    write_images(place, ending=ending)
    (folder.parent / "camera.py").write_text(CAMERA)
    pictures = folder.parent / "pictures"
    _, written = works(
        place, "--detector", f"{folder.parent}/camera.py:Eye", "--pictures", str(pictures)
    )
    assert [frame["name"] for frame in written["frames"]] == ["000000", "000001", "000002"]
    slack = 0 if ending == "png" else 1
    for k, frame in enumerate(written["frames"]):
        (box,) = frame["detections"]
        moved = np.add(SPOT, [k, 0, k, 0])
        assert box["image_box_px"] == pytest.approx(moved, abs=slack)
        assert box["category"] == "pedestrian"
        assert "centre_m" not in box
        rows = labels(folder, frame["name"])
        assert rows.boxes[0] == pytest.approx(moved, abs=slack)
        assert not rows.has_3d_box.any()
    assert "lidar_height_m" not in written
    names = sorted(path.name for path in pictures.iterdir())
    assert names == [f"00000{k}_image.png" for k in range(SCANS)]


def test_the_shipped_network_is_the_default_for_images(folder):
    place = folder.parent / "images"
    write_images(place, 1)
    _, written = works(place, detector=None)
    assert written["detectors"] == {"camera": "network"}


def test_a_fusion_gets_both_and_the_calibration(both):
    pictures = both.parent / "pictures"
    _, written = works(both, "--detector", fused_spec(both), "--pictures", str(pictures))
    for k, frame in enumerate(written["frames"]):
        (target,) = frame["detections"]
        assert target["sensors"] == ["lidar", "camera"]
        assert target["image_box_px"] == [300 + k, 200, 340 + k, 260]
        rows = labels(both, frame["name"])
        place = CAMERA_FROM_LIDAR @ [*target["centre_m"], 1]
        assert rows.bottoms[0] == pytest.approx(np.add(place, [0, 0.75, 0]), abs=1e-5)
    names = {path.name for path in pictures.iterdir()}
    assert names == {f"00000{k}_{kind}.png" for k in range(SCANS) for kind in ("scan", "image")}


def test_the_default_for_both_is_a_fusion(both):
    _, written = works(both, detector=None)
    assert set(written["detectors"]) == {"lidar", "camera", "fusion"}
    placed = [
        box for frame in written["frames"] for box in frame["detections"] if "centre_m" in box
    ]
    ahead = {round(box["centre_m"][0]) for box in placed if box["category"] == "car"}
    assert any(abs(x - (CARS[0][0] - FRONT_M)) <= 1 for x in ahead)


def test_labels_of_a_lidar_alone_have_boxes_in_the_image(both):
    _, written = works(both)
    rows = labels(both, "000000")
    assert len(rows) == len(CARS)
    for box, centre in zip(rows.boxes, written["frames"][0]["detections"], strict=True):
        x, y, z = CAMERA_FROM_LIDAR @ [*centre["centre_m"], 1]
        middle = [320 + 500 * x / z, 240 + 500 * y / z]
        assert (box[:2] < middle).all()
        assert (box[2:] > middle).all()
        assert (box >= 0).all()
        assert (box <= [WIDTH, HEIGHT, WIDTH, HEIGHT]).all()


def test_without_a_calibration_images_are_not_used_and_a_note_says_so(both):
    (both / "calib.txt").unlink()
    done, _ = works(both, detector=None)
    assert "the images are not used: no calibration" in done.stderr
    refused, _ = run(both, "--detector", fused_spec(both))
    assert "no calibration" in str(refused.exception)


def test_a_calibration_that_cannot_be_read_is_reported_or_refused(both):
    (both / "calib.txt").write_text("nothing\n")
    done, _ = works(both, detector="Nothing")
    assert "a calibration is not used" in done.stderr
    refused, _ = run(both, "--calibration", str(both / "calib.txt"), detector="Nothing")
    assert isinstance(refused.exception, FormatError)


def test_each_scan_may_have_a_calibration(both):
    (both / "calib.txt").unlink()
    (both / "calib").mkdir()
    for k in range(SCANS):
        focal = f"P2: {500.0 + k}"
        (both / "calib" / f"00000{k}.txt").write_text(CALIBRATION.replace("P2: 500.0", focal))
    _, written = works(both, "--detector", fused_spec(both), "--height", "1")
    # `Eye` tells the focal length by its score, where it is the greater one.
    scores = [frame["detections"][0]["score"] for frame in written["frames"]]
    assert scores == [0.5, 0.501, 0.502]
    (both / "calib" / "000002.txt").unlink()
    done, _ = works(both, detector="Nothing")
    assert "a calibration is not used" in done.stderr
    refused, _ = run(both, "--calibration", str(both / "calib"), detector="Nothing")
    assert "000002.txt" in str(refused.exception)


def test_lost_images_and_scans_are_reported_and_the_other_sensor_is_used(both):
    (both / "image_2" / "000001.png").write_bytes(b"damaged")
    (both / "velodyne" / "000002.bin").write_bytes(b"damaged")
    done, written = works(both, "--detector", fused_spec(both))
    sensors = [[box["sensors"] for box in frame["detections"]] for frame in written["frames"]]
    assert sensors == [[["lidar", "camera"]], [["lidar"]], [["camera"]]]
    assert [bool(frame.get("problem")) for frame in written["frames"]] == [False, True, True]
    assert "1 image cannot be read" in done.stderr
    assert "1 scan is taken as empty" in done.stderr


def test_scans_without_an_image_are_counted(both):
    (both / "image_2" / "000001.png").unlink()
    done, written = works(both, "--detector", fused_spec(both))
    assert "1 of 3 scans have no image" in done.stderr
    sensors = [[box["sensors"] for box in frame["detections"]] for frame in written["frames"]]
    assert sensors == [[["lidar", "camera"]], [["lidar"]], [["lidar", "camera"]]]


@pytest.mark.parametrize("twin", ["velodyne/000001.BIN", "image_2/000001.jpg"])
def test_files_of_one_name_do_not_overwrite_each_other_s_results(both, twin):
    path = both / twin
    if path.suffix == ".BIN":
        rows_of(CARS[:1]).tofile(path)
    else:
        Image.new("RGB", (WIDTH, HEIGHT)).save(path)
    refused, _ = run(both, "--detector", fused_spec(both))
    assert f"{path.name} and 000001." in str(refused.exception)
    alone = (
        f"{both.parent}/camera.py:Eye"
        if path.suffix == ".jpg"
        else f"{both.parent}/stranger.py:Echo"
    )
    refused, _ = run(path.parent, "--detector", alone)
    assert "have one name but for the ending" in str(refused.exception)


@pytest.mark.parametrize("scale", [0.5, 2])
def test_a_calibration_of_images_of_another_size_is_doubted(both, scale):
    for path in (both / "image_2").iterdir():
        with Image.open(path) as image:
            resized = image.resize((int(scale * WIDTH), int(scale * HEIGHT)))
        resized.save(path)
    done, _ = works(both, "--detector", fused_spec(both))
    assert "is the calibration of images of another size?" in done.stderr


def test_images_of_other_names_belong_to_scans_by_time(both):
    for k, path in enumerate(sorted((both / "image_2").iterdir())):
        path.rename(path.with_name(f"{k + 7:010d}.png"))
    refused, _ = run(both, "--detector", fused_spec(both))
    assert "nothing says when they were taken" in str(refused.exception)
    (both / "velodyne" / "times.txt").write_text("0.0\n0.1\n0.2\n")
    (both / "image_2" / "times.txt").write_text("0.11\n0.21\n0.9\n")
    done, written = works(both, "--detector", fused_spec(both))
    left = [
        [box["image_box_px"][0] for box in frame["detections"] if "image_box_px" in box]
        for frame in written["frames"]
    ]
    assert left == [[], [300], [301]]
    (both / "image_2" / "times.txt").write_text("7.11\n7.21\n7.9\n")
    done, written = works(both, detector=None)
    assert "the images are not used: no scan has an image" in done.stderr


def test_images_whose_stamps_contradict_their_names_belong_to_scans_by_time(both):
    (both / "velodyne" / "times.txt").write_text("0.0\n0.3\n0.6\n")
    (both / "image_2" / "times.txt").write_text("0.01\n0.31\n0.61\n")
    done, written = works(both, "--detector", fused_spec(both))
    assert "by their stamps" not in done.stderr
    (both / "image_2" / "times.txt").write_text("0.1\n0.2\n0.3\n")
    done, written = works(both, "--detector", fused_spec(both))
    lefts = [frame["detections"][0].get("image_box_px", [None])[0] for frame in written["frames"]]
    assert lefts == [None, 302, None]
    assert "images belong to scans by their stamps: of the same name they are up to 0.3 s" in (
        done.stderr
    )
    (both / "image_2" / "times.txt").write_text("7.1\n7.2\n7.3\n")
    refused, _ = run(both, "--detector", fused_spec(both))
    assert "no scan has an image" in str(refused.exception)
    (both / "image_2" / "times.txt").write_text("0.1\n")
    done, written = works(both, "--detector", fused_spec(both))
    assert "the stamps of images are not used" in done.stderr
    assert [len(frame["detections"][0]["sensors"]) for frame in written["frames"]] == [2] * SCANS


def test_pictures_are_not_written_among_the_images(both):
    done, _ = run(both, "--pictures", str(both / "image_2"), detector="Nothing")
    assert "name another folder" in str(done.exception)


def test_a_bird_s_eye_view_shows_returns_and_boxes(folder):
    shots = {}
    for detector in ("Nothing", ""):
        place = folder.parent / f"pictures{detector}"
        works(folder, "--pictures", str(place), detector=detector, out=f"out{detector}")
        shots[detector] = np.asarray(Image.open(place / "000000_scan.png")).astype(int)
    # Cars at 12 and 20 m, the way ahead is upwards.
    changed = np.argwhere((shots[""] != shots["Nothing"]).any(axis=2))
    assert len(changed) > 100
    rows, columns = changed.T
    assert rows.max() < shots[""].shape[0] * 0.6
    assert columns.min() < shots[""].shape[1] / 2 < columns.max()


def test_a_camera_detector_needs_images(folder):
    done, _ = run(folder, "--detector", "network")
    assert "network needs images" in str(done.exception)


def test_images_none_of_which_can_be_read_are_refused(tmp_path):
    (tmp_path / "0.png").write_bytes(b"damaged")
    done, _ = run(tmp_path, "--detector", "network")
    assert "0.png: expected an image" in str(done.exception)


@pytest.mark.parametrize("place", ["velodyne/0000", "sequences/00/velodyne", "training/velodyne"])
@pytest.mark.parametrize("command", ["detect", "run-odometry"])
def test_of_the_root_of_a_data_set_a_folder_with_scans_is_named(folder, command, place):
    root = folder.parent / "root"
    (root / place).parent.mkdir(parents=True)
    for name in ("calib", "image_2", "velodyne_times"):
        (root / name).mkdir()
    folder.rename(root / place)
    done = CliRunner().invoke(app, [command, str(root), "--out", str(folder.parent / "out")])
    named = str(done.exception).rpartition("such as ")[2]
    assert named == str(root / place.removesuffix("/velodyne"))
    assert "expected" in str(done.exception)


@pytest.mark.parametrize("copy", ["{} (1)", "{}(2)", "{} copy", "{} copy 2", "{} - Copy"])
def test_copies_of_scans_and_images_are_refused(both, copy):
    for place, ending in ((both / "velodyne", "bin"), (both / "image_2", "png")):
        first = place / f"000000.{ending}"
        first.with_stem(copy.format(first.stem)).write_bytes(first.read_bytes())
        for command in ("detect", "run-odometry")[: 1 + (ending == "bin")]:
            line = [command, str(place), "--out", str(both.parent / "out")]
            done = CliRunner().invoke(app, line)
            assert f"{copy.format('000000')}.{ending} is a copy of" in str(done.exception)


def test_a_name_as_of_a_copy_is_no_copy_if_the_content_differs(folder):
    rows_of()[:-1].tofile(folder / "000000 (1).bin")
    _, written = works(folder, detector="Nothing")
    assert len(written["frames"]) == SCANS + 1


def test_an_empty_folder_is_refused(tmp_path):
    done, _ = run(tmp_path)
    assert "expected scans .bin" in str(done.exception)
    assert "images .png" in str(done.exception)
    done, _ = run(tmp_path / "missing")
    assert "no such folder" in str(done.exception)


# --------------------------------------------------------------------------------------------------
# Bags.


def test_a_bag_with_both_sensors(folder, monkeypatch):
    from rosbags.rosbag2 import Reader

    opened, open_reader = [], Reader.open
    monkeypatch.setattr(Reader, "open", lambda self: opened.append(self) or open_reader(self))
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    pixels[200:260, 300:340] = 255
    rows, content = rows_of(), BytesIO()
    Image.fromarray(pixels).save(content, format="png")
    messages = []
    for k in range(SCANS):
        fields = dict(zip(("x", "y", "z", "intensity"), rows.T, strict=True))
        messages.append((0.1 * k, "/points", cloud(0.1 * k, fields)))
        messages.append((0.1 * k + 0.01, "/image", jpeg(0.1 * k + 0.01, content.getvalue())))
    bag = write_bag(folder.parent / "bag", messages, mcap=True)
    (folder.parent / "camera.py").write_text(CAMERA)
    calibration = folder.parent / "mine.txt"
    calibration.write_text(CALIBRATION)
    _, written = works(bag, "--detector", fused_spec(bag), "--calibration", str(calibration))
    assert len(opened) == 1
    targets = [frame["detections"] for frame in written["frames"]]
    assert [[box["sensors"] for box in each] for each in targets] == [[["lidar", "camera"]]] * SCANS
    assert [each[0]["image_box_px"] for each in targets] == [[300, 200, 340, 260]] * SCANS
    _, written = works(bag, out="scans-alone")
    assert [len(frame["detections"]) for frame in written["frames"]] == [len(CARS)] * SCANS
