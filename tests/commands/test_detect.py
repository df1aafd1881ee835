"""`roadscope detect` on folders of scans."""

import json
from pathlib import Path

import numpy as np
import pytest
from toy_lidar import FRONT_M, HEIGHT_M, scan
from typer.testing import CliRunner

from roadscope.__main__ import app
from roadscope.benchmarks.formats import bottoms_from_centres, read_kitti_object_results
from roadscope.benchmarks.isolation import PluginError

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
    seen = scan(boxes, elevations=np.arange(-15.0, 16.0), azimuths=around)
    return np.column_stack([seen.points, seen.intensity]).astype("<f4")


@pytest.fixture
def folder(tmp_path) -> Path:
    place = tmp_path / "scans"
    place.mkdir()
    for k in range(SCANS):
        rows_of().tofile(place / f"{k:06d}.bin")
    (tmp_path / "stranger.py").write_text(STRANGER)
    return place


def run(folder: Path, *options: str, detector: str = "", out: str = "out"):
    """The finished command, and what `detections.json` says if it is there."""
    spec = f"{folder.parent}/stranger.py:{detector}" if detector else "distance-l-shape"
    place = folder.parent / out
    done = CliRunner().invoke(
        app, ["detect", str(folder), "--out", str(place), "--detector", spec, *options]
    )
    file = place / "detections.json"
    return done, json.loads(file.read_text()) if file.is_file() else {}


def labels(folder: Path, name: str, out: str = "out"):
    return read_kitti_object_results(folder.parent / out / "labels" / f"{name}.txt", 0)


def test_cars_are_where_they_stand(folder):
    done, found = run(folder)
    assert done.exit_code == 0, done.output
    assert found["lidar_height_m"] == pytest.approx(HEIGHT_M, abs=0.03)
    assert [each["name"] for each in found["frames"]] == ["000000", "000001", "000002"]
    for frame in found["frames"]:
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
    done, found = run(folder, "--height", "1.25", detector="Echo")
    assert done.exit_code == 0, done.output
    assert found["lidar_height_m"] == 1.25
    assert "1.25 m above the ground, as named" in done.stderr
    box = found["frames"][0]["detections"][0]
    # The plug-in puts a box of 1.25 m at the sensor's height: 0 in the LiDAR's axes.
    assert box["centre_m"] == pytest.approx([10, len(rows_of()) / 1000, 0], abs=1e-9)
    assert labels(folder, "000000").bottoms[0, 1] == pytest.approx(1.5 / 2)


def test_boxes_are_in_the_axes_of_a_turned_lidar_and_labels_ahead_of_the_vehicle(folder):
    done, found = run(folder, "--lidar-mounting", "0,0,0,0,0,90", detector="Echo")
    assert done.exit_code == 0, done.output
    box, count = found["frames"][0]["detections"][0], len(rows_of()) / 1000
    assert box["centre_m"][:2] == pytest.approx([count, -10])
    assert box["yaw_rad"] == pytest.approx(0, abs=1e-9)
    assert labels(folder, "000000").bottoms[0, [0, 2]] == pytest.approx([-count, 10])


def test_every_scan_has_a_label_file(folder):
    done, found = run(folder, detector="Nothing")
    assert done.exit_code == 0, done.output
    assert [len(labels(folder, f"{k:06d}")) for k in range(SCANS)] == [0] * SCANS
    assert [frame["detections"] for frame in found["frames"]] == [[]] * SCANS


def test_poses_give_the_motion_of_the_ego(folder):
    poses = folder.parent / "poses.txt"
    poses.write_text("".join(f"1 0 0 {0.5 * k} 0 1 0 0 0 0 1 0\n" for k in range(SCANS)))
    done, found = run(folder, "--poses", str(poses), detector="Echo")
    assert done.exit_code == 0, done.output
    ahead = [frame["detections"][0]["centre_m"][0] for frame in found["frames"]]
    assert ahead == pytest.approx([10, 10.5, 10.5])


def test_an_answer_of_a_late_detector_is_put_to_its_scan(folder):
    for k in range(SCANS):
        rows_of()[: -k or None].tofile(folder / f"{k:06d}.bin")
    done, found = run(folder, detector="Late")
    assert done.exit_code == 0, done.output
    counts = [[1000 * b["centre_m"][1] for b in frame["detections"]] for frame in found["frames"]]
    assert counts == [pytest.approx([len(rows_of())]), pytest.approx([len(rows_of()) - 1]), []]


def test_a_damaged_scan_is_empty_and_told(folder):
    (folder / "000001.bin").write_bytes(b"damaged")
    done, found = run(folder)
    assert done.exit_code == 0, done.output
    assert "1 scan is taken as empty" in done.stderr
    assert [bool(frame.get("problem")) for frame in found["frames"]] == [False, True, False]
    assert [len(frame["detections"]) for frame in found["frames"]] == [2, 0, 2]


def test_results_are_kept_when_a_plugin_fails(folder):
    done, found = run(folder, detector="Falls")
    assert isinstance(done.exception, PluginError)
    assert len(found["frames"]) == 2
    assert "2 of 3 scans" in done.stderr


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
    done, found = run(folder, *options)
    assert isinstance(done.exception, ValueError)
    assert message in str(done.exception)
    assert not found


def test_a_lidar_without_ground_needs_its_height(folder):
    for path in folder.iterdir():
        rows = rows_of()
        rows[rows[:, 2] >= 0].tofile(path)
    done, _ = run(folder)
    assert "--height METRES" in str(done.exception)
    assert run(folder, "--height", str(HEIGHT_M))[0].exit_code == 0


def test_json_is_the_only_output(folder):
    done, _ = run(folder, "--json", detector="Echo")
    told = json.loads(done.stdout)
    assert told["frames"] == SCANS
    assert told["detections"] == {"car": SCANS}
