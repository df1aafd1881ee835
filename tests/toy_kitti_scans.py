"""Small folders of KITTI's object and tracking data with scans, in KITTI's published format.

Every car is eight points, its corners, of an intensity of its own; `Corners` finds it by them.
"""

from pathlib import Path

import numpy as np
from PIL import Image
from toy_boxes import detections, image_detections

from roadscope.benchmarks.formats import box_corners, clipped_image_boxes
from roadscope.core import Detections
from roadscope.formats import ImageSize

SIZE = ImageSize(1242, 375)
P2 = np.array(
    [[721.5377, 0, 609.5593, 44.85728], [0, 721.5377, 172.854, 0.2163791], [0, 0, 1, 2.7459e-3]]
)
R0 = np.array(
    [
        [0.9999239, 0.00983776, -0.00744505],
        [-0.0098698, 0.9999421, -0.00427846],
        [0.00740253, 0.00435161, 0.9999631],
    ]
)
VELO = np.array(
    [
        [0.007533745, -0.9999714, -0.000616602, -0.004069766],
        [0.01480249, 0.0007280733, -0.9998902, -0.07631618],
        [0.9998621, 0.00752379, 0.01480755, -0.2717806],
    ]
)
IMU = np.array([[1, 0, 0, -0.81], [0, 1, 0, 0.32], [0, 0, 1, -0.8]])
RED = 250
CAR = (4.0, 1.6, 1.5)
"""Length, width and height of every car."""


class Corners:
    """Finds the cars: points of one intensity are the corners of a car."""

    kind = "detector"

    def __init__(self, *, shift_m: float = 0.0, score: float = 0.9):
        self.shift_m, self.score = shift_m, score

    def reset(self):
        pass

    def detect(self, frame):
        scan, boxes = frame.lidar, []
        ego_from_lidar = frame.calibration.pose("lidar")
        for intensity in np.unique(scan.intensity[scan.intensity > 0.25]):
            corners = ego_from_lidar.apply(scan.points[scan.intensity == intensity].astype(float))
            # Corners come in pairs along the length, rear first.
            along = corners[1] - corners[0]
            boxes.append([*corners.mean(axis=0), np.arctan2(along[1], along[0])])
        box_rows = np.array(boxes).reshape(-1, 4)
        return detections(
            box_rows[:, :3] + [self.shift_m, 0, 0],
            sizes=CAR,
            yaws=box_rows[:, 3],
            scores=self.score,
            frame="ego",
            stamp_s=scan.stamp_s,
        )


class Blind(Corners):
    """Finds nothing."""

    def detect(self, frame):
        return Detections.empty(frame.lidar.stamp_s)


class Painted:
    """Finds the cars in an image: each is painted in a green of its own."""

    kind = "camera detector"

    def reset(self):
        pass

    def detect(self, frame):
        pixels, boxes = frame.camera.pixels, []
        for green in np.unique(pixels[..., 1][pixels[..., 0] == RED]):
            rows, columns = np.nonzero((pixels[..., 0] == RED) & (pixels[..., 1] == green))
            boxes.append([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        return image_detections(boxes, scores=0.8, stamp_s=frame.camera.stamp_s)


def image_of(frame: int) -> np.ndarray:
    """Return (H, W, 3) uint8: the cars' image boxes on grey."""
    pixels = np.full((SIZE.height, SIZE.width, 3), 90, np.uint8)
    for number, line in enumerate(label_lines(frame, tracking=False)[:2]):
        left, top, right, bottom = (round(float(text)) for text in line.split()[4:8])
        pixels[top:bottom, left:right] = (RED, 100 + 50 * number, 0)
    return pixels


def write_images(folder: Path, frames: int = 3) -> Path:
    """Add images to every sequence, or to the object data; return the folder."""
    root = folder / "training" if (folder / "training").is_dir() else folder
    sequences = [path.stem for path in (root / "label_02").glob("*.txt")]
    places = [root / "image_02" / name for name in sequences] or [root / "image_2"]
    for place in places:
        place.mkdir(parents=True)
        for frame in range(frames):
            Image.fromarray(image_of(frame)).save(place / f"{frame:06d}.png")
    return folder


def calibration(*, tracking: bool = False) -> str:
    """The text of a calibration file; the tracking data spell keys in another way."""
    names = ("R_rect", "Tr_velo_cam", "Tr_imu_velo")
    names = names if tracking else ("R0_rect:", "Tr_velo_to_cam:", "Tr_imu_to_velo:")
    matrices = {f"P{k}:": P2 for k in range(4)} | dict(zip(names, (R0, VELO, IMU), strict=True))
    return "".join(f"{k} {' '.join(f'{v:.12e}' for v in m.ravel())}\n" for k, m in matrices.items())


def cars_of(frame: int) -> list[tuple[float, float, float, float]]:
    """x y z of the bottom's centre and rotation_y of two cars, rectified camera frame."""
    return [
        (-3.0 + 0.1 * frame, 1.7, 14.0 + frame, -1.5 + 0.02 * frame),
        (4.0, 1.6, 24.0 + 0.5 * frame, 0.4),
    ]


def scan_of(frame: int) -> np.ndarray:
    """Return (N, 4) float32: rings on the road, and the corners of the cars."""
    azimuths = np.deg2rad(np.arange(0.0, 360.0, 2.0))
    rings = [
        np.column_stack([r * np.cos(azimuths), r * np.sin(azimuths), np.full(180, -1.73)])
        for r in (5.0, 7.0, 10.0, 15.0, 22.0)
    ]
    road = np.concatenate(rings)
    points = [np.column_stack([road, np.full(len(road), 0.2)])]
    for number, (x, y, z, turn) in enumerate(cars_of(frame)):
        corners = box_corners(np.array([[x, y, z]]), np.array([CAR]), np.array([turn]))[0]
        in_lidar = (np.linalg.inv(R0) @ corners.T - VELO[:, 3:]).T @ np.linalg.inv(VELO[:, :3]).T
        points.append(np.column_stack([in_lidar, np.full(8, 0.5 + 0.1 * number)]))
    return np.concatenate(points).astype("<f4")


def label_lines(frame: int, *, tracking: bool) -> list[str]:
    """The labels of a frame: two cars and a region without labels."""
    lines = []
    for number, (x, y, z, turn) in enumerate(cars_of(frame)):
        corners = box_corners(np.array([[x, y, z]]), np.array([CAR]), np.array([turn]))
        box = " ".join(f"{v:.2f}" for v in clipped_image_boxes(corners, P2, SIZE)[0])
        alpha = turn - np.arctan2(x, z)
        length, width, height = CAR
        truncated = "0" if tracking else "0.00"
        lines.append(
            f"Car {truncated} 0 {alpha:.2f} {box} {height} {width} {length} {x} {y} {z} {turn}"
        )
        if tracking:
            lines[-1] = f"{frame} {number} {lines[-1]}"
    region = "DontCare -1 -1 -10 800.38 163.67 825.45 184.07"
    if tracking:
        return [*lines, f"{frame} -1 {region} -1000 -1000 -1000 -10 -1 -1 -1"]
    return [*lines, f"{region} -1 -1 -1 -1000 -1000 -1000 -10"]


def write_objects(folder: Path, frames: int = 3) -> Path:
    """Write object data: velodyne, calib and label_2 in `training`; return the folder."""
    root = folder / "training"
    for frame in range(frames):
        _write(root / "velodyne" / f"{frame:06d}.bin", scan_of(frame).tobytes())
        _write(root / "calib" / f"{frame:06d}.txt", calibration())
        text = "\n".join(label_lines(frame, tracking=False)) + "\n"
        _write(root / "label_2" / f"{frame:06d}.txt", text)
    return folder


def write_tracking(
    folder: Path, sequences: tuple[str, ...] = ("0000", "0001"), frames: int = 3
) -> Path:
    """Write tracking data: velodyne, calib, label_02 and ego_pose; return the folder."""
    for name in sequences:
        for frame in range(frames):
            _write(folder / "velodyne" / name / f"{frame:06d}.bin", scan_of(frame).tobytes())
        _write(folder / "calib" / f"{name}.txt", calibration(tracking=True))
        lines = [line for k in range(frames) for line in label_lines(k, tracking=True)]
        _write(folder / "label_02" / f"{name}.txt", "\n".join(lines) + "\n")
        poses = "".join(f"1 0 0 {0.2 * k} 0 1 0 0 0 0 1 {1.5 * k}\n" for k in range(frames))
        _write(folder / "ego_pose" / f"{name}.txt", poses)
    return folder


def _write(path: Path, content: str | bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
