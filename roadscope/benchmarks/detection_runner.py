"""Runs detectors and fusions on recorded scans and images, and writes what they detect."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from roadscope.benchmarks.formats.bags import CLOUDS, Bag, Source, open_bag
from roadscope.benchmarks.formats.image_folder import IMAGE_ENDINGS, ImageFolder, read_image
from roadscope.benchmarks.formats.kitti_cameras import KittiCameras
from roadscope.benchmarks.formats.kitti_frames import CAMERA_FROM_EGO, LabelCamera
from roadscope.benchmarks.formats.point_fields import ENDINGS, READERS
from roadscope.benchmarks.formats.scan_folder import ScanFolder, scan_files
from roadscope.benchmarks.formats.scan_stamps import (
    Stamps,
    in_order,
    stamps_of_files,
    without_ending,
)
from roadscope.benchmarks.formats.table import FormatError, names_in
from roadscope.benchmarks.formats.tracking_rows import ImageSize
from roadscope.benchmarks.kinds import CAMERA_DETECTOR, DETECTOR, FUSION, traits_of
from roadscope.benchmarks.loop import open_checked
from roadscope.benchmarks.odometry_runner import (
    TruePoses,
    check_rate,
    find_scans,
    hint_below,
    rate_of,
    refuse_copies,
)
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.references import (
    CALIBRATION,
    check_detection_source,
    check_image_source,
    made_from_truth,
)
from roadscope.core import (
    Calibration,
    CameraImage,
    Detections,
    Frame,
    ImageDetections,
    Pose,
    Spec,
    SpecError,
)
from roadscope.core.answers import AnswerError, check_detections, same_stamp
from roadscope.core.fused import FusedDetections
from roadscope.core.spec import FUSED, FUSED_PARTS
from roadscope.fusion.pairing import ALONE, LIMIT_S, ClocksApartError, nearest_images
from roadscope.odometry.above_ground import NEAR_M, sensor_height
from roadscope.odometry.travel import turned_scan

LIDAR, CAMERA = "lidar", "camera"
"""The names of the sensors in `Calibration`."""
SCAN_DETECTOR, IMAGE_DETECTOR, BOTH_DETECTORS = "distance-l-shape", "network", "fused"
"""The detectors for scans, for images, and for both with a calibration."""
MOVING_DETECTOR = "long-range"
"""The class of this detector is the only one in roadscope that uses the motion of the ego."""
NO_CALIBRATION = "no calibration, calib.txt or calib in DIR or beside it, or --calibration PATH"
NO_GROUND = (
    "the scans show no ground below the LiDAR, or have no points: name its height, --height "
    "METRES, and if its z axis does not point up, --lidar-mounting"
)
CENTRAL = (1 / 3, 2 / 3)
"""Where the principal point lies in an image, as shares of its width. Chosen by hand: it is at 0.49
in KITTI's images, and at 0.25 or 1 with the calibration of images twice as small or large."""
HEIGHT_SCANS = 20
"""Most scans by which the height of the LiDAR is estimated."""
LAYER_M = 0.1
"""Returns at most this far above or below the ground are counted as ground. Chosen by hand."""
FLATTEST = 15.0
"""Greatest median distance of the ground, in heights of the LiDAR. Chosen by hand: on our motorway
it is 2.8 for an HDL-32E and 5.1 for a VLP-16; it is 126 where the flat beams of a LUX meet people
and cars in place of the ground."""


class DetectorSet(NamedTuple):
    """The resolved specs of a run: one detector, or two and their fusion."""

    lidar: Spec | None
    camera: Spec | None
    fusion: Spec | None = None

    @staticmethod
    def of(text: str, *, of_images: bool = False) -> DetectorSet:
        """Read the spec of a LiDAR detector, of a camera detector, or `fused?lidar=A&camera=B`.

        Oracles and noise models are refused: recordings have no truth.
        of_images: a class that does not say its kind is a camera detector.
        """
        spec = Spec.parse(text)
        if spec.name == FUSED:
            spec = check_detection_source(spec)
            if CALIBRATION in spec.arguments:
                raise SpecError(f"'{text}': the calibration of a recording is in KITTI's files")
            parts = DetectorSet(*(spec.parts[key] for key in FUSED_PARTS))
        elif spec.name in CAMERA_DETECTOR.registry or _is_of_camera(spec, of_images):
            parts = DetectorSet(None, check_image_source(spec))
        else:
            parts = DetectorSet(check_detection_source(spec), None)
        if any(part is not None and made_from_truth(part) for part in parts):
            raise SpecError(f"{text} is made from the truth: it can run only on boards")
        return parts


def _is_of_camera(spec: Spec, of_images: bool) -> bool:
    """Return whether a class is a camera detector."""
    if not spec.is_class:
        return False
    kind = traits_of(DETECTOR.registry.resolve(spec)).kind
    return kind == CAMERA_DETECTOR.name or (of_images and not kind)


def height_above_ground(scans: ScanFolder, turn: np.ndarray) -> float | None:
    """Return the median height of the LiDAR in metres; None unless most scans show it.

    turn: (3, 3), brings the LiDAR's axes to x ahead, y left, z up.
    """
    rows = np.unique(np.linspace(0, len(scans) - 1, HEIGHT_SCANS).round().astype(int))
    some = (scan for row in rows.tolist() for scan in scans.part(row, row + 1) if len(scan))
    heights = np.array([_height(turned_scan(scan, turn).points) for scan in some])
    finite = heights[np.isfinite(heights)]
    return float(np.median(finite)) if 2 * len(finite) > len(heights) else None


def _height(points: np.ndarray) -> float:
    """Return the height in metres by (N, 3) points; nan without ground that is seen from above.

    Flat beams hit upright things everywhere at one height, as if it were the ground.
    """
    height_m = float(sensor_height(points))
    ground = points[np.abs(points[:, 2] + height_m) < LAYER_M, :2]
    ranges = np.hypot(*ground.T)
    near = ranges[ranges < NEAR_M]
    return height_m if len(near) and np.median(near) <= FLATTEST * height_m else np.nan


class DetectedImage(NamedTuple):
    """The detections in an image, and its width and height in pixels."""

    detections: ImageDetections
    size: ImageSize


@dataclass(frozen=True, slots=True)
class DetectedFrame:
    """What was detected at one moment.

    name: of the scan or image, without ending.
    camera: in whose frame label files are.
    problem: what could not be read, or "".
    fused: False for the detections of the LiDAR alone, before those of the camera are there.
    """

    name: str
    stamp_s: float
    detections: FusedDetections
    camera: LabelCamera
    problem: str = ""
    fused: bool = True


@dataclass(frozen=True, slots=True)
class DetectionJob:
    """Recorded scans, images or both, and what detects in them.

    names, stamps_s: of the frames: the scans, or the images if there are no scans.
    scans: None if only images are used.
    images: None if there are none; they are read only if `detectors` has a camera detector.
    image_rows: for each frame the number of its image, `ALONE` where none is near.
    cameras: None without a calibration.
    ego_from_lidar: the ego is on the ground below the LiDAR.
    poses: `start_from_lidar`, (4, 4), of each scan, for detectors that use the ego's motion.
    notes: what was assumed, in sentences.
    """

    detectors: DetectorSet
    names: Sequence[str]
    stamps_s: Sequence[float]
    scans: ScanFolder | None
    images: ImageFolder | None
    image_rows: Sequence[int]
    cameras: KittiCameras | None
    ego_from_lidar: Pose
    poses: Sequence[np.ndarray | None] = ()
    notes: Sequence[str] = ()

    def __len__(self) -> int:
        return len(self.names)

    def frames(self, progress: Progress = silent) -> Iterator[tuple[int, DetectedFrame]]:
        """Yield the number of a frame and what is detected in it.

        A LiDAR detector that answers late has an empty answer for a scan first, and then another.
        A fusion comes after the LiDAR detector has had all scans: each frame is yielded with the
        detections of the LiDAR alone first, and fused later.
        A plug-in that fails raises `PluginError`. One that is not part of roadscope runs in a
        process of its own, without a time limit for the whole recording.
        """
        if self.detectors.camera is None:
            for row, detections in self._scan_detections(progress):
                yield row, self._frame(row, FusedDetections.of(detections, None))
            return
        points: dict[int, Detections] = {}
        for row, detections in self._scan_detections(progress) if self.detectors.lidar else ():
            points[row] = detections
            alone = self._frame(row, FusedDetections.of(detections, None))
            yield row, replace(alone, fused=False)
        spec = self.detectors.fusion
        with open_checked(spec, FUSION) if spec else nullcontext() as fusion:
            for row, image in enumerate(self._image_detections(progress)):
                yield row, self._frame(row, self._fused(fusion, row, points.get(row), image), image)

    def losses(self) -> list[str]:
        """Return what could not be used of the recording so far, in sentences."""
        lost = [] if self.scans is None else list(self.scans.losses.notes())
        errors = [] if self.images is None else list(self.images.losses.values())
        if errors:
            images = "1 image" if len(errors) == 1 else f"{len(errors)} images"
            lost.append(f"{images} cannot be read, the first: {errors[0]}")
        return lost

    def _scan_detections(self, progress: Progress) -> Iterator[tuple[int, Detections]]:
        """Yield the number of a scan and the detections in it, ego frame; see `frames`."""
        spec, scans = self.detectors.lidar, self.scans
        assert spec is not None
        assert scans is not None
        calibration = Calibration(((LIDAR, self.ego_from_lidar),))
        answered: list[Detections] = []
        check = partial(_answered_scan, answered, self.stamps_s)
        with open_checked(spec, DETECTOR, check) as detect:
            for now, scan in enumerate(scans):
                motion = self._motion(now)
                frame = Frame(scan.stamp_s, calibration, lidar=scan, previous_from_ego=motion)
                answered.append(Detections.empty(scan.stamp_s))
                row, detections = detect(frame)
                answered[row] = detections
                progress("scans", now + 1, len(scans))
                if row != now:
                    yield now, answered[now]
                yield row, detections

    def _motion(self, row: int) -> Pose | None:
        """Return `previous_from_ego` at a scan; None if its pose or that before is not known."""
        before, now = self.poses[row - 1 : row + 1] if row and self.poses else (None, None)
        if before is None or now is None:
            return None
        previous_from_now = Pose(before).inverse() @ Pose(now)
        return self.ego_from_lidar @ previous_from_now @ self.ego_from_lidar.inverse()

    def _image_detections(self, progress: Progress) -> Iterator[DetectedImage | None]:
        """Yield the detections in the image of each frame; None where none can be read."""
        spec, images = self.detectors.camera, self.images
        assert spec is not None
        assert images is not None
        with open_checked(spec, CAMERA_DETECTOR) as detect:
            for row, image in enumerate(self.image_rows):
                pixels = None if image == ALONE else images.read(image)
                if pixels is None:
                    yield None
                else:
                    boxes = detect(self._image_frame(row, pixels))
                    yield DetectedImage(boxes, ImageSize(*pixels.shape[1::-1]))
                progress("images", row + 1, len(self))

    def _image_frame(self, row: int, pixels: np.ndarray) -> Frame:
        """Return what a camera detector gets; without a calibration, a common field of view.

        Without scans nothing says how high the camera is, so it has no mounting pose.
        """
        height, width = pixels.shape[:2]
        intrinsics = np.array([[width, 0.0, width / 2], [0.0, width, height / 2], [0.0, 0.0, 1.0]])
        calibration, stamp_s = Calibration(), self.stamps_s[row]
        if self.cameras is not None:
            camera = self.cameras.of(self.names[row])
            intrinsics = camera.projection[:, :3]
            if self.scans is not None:
                mount = self.ego_from_lidar @ camera.camera_from_lidar.inverse()
                calibration = Calibration(((CAMERA, mount),))
        image = CameraImage(pixels, intrinsics, stamp_s, CAMERA)
        return Frame(stamp_s, calibration, camera=image)

    def _fused(
        self,
        fuse: Callable[..., FusedDetections] | None,
        row: int,
        points: Detections | None,
        image: DetectedImage | None,
    ) -> FusedDetections:
        """Return the targets of one frame; without a fusion those of the camera."""
        boxes = None if image is None else image.detections
        if points is not None and self._problem(row, of_lidar=True):
            points = None
        if points is None and boxes is None:
            return FusedDetections.of(Detections.empty(self.stamps_s[row]), None)
        if fuse is None:
            return FusedDetections.of(None, boxes)
        assert self.cameras is not None
        assert self.images is not None
        size = self.images.size() if image is None else image.size
        if size is None:
            return FusedDetections.of(points, None)
        camera = self.cameras.of(self.names[row])
        projection = camera.projection_of(self.ego_from_lidar, *size)
        return fuse(points, boxes, projection)

    def _frame(
        self, row: int, detections: FusedDetections, image: DetectedImage | None = None
    ) -> DetectedFrame:
        """Return a frame with what else is written of it."""
        name, lidar_from_ego = self.names[row], self.ego_from_lidar.inverse()
        at_lidar = Pose.from_parts(np.eye(3), -self.ego_from_lidar.translation)
        camera = LabelCamera(CAMERA_FROM_EGO @ at_lidar)
        if self.cameras is not None:
            known = self.cameras.of(name)
            size = None if image is None else image.size
            if size is None and self.image_rows[row] != ALONE and self.images is not None:
                size = self.images.size(self.image_rows[row])
            camera = LabelCamera(known.camera_from_lidar @ lidar_from_ego, known.projection, size)
        return DetectedFrame(name, self.stamps_s[row], detections, camera, self._problem(row))

    def _problem(self, row: int, *, of_lidar: bool = False) -> str:
        """Return what of a frame could not be read; of_lidar: of its scan alone."""
        errors: list[FormatError | None] = []
        if self.scans is not None:
            errors.append(self.scans.losses.scans.get(self.scans.files[row]))
        if self.images is not None and self.image_rows[row] != ALONE and not of_lidar:
            errors.append(self.images.losses.get(self.images.files[self.image_rows[row]]))
        return "; ".join(str(error) for error in errors if error is not None)


def _answered_scan(
    answered: Sequence[Detections], stamps_s: Sequence[float], answer: Any, call_input: object
) -> tuple[int, Detections]:
    """Return the scan that an answer is for, and its detections.

    answered: the answers to all scans so far; one that has detections is not answered again.
    stamps_s: of all scans.
    """
    detections = check_detections(answer, stamps_s=stamps_s[: len(answered)])
    if detections.frame != "ego":
        raise AnswerError(f"detections in frame '{detections.frame}'; possible here: ego")
    rows = range(len(answered) - 1, -1, -1)
    row = next(k for k in rows if same_stamp(detections.stamp_s, stamps_s[k]))
    if len(answered[row]):
        raise AnswerError(f"two answers to the frame at {stamps_s[row]:.6g} s")
    return row, detections


class RecordingOptions(NamedTuple):
    """What a user says of a recording.

    detector: a spec; empty: scans, images and calibration decide. images: folder of the images, if
        elsewhere. calibration: see `KittiCameras`.
    height_m: of the LiDAR above the ground; None: it is estimated from the scans.
    turn: (3, 3), brings the LiDAR's axes to x ahead, y left, z up; None: they are so.
    poses: file with poses of the LiDAR. rate_hz, columns, topics: see `ScanFolder.find`.
    """

    detector: str = ""
    images: Path | None = None
    calibration: Path | None = None
    height_m: float | None = None
    turn: np.ndarray | None = None
    poses: Path | None = None
    rate_hz: float | None = None
    columns: Sequence[str] = ()
    topics: Sequence[str] = ()


def detection_job(folder: Path, options: RecordingOptions) -> DetectionJob:
    """Return what is to be detected in a folder, and by what.

    An option of the user that would change nothing is refused.
    """
    files = scan_files(folder)
    bag = None if files else open_bag(folder)
    has_scans = bool(files) or (bag is not None and bool(bag.topics(CLOUDS)))
    images = _images(folder, options, bag, has_scans=has_scans)
    named = options.detector
    detectors = DetectorSet.of(named, of_images=not has_scans) if named else None
    if images is not None and (not has_scans or (detectors and detectors.lidar is None)):
        return _image_job(detectors or DetectorSet.of(IMAGE_DETECTOR), folder, images, options)
    if detectors is not None and detectors.lidar is None:
        raise FormatError(f"{folder}: {named} needs images, and there are none")
    scans = find_scans(
        folder, rate_hz=options.rate_hz, columns=options.columns, topics=options.topics, bag=bag
    )
    if twins := shared_name(scans.files, scans.names):
        raise FormatError(f"{folder}: {twins}: results are files of these names")
    cameras, notes = _cameras(options.calibration, scans.names, folder, scans.place)
    pairs = ImagePairs([ALONE] * len(scans), "no images")
    if images is not None:
        pairs = paired_images(scans, images)
        notes += [pairs.note] if pairs.note else []
    problem = pairs.problem or ("" if cameras else NO_CALIBRATION)
    if options.images is not None and problem:
        raise FormatError(f"{options.images}: the images cannot be used: {problem}")
    if detectors is None:
        detectors = DetectorSet.of(SCAN_DETECTOR if problem else BOTH_DETECTORS)
        notes += [f"the images are not used: {problem}"] if images is not None and problem else []
    elif detectors.camera is not None and problem:
        raise FormatError(f"{folder}: {named} needs scans, images and a calibration: {problem}")
    if detectors.camera is not None:
        alone = pairs.rows.count(ALONE)
        only = f"{alone} of {len(scans)} scans have no image: the LiDAR is used alone there"
        notes += [only] if alone else []
    if images is not None and not problem:
        notes += _doubts_of_size(cameras, scans.names[0], images)
    poses, motion = _poses(scans, detectors, options.poses)
    ego_from_lidar, height = _mounting(scans, options)
    return DetectionJob(
        detectors,
        scans.names,
        scans.stamps_s,
        scans,
        images,
        pairs.rows,
        cameras,
        ego_from_lidar,
        poses,
        (*scans.notes, *notes, height, *motion),
    )


def _images(
    folder: Path, options: RecordingOptions, bag: Bag | None, *, has_scans: bool
) -> ImageFolder | None:
    """Return the images of a recording; None if there are scans alone."""
    if options.images is not None and not has_scans:
        raise FormatError(f"{folder}: it has no scans: name the folder of the images in its place")
    place = options.images or folder
    images = (
        ImageFolder.find(place)
        if options.images
        else ImageFolder.find(folder, options.topics, bag=bag)
    )
    if images is None and (options.images or (not has_scans and folder.is_dir())):
        scans_too = "" if options.images else f"scans {', '.join(READERS)} or "
        raise FormatError(
            f"{place}: expected {scans_too}images {', '.join(IMAGE_ENDINGS)}, got "
            f"{names_in(place)}{hint_below(place)}"
        )
    if images is not None and images.ordered is not None:
        refuse_copies(images.ordered.files)
    return images


def _poses(
    scans: ScanFolder, detectors: DetectorSet, path: Path | None
) -> tuple[Sequence[np.ndarray | None], list[str]]:
    """Return the poses of the scans, and what is assumed without them."""
    lidar = detectors.lidar
    assert lidar is not None
    uses_motion = (
        not lidar.ours or lidar.target == DETECTOR.registry.resolve(MOVING_DETECTOR).target
    )
    if path is None:
        return (), ["no --poses: the LiDAR is taken to stand still"] if uses_motion else []
    if not uses_motion:
        raise FormatError(f"{path}: {lidar} has no use for poses; {MOVING_DETECTOR} has")
    return TruePoses.read(path, scans.stamps_s).poses, []


def _mounting(scans: ScanFolder, options: RecordingOptions) -> tuple[Pose, str]:
    """Return `ego_from_lidar`, the ego on the ground below the LiDAR, and how high that is."""
    height_m, source = options.height_m, "as named"
    turn = np.eye(3) if options.turn is None else options.turn
    if height_m is None:
        height_m = height_above_ground(scans, turn)
        source = "by the ground in the scans"
    if height_m is None:
        raise FormatError(NO_GROUND)
    pose = Pose.from_parts(turn, np.array([0.0, 0.0, height_m]))
    return pose, f"the LiDAR is {height_m:.2f} m above the ground, {source}"


def _image_job(
    detectors: DetectorSet, folder: Path, images: ImageFolder, options: RecordingOptions
) -> DetectionJob:
    """Return what is to be detected in images alone."""
    if detectors.camera is None or detectors.lidar is not None:
        raise FormatError(f"{images.files[0]}: there are images and no scans")
    of_scans = {
        "--height": options.height_m is not None,
        "--lidar-mounting": options.turn is not None,
        "--poses": options.poses is not None,
        "--layout": bool(options.columns),
        "--topic": bool(options.topics) and images.ordered is not None,
    }
    if any(of_scans.values()):
        names = ", ".join(name for name, is_given in of_scans.items() if is_given)
        raise FormatError(f"without effect on images alone, which {detectors.camera} gets: {names}")
    if images.size() is None:
        read_image(images.files[0])  # It says what is wrong with it.
    if twins := shared_name(images.files, images.names):
        raise FormatError(f"{images.place}: {twins}: results are files of these names")
    places = filter(None, (folder, images.place))
    cameras, notes = _cameras(options.calibration, images.names, *places)
    notes += _doubts_of_size(cameras, images.names[0], images)
    stamps = _image_stamps(folder, images, rate_of(options.rate_hz))
    check_rate(options.rate_hz, measured=stamps.measured)
    assumed = (*(images.ordered.notes if images.ordered else ()), *stamps.notes)
    texts = (note.replace("scans are", "images are") for note in assumed)
    return DetectionJob(
        detectors,
        images.names,
        stamps.stamps_s,
        None,
        images,
        range(len(images)),
        cameras,
        Pose.identity(),
        notes=(*(text.replace("of scans", "of images") for text in texts), *notes),
    )


def _image_stamps(folder: Path, images: ImageFolder, rate_hz: float) -> Stamps:
    """Return the stamps of images: their own, or else those of scans of the same names."""
    stamps, files = images.stamps(rate_hz), scan_files(folder)
    if stamps.measured or not files:
        return stamps
    scans = in_order(files, ENDINGS)
    of_scans = stamps_of_files(scans, rate_hz)[0]
    names = (without_ending(path.name, ENDINGS) for path in scans.files)
    by_name = dict(zip(names, of_scans.stamps_s, strict=True))
    if not of_scans.measured or not by_name.keys() >= set(images.names):
        return stamps
    note = "the stamps of images are those of the scans of the same name"
    return Stamps(tuple(by_name[name] for name in images.names), (note,), measured=True)


def _cameras(
    named: Path | None, names: Sequence[str], *places: Path
) -> tuple[KittiCameras | None, list[str]]:
    """Return the calibration, and why one that was found is not used; a named one has to be.

    names: of the scans or images, each of which may have a calibration of its own.
    places: where it is looked for.
    """
    calibrations = (KittiCameras.find(place) for place in places)
    cameras = KittiCameras(named) if named else next(filter(None, calibrations), None)
    if cameras is None:
        return None, []
    try:
        for name in names:
            cameras.of(name)
    except FormatError as error:
        if named is not None:
            raise
        return None, [f"a calibration is not used: {error}"]
    return cameras, [] if named else [f"the calibration is that of {cameras.path}"]


def _doubts_of_size(cameras: KittiCameras | None, name: str, images: ImageFolder) -> list[str]:
    """Return in a sentence that a calibration seems to be of images of another size.

    KITTI's files do not say of which size the images are.
    """
    size = None if cameras is None else images.size()
    if cameras is None or size is None:
        return []
    matrix = cameras.of(name).projection
    centre_px = matrix[0, 2] / matrix[2, 2]
    if CENTRAL[0] < centre_px / size.width < CENTRAL[1]:
        return []
    return [
        f"the principal point of {cameras.path} is {centre_px:.0f} px from the left, the images "
        f"are {size.width} px wide: is the calibration of images of another size?"
    ]


def shared_name(files: Sequence[Source], names: Sequence[str]) -> str:
    """Return which two files have one name but for the ending; empty if there are none."""
    files_by_name: dict[str, Source] = {}
    for file, name in zip(files, names, strict=True):
        other = files_by_name.setdefault(name, file)
        if other is not file:
            return f"{other.name} and {file.name} have one name but for the ending"
    return ""


class ImagePairs(NamedTuple):
    """Which image belongs to each scan.

    rows: the number of the image of each scan, `ALONE` where there is none.
    problem: why no scan has an image; empty if one has. note: what was assumed.
    """

    rows: Sequence[int]
    problem: str = ""
    note: str = ""


def paired_images(scans: ScanFolder, images: ImageFolder) -> ImagePairs:
    """Return which image belongs to each scan.

    That of the same name; if there are none, or their stamps contradict that, the nearest in time.
    """
    if twins := shared_name(images.files, images.names):
        return ImagePairs([ALONE] * len(scans), twins)
    numbers = {name: row for row, name in enumerate(images.names)}
    rows = np.array([numbers.get(name, ALONE) for name in scans.names])
    paired = rows != ALONE
    named = scans.bag is None and images.ordered is not None and bool(paired.any())
    try:
        stamps = images.stamps(1.0)
    except FormatError as error:
        if not named:
            raise
        return ImagePairs(rows.tolist(), note=f"the stamps of images are not used: {error}")
    if not (scans.measured and stamps.measured):
        problem = "no image has the name of a scan, and nothing says when they were taken"
        return ImagePairs(rows.tolist(), "" if named else problem)
    scans_s, images_s = np.array(scans.stamps_s), np.array(stamps.stamps_s)
    apart_s = np.abs(scans_s[paired] - images_s[rows[paired]]).max(initial=0.0)
    if named and apart_s <= LIMIT_S:
        return ImagePairs(rows.tolist())
    same_names = f"of the same name they are up to {apart_s:.3g} s apart"
    note = f"images belong to scans by their stamps: {same_names}" if named else ""
    try:
        return ImagePairs(nearest_images(scans_s, images_s).tolist(), note=note)
    except ClocksApartError as error:
        return ImagePairs(rows.tolist(), str(error))
