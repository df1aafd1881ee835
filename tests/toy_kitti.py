"""A small folder in KITTI's layout, with traffic that is simple enough to check by hand."""

from pathlib import Path

import numpy as np
from toy_boxes import tracks

from roadscope.benchmarks.formats import box_corners, clipped_image_boxes, observation_angles
from roadscope.core import Category
from roadscope.formats import ImageSize

FRAMES = 30
EGO_SPEED_M_S = 10.0
P2 = np.array([[720.0, 0, 610, 45], [0, 720, 173, 0.2], [0, 0, 1, 0.003]])
IMAGE_SIZE = ImageSize(1242, 375)
CALIBRATION = (
    "P2: " + " ".join(f"{v:.6e}" for v in P2.ravel()) + "\n"
    "R0_rect: 1 0 0 0 1 0 0 0 1\n"
    "Tr_velo_to_cam: 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\n"
    "Tr_imu_to_velo: 1 0 0 -0.8 0 1 0 0.32 0 0 1 -0.8\n"
)
# type, id, x, z at frame 0, speed along z in m/s, all in the camera's first frame
ACTORS = (
    ("Car", 0, 2.0, 12.0, 10.0),
    ("Car", 1, -3.5, 60.0, -8.0),
    ("Van", 2, 5.0, 20.0, 10.0),
    ("Pedestrian", 3, 6.0, 45.0, 1.0),
)
SIZES = {"Car": (1.5, 1.7, 4.2), "Van": (2.1, 1.9, 5.0), "Pedestrian": (1.75, 0.6, 0.8)}
CLASS_OF = {"Car": "Car", "Van": "Car", "Pedestrian": "Pedestrian"}
CLASS_ID = {"Pedestrian": 1, "Car": 2, "Cyclist": 3}


def write_kitti(folder: Path, sequences: tuple[str, ...] = ("0000", "0001")) -> Path:
    """Write labels, calibration, ego poses and detections of `det_toy`; return the folder."""
    for number, sequence in enumerate(sequences):
        rng = np.random.default_rng(number)
        labels, detections = [], {name: [] for name in CLASS_ID}
        for frame in range(FRAMES):
            labels.append(
                f"{frame} -1 DontCare -1 -1 -10 10 10 60 60 -1000 -1000 -1000 -10 -1 -1 -1"
            )
            for kind, number_of, x, z, speed in ACTORS:
                place = np.array([[x, 1.7, z + (speed - EGO_SPEED_M_S) * frame * 0.1]])
                _add(labels, detections, (frame, kind, number_of), place, rng)
        _write(folder / "label_02" / f"{sequence}.txt", labels)
        _write(folder / "calib" / f"{sequence}.txt", [CALIBRATION.strip()])
        poses = [f"1 0 0 0 0 1 0 0 0 0 1 {EGO_SPEED_M_S * 0.1 * t}" for t in range(FRAMES)]
        _write(folder / "ego_pose" / f"{sequence}.txt", poses)
        for name, rows in detections.items():
            _write(folder / "det_toy" / name / f"{sequence}.txt", rows)
    return folder


def _add(labels, detections, what, place, rng) -> None:
    frame, kind, number = what
    turned, size = -np.pi / 2, SIZES[kind]
    box = _image_box(place, size, turned)
    if box is None:
        return
    alpha = observation_angles(place, np.array([turned]))[0]
    labels.append(_text(frame, number, kind, 0, 0, alpha, *box, *size, *place[0], turned))
    detected_centre = place + rng.normal(0, 0.1, 3) * (1, 0.3, 1)
    box = _image_box(detected_centre, size, turned)
    if box is not None and rng.random() > 0.05:
        name = CLASS_OF[kind]
        values = (
            frame,
            CLASS_ID[name],
            *box,
            rng.normal(4, 2),
            *size,
            *detected_centre[0],
            turned,
            alpha,
        )
        detections[name].append(_text(*values, separator=","))


def _image_box(place, size, turned):
    lwh = np.array([size[::-1]])
    box = clipped_image_boxes(box_corners(place, lwh, np.array([turned])), P2, IMAGE_SIZE)[0]
    return box if place[0, 2] > 2 and box[2] > box[0] and box[3] > box[1] else None


def _text(*values, separator=" ") -> str:
    return separator.join(f"{v:.6f}" if isinstance(v, float) else str(v) for v in values)


def _write(path: Path, lines: list[str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(line + "\n" for line in lines))


def tracks_at(centres, *, frame="ego", categories=None):
    """Tracks 7, 8 ... of cars, all alike but for place, yaw and score."""
    n = len(centres)
    return tracks(
        centres,
        np.arange(n) + 7,
        sizes=[4.2, 1.7, 1.5],
        yaws=np.linspace(-3, 3, n),
        categories=Category.CAR if categories is None else categories,
        scores=np.linspace(0, 1, n),
        frame=frame,
    )
