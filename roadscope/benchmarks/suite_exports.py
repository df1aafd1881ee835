"""Writes a suite's sensor data, calibration and truth as files in KITTI's layout."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from importlib import resources
from pathlib import Path

import msgspec
import numpy as np

from roadscope import __version__
from roadscope.benchmarks.boards.board import episodes as episodes_of
from roadscope.benchmarks.boards.camera import CameraBoard, CameraSettings
from roadscope.benchmarks.boards.odometry import OdometryBoard, OdometrySettings
from roadscope.benchmarks.boards.tracking import TrackingBoard, TrackingSettings
from roadscope.benchmarks.cache import FolderError, usable_folder, write_atomically, write_text
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensed, sensing_of, timeline_of
from roadscope.benchmarks.formats.kitti_calibration import calibration_text
from roadscope.benchmarks.formats.kitti_frames import (
    CAMERA_FROM_EGO,
    EGO_FROM_CAMERA,
    kitti_objects,
)
from roadscope.benchmarks.formats.kitti_labels import (
    TYPE_NAMES,
    KittiObjects,
    KittiType,
    write_kitti_detections,
    write_kitti_labels,
)
from roadscope.benchmarks.formats.tracking_rows import ImageSize
from roadscope.benchmarks.formats.trajectories import trajectory_text
from roadscope.benchmarks.images import image_rows, pictures
from roadscope.benchmarks.nodes.detections import DetectionNode, true_boxes
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.references import detection_source, made_from_truth
from roadscope.benchmarks.report.export import markdown_text
from roadscope.benchmarks.suite import SPLITS, Suite, check_names
from roadscope.benchmarks.suite_files import load_suite
from roadscope.core import (
    Calibration,
    CameraImage,
    Category,
    Detections,
    Family,
    Frame,
    LidarScan,
    Pose,
    Tracks,
    Truth,
)
from roadscope.core.names import unknown
from roadscope.core.spec import FUSED
from roadscope.envs.sensors.rig import Rig

MANIFEST = "manifest.json"
RIG_FILE = "rig.toml"
CAMERA_IMAGES = "camera_images"
"""The folder with the images of the camera board, which are not taken at the stamps of scans."""
FORMAT = 1
TRUTH_COLUMNS = (
    "frame, stamp_s, id, category, x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, vx_m_s, "
    "vy_m_s, lidar_returns, occluded_fraction"
)
VIEW_PX = ImageSize(1242, 375)
"""Size of the image that is assumed for a rig without a camera: KITTI's."""
FOCAL_PX = 358.5
"""Its focal length, for a horizontal field of view of 120 degrees; the LUX has 110. Chosen by
hand."""
OCCLUDED = (0.25, 0.5)
"""Hidden shares from which on an object is partly, and largely occluded. Chosen by hand."""
POINT_BYTES = 20
"""Four numbers in `velodyne` and one in `velodyne_times`, of four bytes each."""
PNG_SHARE = 0.7
"""Size of an image with noise as PNG, as a share of its pixels' size: measured on rig `wide`."""
FILE_OF = {
    Family.VEHICLE: KittiType.CAR,
    Family.PEDESTRIAN: KittiType.PEDESTRIAN,
    Family.CYCLIST: KittiType.CYCLIST,
}
"""Detection files have three classes: all vehicles are written as cars."""


class ExportError(ValueError):
    """A suite cannot be exported as asked, or a folder is no exported suite."""


class ExportedSequence(msgspec.Struct, frozen=True, kw_only=True):
    """One episode and the name of its files.

    frames: number of scans. lost: numbers of the scans that are lost by a fault.
    truth: whether truth is written. digest: of the truth, which shows whether the traffic has
        changed; empty until all files are written.
    """

    name: str
    scenario: str
    seed: int
    weather: str
    light: str
    faults: tuple[str, ...]
    truth: bool
    frames: int = 0
    lost: tuple[int, ...] = ()
    digest: str = ""


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """The settings of an exported folder, from which its truth can be made again.

    rig: a name, or the file `rig.toml` in the folder.
    camera_every_s: seconds from one image of the camera board to the next; 0: none are written.
    detections: the detectors whose boxes are written, each in a folder `det_NAME`.
    """

    format: int
    roadscope: str
    suite: str
    suite_version: int
    rig: str
    duration_s: float | None
    range_m: tuple[float, float]
    min_returns: int
    families: tuple[str, ...]
    odometry_lengths_m: tuple[float, ...]
    detections: tuple[str, ...]
    sequences: tuple[ExportedSequence, ...]
    camera_every_s: float = 0.0

    @property
    def eligibility(self) -> Eligibility:
        """The rule for which objects are eligible."""
        return Eligibility(self.range_m, self.min_returns, self.families)

    def episode(self, sequence: ExportedSequence, folder: Path) -> Episode:
        """Return the episode of a sequence. folder: that holds the manifest."""
        rig = str(folder / RIG_FILE) if self.rig == RIG_FILE else self.rig
        return Episode(
            sequence.scenario,
            sequence.seed,
            rig,
            self.duration_s,
            sequence.weather,
            sequence.light,
            sequence.faults,
        )


@dataclass(frozen=True, slots=True)
class ExportPlan:
    """What an export will write.

    scans: number of scans at most: with an IMU the last ones are not complete.
    bytes_at_most: size of scans and images if every ray had a return.
    done: number of sequences that an earlier run has written.
    """

    folder: Path
    suite: Suite
    manifest: Manifest
    scans: int
    bytes_at_most: int
    done: int


@dataclass(frozen=True, slots=True)
class SequenceView:
    """The camera of a sequence: the rig's, or an assumed one at the LiDAR that takes no images.

    Mounting poses are those that the user believes. The ego frame of KITTI's files is that of the
    camera, with its axes turned to ISO 8855.
    """

    projection: np.ndarray
    size: ImageSize
    ego_from_camera: Pose
    ego_from_lidar: Pose

    @staticmethod
    def of(rig: Rig, believed: Calibration) -> SequenceView:
        """Return the view of a rig. believed: its calibration, as the user believes it."""
        ego_from_lidar = believed.pose(rig.lidar.name)
        width, height = VIEW_PX
        intrinsics = np.array([[FOCAL_PX, 0, width / 2], [0, FOCAL_PX, height / 2], [0, 0, 1]])
        mounted = ego_from_lidar @ EGO_FROM_CAMERA
        if rig.camera is not None:
            pinhole = rig.camera.spec.pinhole
            intrinsics, width, height = pinhole.intrinsics, pinhole.width, pinhole.height
            mounted = believed.pose(rig.camera.name)
        projection = np.column_stack([intrinsics, np.zeros(3)])
        return SequenceView(projection, ImageSize(width, height), mounted, ego_from_lidar)

    def turned(self, world_from_ego: Pose) -> Pose:
        """Return the pose of the camera, turned to ISO 8855, in the world."""
        return world_from_ego @ self.ego_from_camera @ CAMERA_FROM_EGO

    def rows(
        self, tracks: Tracks, frame: int, world_from_ego: Pose, **options: bool
    ) -> KittiObjects:
        """Return tracks, world frame, as rows of a frame. options: of `kitti_objects`."""
        pose = self.turned(world_from_ego)
        return kitti_objects(tracks, frame, pose, self.projection, self.size, **options)


def plan_export(
    suite: Suite | str | Path,
    folder: Path | str,
    *,
    seeds: int | None = None,
    scenarios: Sequence[str] | None = None,
    with_truth: bool = False,
    detections: Sequence[str] | None = None,
) -> ExportPlan:
    """Return what an export will write; `FolderError` if the folder holds anything else.

    suite: a suite, its name, or a `.toml` file.
    seeds: write only this many of its seeds, the first ones; all if left out.
    scenarios: names of some of its scenarios; all if left out.
    with_truth: whether truth of test seeds is written too.
    detections: detectors whose boxes are written; if left out, those of the suite's trackers.
    """
    chosen = _narrowed(
        load_suite(suite) if isinstance(suite, str | Path) else suite, seeds, scenarios
    )
    check_names(chosen)
    place, manifest = Path(folder), _manifest(chosen, with_truth, detections)
    scans, size = _amount(chosen, manifest)
    written = _earlier_export(place, manifest)
    done = sum(bool(sequence.digest) for sequence in written.sequences) if written else 0
    return ExportPlan(place, chosen, written or manifest, scans, size, done)


def export_suite(plan: ExportPlan, *, progress: Progress | None = None) -> Path:
    """Write what is planned, sequence by sequence, and return the folder.

    Sequences that an earlier run has written stay as they are: a stopped run continues.

    plan: of `plan_export`. progress: called with the stage, sequences done and sequences in all.
    """
    folder, manifest, report = usable_folder(plan.folder), plan.manifest, progress or silent
    if manifest.rig == RIG_FILE:
        write_text(folder / RIG_FILE, Path(plan.suite.rig).read_text(encoding="utf-8"))
    write_text(folder / "README.md", _readme(manifest))
    _save_manifest(folder, manifest)
    sequences = list(manifest.sequences)
    for number, sequence in enumerate(sequences):
        report("sequences", number, len(sequences))
        if not sequence.digest:
            sequences[number] = _write_sequence(folder, manifest, sequence)
            manifest = msgspec.structs.replace(manifest, sequences=tuple(sequences))
            _save_manifest(folder, manifest)
    report("sequences", len(sequences), len(sequences))
    return folder


def read_manifest(folder: Path | str) -> Manifest:
    """Read the manifest of an exported folder; `ExportError` if it is none."""
    path = Path(folder) / MANIFEST
    if not path.is_file():
        raise ExportError(f"{folder} is no exported suite: it has no {MANIFEST}")
    try:
        manifest = msgspec.json.decode(path.read_bytes(), type=Manifest)
    except msgspec.DecodeError as error:
        raise ExportError(f"{path}: {error}") from error
    if manifest.format != FORMAT:
        raise ExportError(f"{path} has format {manifest.format}, this version reads {FORMAT}")
    return manifest


def truth_digest(truths: Sequence[Truth]) -> str:
    """Return a digest of the truth of a sequence, positions rounded to a millimetre."""
    digest = sha256()
    for truth in truths:
        places = np.rint(1000 * truth.centres).astype(np.int64)
        own = np.rint(1000 * truth.world_from_ego.translation).astype(np.int64)
        for array in (truth.ids, truth.lidar_returns, places, own):
            digest.update(np.ascontiguousarray(array, "<i8").tobytes())
    return digest.hexdigest()[:16]


def _narrowed(suite: Suite, seeds: int | None, scenarios: Sequence[str] | None) -> Suite:
    if seeds is not None and not 1 <= seeds <= len(suite.seeds):
        raise ExportError(f"suite {suite.title} has {len(suite.seeds)} seeds, not {seeds}")
    for name in scenarios or ():
        if name not in suite.scenarios:
            raise ExportError(unknown(f"scenario of {suite.title}", name, suite.scenarios))
    chosen = tuple(name for name in suite.scenarios if not scenarios or name in scenarios)
    return replace(suite, seeds=suite.seeds[:seeds], scenarios=chosen)


def _manifest(suite: Suite, with_truth: bool, detections: Sequence[str] | None) -> Manifest:
    from roadscope.envs.sensors.rigs import rig as rig_of

    hidden_seeds = () if with_truth else SPLITS["test"]
    sequences = tuple(
        ExportedSequence(
            name=f"{number:04d}",
            scenario=episode.scenario,
            seed=episode.seed,
            weather=episode.weather,
            light=episode.light,
            faults=episode.faults,
            truth=episode.seed not in hidden_seeds,
        )
        for number, episode in enumerate(episodes_of(suite))
    )
    some_hidden = not all(sequence.truth for sequence in sequences)
    every_s = suite.settings(CameraBoard.name, CameraSettings).every_s
    of_suite = suite.settings(TrackingBoard.name, TrackingSettings).detectors
    sources = {name: detection_source(name) for name in detections or of_suite}
    secret = [n for n, source in sources.items() if some_hidden and made_from_truth(source)]
    if detections is None:
        detections = [n for n, s in sources.items() if s.kind != FUSED and n not in secret]
    elif detections and secret:
        raise ExportError(
            f"detections of {secret[0]} are truth: for test seeds they need --with-truth"
        )
    return Manifest(
        format=FORMAT,
        roadscope=__version__,
        suite=suite.name,
        suite_version=suite.version,
        rig=RIG_FILE if suite.rig.endswith(".toml") else suite.rig,
        duration_s=suite.duration_s,
        range_m=suite.eligibility.range_m,
        min_returns=suite.eligibility.min_returns,
        families=suite.eligibility.families,
        odometry_lengths_m=suite.settings(OdometryBoard.name, OdometrySettings).lengths_m,
        detections=tuple(dict.fromkeys(detections)),
        sequences=sequences,
        camera_every_s=every_s if rig_of(suite.rig).camera else 0.0,
    )


def _earlier_export(folder: Path, planned: Manifest) -> Manifest | None:
    """Return the manifest of an earlier run of the same export; refuse any other folder."""
    if folder.exists() and not folder.is_dir():
        raise FolderError(f"cannot write to folder {folder}: a file is in the way")
    if not folder.is_dir() or not any(folder.iterdir()):
        return None
    try:
        earlier = read_manifest(folder)
    except ExportError as error:
        raise FolderError(f"{folder} holds other files; nothing was written ({error})") from None
    if _unwritten(earlier) != _unwritten(planned):
        raise FolderError(
            f"{folder} holds another export, of {earlier.suite} v{earlier.suite_version} with "
            f"{len(earlier.sequences)} sequences, or with other options; name another folder"
        )
    return earlier


def _unwritten(manifest: Manifest) -> Manifest:
    """Return a manifest as it was before any sequence was written."""
    bare = (msgspec.structs.replace(s, frames=0, lost=(), digest="") for s in manifest.sequences)
    return msgspec.structs.replace(manifest, sequences=tuple(bare))


def _amount(suite: Suite, manifest: Manifest) -> tuple[int, int]:
    """Return the number of scans, and the bytes of scans and images at most."""
    from roadscope.envs.sensors.rigs import rig as rig_of
    from roadscope.envs.traffic.scenarios import find

    rig = rig_of(suite.rig)
    spec, scans, images = rig.lidar.spec, 0, 0
    for sequence in manifest.sequences:
        length_s = suite.duration_s or find(sequence.scenario).duration_s
        scans += max(int((length_s - rig.lidar.stamp_s(0)) / spec.period_s) + 1, 0)
        if manifest.camera_every_s:
            images += int(length_s / manifest.camera_every_s) + 1
    size = scans * len(spec.elevations) * spec.columns * POINT_BYTES
    if rig.camera is not None:
        pinhole = rig.camera.spec.pinhole
        size += int((scans + images) * pinhole.width * pinhole.height * 3 * PNG_SHARE)
    return scans, size


def _write_sequence(
    folder: Path, manifest: Manifest, sequence: ExportedSequence
) -> ExportedSequence:
    """Write all files of a sequence and return its entry in the manifest."""
    from roadscope.envs.sensors.rigs import rig as rig_of

    episode = manifest.episode(sequence, folder)
    frames: list[Frame] = []
    truths: list[Truth] = []
    lost: list[int] = []
    for number, (frame, truth) in enumerate(sensed(episode)):
        _write_scan(folder, f"{sequence.name}/{number:06d}.bin", frame.lidar)
        if frame.lidar is None:
            lost.append(number)
        # Scans are large, and are already written.
        frames.append(replace(frame, lidar=None))
        truths.append(truth)
    if not frames:
        raise ExportError(f"{sequence.scenario}, seed {sequence.seed}: shorter than one sweep")
    rig, believed = rig_of(episode.rig), sensing_of(episode).calibration
    files = _SequenceFiles(folder, sequence.name, SequenceView.of(rig, believed), truths)
    files.write_calibration(believed.pose(rig.imu.name) if rig.imu else Pose.identity())
    files.write_inertial(frames)
    files.write_stamps_and_poses()
    pixels = files.write_images(episode) if rig.camera else None
    if manifest.camera_every_s:
        files.write_camera_images(episode, manifest.camera_every_s)
    if sequence.truth:
        files.write_truth(pixels, rig.lidar.ego_from_lidar)
    for detector in manifest.detections:
        node = DetectionNode(detection_source(detector), episode, manifest.eligibility)
        files.write_detections(detector, node.read().detections)
    return msgspec.structs.replace(
        sequence, frames=len(frames), lost=tuple(lost), digest=truth_digest(truths)
    )


def _write_scan(folder: Path, name: str, scan: LidarScan | None) -> None:
    """Write the points of a scan and their times; empty files for a lost scan."""
    points, times = np.empty(0, "<f4"), np.empty(0, "<f4")
    if scan is not None:
        points = np.column_stack([scan.points, scan.intensity]).astype("<f4")
        times = scan.time_offset_s.astype("<f4")
    write_atomically(folder / "velodyne" / name, points.tofile)
    write_atomically(folder / "velodyne_times" / name, times.tofile)


@dataclass(frozen=True, slots=True)
class _SequenceFiles:
    """The files of one sequence that are written once all of it was sensed."""

    folder: Path
    name: str
    view: SequenceView
    truths: Sequence[Truth]

    def write_calibration(self, ego_from_imu: Pose) -> None:
        """Write the mounting poses; without an IMU, that of the ego frame stands in its place."""
        camera_from_lidar = self.view.ego_from_camera.inverse() @ self.view.ego_from_lidar
        lidar_from_imu = self.view.ego_from_lidar.inverse() @ ego_from_imu
        text = calibration_text(self.view.projection, camera_from_lidar, lidar_from_imu)
        write_text(self._path("calib"), text)

    def write_inertial(self, frames: Sequence[Frame]) -> None:
        """Write the samples of IMU and wheels, if there are any."""
        imu = [
            np.column_stack([i.stamps_s, i.angular_velocity, i.specific_force])
            for i in (frame.imu for frame in frames)
            if i is not None
        ]
        wheels = [
            np.column_stack([w.stamps_s, w.speeds])
            for w in (frame.wheels for frame in frames)
            if w is not None
        ]
        if imu:
            self._write_numbers("imu", np.concatenate(imu), "stamp,wx,wy,wz,ax,ay,az")
        if wheels:
            self._write_numbers("wheels", np.concatenate(wheels), "stamp,speed")

    def write_stamps_and_poses(self) -> None:
        """Write the stamps of scans and the camera's poses in the world turned to its axes."""
        stamps_s = [truth.stamp_s for truth in self.truths]
        for path in (self._path("times"), self.folder / "velodyne" / self.name / "times.txt"):
            write_text(path, "".join(f"{stamp_s:.9f}\n" for stamp_s in stamps_s))
        poses = [
            CAMERA_FROM_EGO @ t.world_from_ego @ self.view.ego_from_camera for t in self.truths
        ]
        write_text(self._path("ego_pose"), trajectory_text("kitti", poses, stamps_s))

    def write_images(self, episode: Episode) -> list[np.ndarray]:
        """Write an image at the stamp of each scan; return the pixels of each object in each."""
        sensing, timeline, pixels = sensing_of(episode), timeline_of(episode), []
        for number, truth in enumerate(self.truths):
            frame, image_truth = sensing.sense_image_at(timeline, truth.stamp_s)
            pixels.append(image_truth.visible_pixels)
            self._write_image("image_02", number, frame.camera)
        return pixels

    def write_camera_images(self, episode: Episode, every_s: float) -> None:
        """Write the images of the camera board, by their numbers. every_s: as of the board."""
        for picture in pictures(episode, tuple(image_rows(episode, every_s))):
            self._write_image(CAMERA_IMAGES, picture.index, picture.frame.camera)

    def write_truth(self, pixels: Sequence[np.ndarray] | None, ego_from_lidar: Pose) -> None:
        """Write labels of what is visible in image or scan, all truth, and the LiDAR's true poses.

        pixels: of each object in each image; None without images.
        """
        labels = []
        for number, truth in enumerate(self.truths):
            visible = truth.lidar_returns > 0
            if pixels is not None:
                visible |= pixels[number] > 0
            labels.append(self._label_rows(number, truth, visible))
        write_atomically(self._path("label_02"), lambda path: write_kitti_labels(path, labels))
        write_text(self._path("truth", "csv"), _truth_text(self.truths))
        poses = [truth.world_from_ego @ ego_from_lidar for truth in self.truths]
        text = trajectory_text("tum", poses, [truth.stamp_s for truth in self.truths])
        write_text(self._path("lidar_pose"), text)

    def write_detections(self, detector: str, detections: Sequence[Detections]) -> None:
        """Write a detector's boxes, each class in a file of its own."""
        for family, kind in FILE_OF.items():
            frames = []
            for number, (boxes, truth) in enumerate(zip(detections, self.truths, strict=True)):
                own = boxes.select(
                    np.array([Category(c).family is family for c in boxes.categories], bool)
                )
                tracks = Tracks.of(own, np.arange(len(own)))
                rows = self.view.rows(tracks, number, truth.world_from_ego, all_around=True)
                frames.append(replace(rows, types=np.full(len(rows), kind, np.int8)))
            path = self._path(f"{detections_folder(detector)}/{TYPE_NAMES[kind]}")
            write_atomically(path, partial(write_kitti_detections, frames=frames))

    def _path(self, kind: str, ending: str = "txt") -> Path:
        return self.folder / kind / f"{self.name}.{ending}"

    def _write_image(self, kind: str, number: int, image: CameraImage | None) -> None:
        """Write an image, if it is not lost."""
        from matplotlib.image import imsave

        if image is not None:
            path = self.folder / kind / self.name / f"{number:06d}.png"
            write_atomically(path, partial(imsave, arr=image.pixels, format="png"))

    def _write_numbers(self, kind: str, rows: np.ndarray, header: str) -> None:
        save = partial(np.savetxt, X=rows, fmt="%.9f", delimiter=",", header=header, comments="")
        write_atomically(self._path(kind, "csv"), save)

    def _label_rows(self, number: int, truth: Truth, visible: np.ndarray) -> KittiObjects:
        tracks = Tracks.of(true_boxes(truth, visible), truth.ids[visible])
        rows = self.view.rows(tracks, number, truth.world_from_ego)
        shares = dict(zip(truth.ids.tolist(), truth.occluded_fraction.tolist(), strict=True))
        hidden = np.array([shares[i] for i in rows.ids.tolist()])
        last = np.array(self.view.size) - 1
        cut = np.any(rows.boxes[:, :2] <= 0, axis=1) | np.any(rows.boxes[:, 2:] >= last, axis=1)
        return replace(
            rows, occluded=np.digitize(hidden, OCCLUDED), truncated=np.asarray(cut, np.int64)
        )


def _truth_text(truths: Sequence[Truth]) -> str:
    lines = [TRUTH_COLUMNS.replace(" ", "")]
    for number, truth in enumerate(truths):
        places = np.column_stack([truth.centres, truth.sizes, truth.yaws, truth.velocities])
        for k, values in enumerate(places.tolist()):
            category = Category(truth.categories[k]).name.lower()
            numbers = ",".join(f"{value:.6f}" for value in values)
            lines.append(
                f"{number},{truth.stamp_s:.9f},{truth.ids[k]},{category},{numbers},"
                f"{truth.lidar_returns[k]},{truth.occluded_fraction[k]:.6f}"
            )
    return "\n".join(lines) + "\n"


def detections_folder(detector: str) -> str:
    """Return the name of the folder of a detector's boxes."""
    return f"det_{re.sub(r'[^A-Za-z0-9_.-]+', '-', detector)}"


def _save_manifest(folder: Path, manifest: Manifest) -> None:
    text = msgspec.json.format(msgspec.json.encode(manifest), indent=1).decode()
    write_text(folder / MANIFEST, f"{text}\n")


def _readme(manifest: Manifest) -> str:
    rows, every_s = [], manifest.camera_every_s
    for s in manifest.sequences:
        condition, truth = manifest.episode(s, Path()).condition, "yes" if s.truth else "no"
        rows.append(f"| {s.name} | {s.scenario} | {s.seed} | {condition} | {truth} |")
    text = resources.files("roadscope.benchmarks").joinpath("exported_readme.md")
    return text.read_text(encoding="utf-8").format(
        title=markdown_text(f"{manifest.suite} v{manifest.suite_version}"),
        version=manifest.roadscope,
        rig=markdown_text(manifest.rig),
        images=f"one every {every_s:g} s" if every_s else "none without a camera",
        detections=", ".join(map(detections_folder, manifest.detections)) or "none",
        columns=TRUTH_COLUMNS,
        sequences="\n".join(rows),
    )
