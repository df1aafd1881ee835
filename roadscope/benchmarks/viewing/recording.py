"""Writes an episode as a recording of Rerun (`.rrd`).

Everything is on one timeline, `time`, in seconds since reset. Frames are those of ISO 8855, and
transforms are entities: `world/ego` is `world_from_ego`, and below it each sensor has its
mounting pose. The optical frame of a camera is z ahead, x right, y down.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from roadscope.benchmarks.boards import board_named
from roadscope.benchmarks.cache import usable_file, write_atomically
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.images import camera_of, image_rows, pictures
from roadscope.benchmarks.metrics.trajectory_errors import aligned
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.viewing.program import rerun_module
from roadscope.benchmarks.viewing.view import EpisodeView
from roadscope.core import (
    GROUND,
    WEATHER,
    Category,
    Detections,
    ImageDetections,
    Pose,
    Tracks,
    TrackState,
    Truth,
)
from roadscope.core.palette import (
    ASPHALT_COLOUR,
    DETECTION_COLOURS,
    GROUND_COLOUR,
    MARKING_COLOUR,
    ODOMETRY_COLOUR,
    PAPER_COLOURS,
    RETURN_COLOURS,
    TRUTH_COLOUR,
    track_colour,
)
from roadscope.envs.drawing.birds_eye import COASTING_PX, TRACK_PX
from roadscope.envs.sensors.rigs import rig
from roadscope.envs.traffic.terrain import Terrain
from roadscope.envs.traffic.timeline import Timeline

if TYPE_CHECKING:
    from roadscope.core import LidarScan

ENDING = ".rrd"
TIMELINE = "time"
GROUND_CLASS, SCENERY_CLASS, WEATHER_CLASS = (len(Category) + k for k in range(3))
"""Classes of returns that come from no road user; those of road users are their categories."""
TAIL_S = 3.0
"""Length of the line behind a track."""
JPEG_QUALITY = 90
TRIANGLES = np.array([[0, 1, 2], [2, 1, 3]])
"""Corners of the two triangles between a point of a lane, left and right, and the next."""
BELOW_M = 0.02
"""How far below the ground the asphalt is drawn, so that it hides no line."""
EYE_M, LOOK_AT_M = (-30.0, 0.0, 18.0), (12.0, 0.0, 0.0)
"""Where the eye of the viewer is at first, and what it looks at, ego frame."""
LINE_PX = 1.5
RETURN_PX = 1.2
"""Radii of lines and returns on the screen. They, the length of tails and the quality of images are
chosen by hand."""
COLOUR_NOTE = (
    "White is what is true. Warm colours are detections, cool ones tracks: with their number, an "
    "arrow as long as their motion in one second, and a line where they were in the last "
    f"{TAIL_S:g} s. Pink is the ego where an odometry takes it to be. Point at a box to read its "
    "label."
)


def save_recording(
    view: EpisodeView,
    path: Path | str,
    *,
    returns: Literal["object", "intensity"] = "object",
    progress: Progress | None = None,
) -> Path:
    """Write a view to a file of Rerun and return its path.

    returns: by what returns of a LiDAR are coloured: by the `object` that they truly came from, or
    by `intensity`. `ViewerError` without Rerun, `FolderError` if the file cannot be written.
    """
    rr = rerun_module()
    place = usable_file(path, (ENDING,), "a recording")

    def write(part: Path) -> None:
        with rr.RecordingStream("roadscope") as stream:
            stream.set_log_time_enabled(False)
            stream.set_log_tick_enabled(False)
            stream.save(part, default_blueprint=_layout(view))
            stream.send_recording_name(view.title)
            _ViewLogger(rr, stream, view, returns).write(progress or silent)
            stream.disconnect()

    write_atomically(place, write)
    return place


class _ViewLogger:
    """Logs the parts of a view to a stream of Rerun."""

    def __init__(self, rr: Any, stream: Any, view: EpisodeView, returns: str) -> None:
        self.rr, self.stream, self.view, self.returns = rr, stream, view, returns
        lidar_pose = None if view.episode is None else rig(view.episode.rig).lidar.ego_from_lidar
        self.ego_from_lidar = lidar_pose or Pose.identity()

    def write(self, progress: Progress) -> None:
        view = self.view
        self._write_frames()
        if view.timeline is not None:
            self._write_road(view.timeline)
            centre = [view.timeline.centre_ahead_m[0], 0, view.timeline.sizes[0, 2] / 2]
            box = self.rr.Boxes3D(
                centers=[centre],
                sizes=view.timeline.sizes[:1],
                colors=TRUTH_COLOUR,
                radii=self._px(LINE_PX),
            )
            self.log("world/ego/body", box)
        self._write_paths()
        for truth in view.truths:
            self.at(truth.stamp_s)
            self._write_ego(truth)
            names = _object_names(truth)
            boxes = self._outlines(truth, class_ids=truth.categories, labels=names)
            self.log("world/truth", boxes, static=False)
        for detections in view.detections:
            self.at(detections.stamp_s)
            place = "world" if detections.frame == "world" else "world/ego"
            boxes = self._outlines(detections, **_looks(detections))
            self.log(f"{place}/detections", boxes, static=False)
        self._write_tracks(view.tracks)
        self._write_scores()
        if view.episode is not None:
            self._write_scans(view.episode, progress)
            if rig(view.episode.rig).camera is not None:
                self._write_images(view.episode, progress)

    def log(self, entity: str, content: Any, *, static: bool = True) -> None:
        self.stream.log(entity, content, static=static)

    def at(self, stamp_s: float) -> None:
        """Set the time of what is logged next."""
        self.stream.set_time(TIMELINE, duration=stamp_s)

    def _px(self, radius: float | Sequence[float]) -> Any:
        return self.rr.Radius.ui_points(radius)

    # ----------------------------------------------------------------------------------------------

    def _write_frames(self) -> None:
        rr = self.rr
        infos = [
            rr.AnnotationInfo(each.value, each.name.lower(), TRUTH_COLOUR) for each in Category
        ]
        infos += [
            rr.AnnotationInfo(GROUND_CLASS, "ground", RETURN_COLOURS["ground"]),
            rr.AnnotationInfo(SCENERY_CLASS, "scenery", RETURN_COLOURS["scenery"]),
            rr.AnnotationInfo(WEATHER_CLASS, "rain or fog", RETURN_COLOURS["rain, fog"]),
        ]
        self.log("world", rr.AnnotationContext(infos))
        self.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        self.log("world/ego", rr.ViewCoordinates.FLU)
        episode = self.view.episode
        if episode is None:
            return
        sensors = rig(episode.rig)
        self.log(f"world/ego/{sensors.lidar.name}", self._transform(sensors.lidar.ego_from_lidar))
        if sensors.camera is not None:
            place, pinhole = f"world/ego/{sensors.camera.name}", sensors.camera.spec.pinhole
            self.log(place, self._transform(sensors.camera.ego_from_camera))
            image_from_camera = rr.Pinhole(
                image_from_camera=pinhole.intrinsics,
                resolution=(pinhole.width, pinhole.height),
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=2.0,
            )
            self.log(place, image_from_camera)

    def _transform(self, a_from_b: Pose) -> Any:
        return self.rr.Transform3D(translation=a_from_b.translation, mat3x3=a_from_b.rotation)

    def _write_road(self, timeline: Timeline) -> None:
        """Write asphalt, and the borders of each lane, on the ground."""
        borders, points, triangles, count = [], [], [], 0
        for line, widths in timeline.road.lanes():
            if len(line) < 2:
                continue
            ahead = np.gradient(line, axis=0)
            ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
            aside = np.column_stack([-ahead[:, 1], ahead[:, 0]]) * widths[:, None] / 2
            sides = [_on_ground(line + s * aside, timeline.terrain) for s in (1, -1)]
            borders += sides
            points.append(np.stack(sides, axis=1).reshape(-1, 3))
            first = count + 2 * np.arange(len(line) - 1)[:, None, None]
            triangles.append((first + TRIANGLES).reshape(-1, 3))
            count += 2 * len(line)
        if not borders:
            return
        lines = self.rr.LineStrips3D(borders, colors=MARKING_COLOUR, radii=self._px(LINE_PX / 2))
        self.log("world/road/borders", lines)
        vertices = np.concatenate(points) - [0, 0, BELOW_M]
        asphalt = self.rr.Mesh3D(
            vertex_positions=vertices,
            triangle_indices=np.concatenate(triangles),
            vertex_colors=np.tile(np.array(ASPHALT_COLOUR, np.uint8), (len(vertices), 1)),
        )
        self.log("world/road/asphalt", asphalt)

    def _write_paths(self) -> None:
        """Write the true path of the ego, and beside it that of an odometry with its pose.

        Without an episode the mounting is not known: paths of poses are then those of the LiDAR.
        """
        poses, lidar_from_ego = self.view.poses, self.ego_from_lidar.inverse().matrix
        path = np.array([each.world_from_ego.translation for each in self.view.truths])
        body = "ego" if len(path) or self.view.episode is not None else "lidar"
        if poses is not None:
            estimates = aligned(poses.trajectories, "origin") @ lidar_from_ego
            if not len(path):
                path = (poses.trajectories.truth @ lidar_from_ego)[:, :3, 3]
            self._write_path("world/paths/odometry", estimates[:, :3, 3], ODOMETRY_COLOUR)
            box = self.rr.Boxes3D(half_sizes=[[1.0, 0.5, 0.2]], colors=ODOMETRY_COLOUR)
            for k, (stamp_s, estimate) in enumerate(zip(poses.stamps_s, estimates, strict=True)):
                self.at(stamp_s)
                if k == 0:  # Before its first pose it has no place.
                    self.log("world/odometry", box, static=False)
                pose = self.rr.Transform3D(translation=estimate[:3, 3], mat3x3=estimate[:3, :3])
                self.log("world/odometry", pose, static=False)
        if len(path):
            self._write_path(f"world/paths/{body}", path, TRUTH_COLOUR)

    def _write_path(self, entity: str, points: np.ndarray, colour: Sequence[int]) -> None:
        self.log(entity, self.rr.LineStrips3D([points], colors=colour, radii=self._px(LINE_PX)))

    # ----------------------------------------------------------------------------------------------

    def _write_ego(self, truth: Truth) -> None:
        self.log("world/ego", self._transform(truth.world_from_ego), static=False)

    def _write_tracks(self, tracks: Sequence[Tracks]) -> None:
        """Write the boxes of tracks with their ids, their motion in 1 s, and tails behind them."""
        tails: dict[int, list[tuple[float, np.ndarray]]] = {}
        for each in tracks:
            self.at(each.stamp_s)
            ids = each.ids.tolist()
            colours = np.array([track_colour(number) for number in ids]).reshape(-1, 3)
            widths = np.where(each.states == TrackState.COASTING, COASTING_PX, TRACK_PX).tolist()
            names = [str(number) for number in ids]
            boxes = self._boxes(each, widths, colors=colours, labels=names, show_labels=True)
            self.log("world/tracks", boxes, static=False)
            ahead = np.column_stack([each.velocities, np.zeros(len(each))])
            arrows = self.rr.Arrows3D(
                vectors=ahead, origins=each.centres, colors=colours, radii=self._px(LINE_PX / 2)
            )
            self.log("world/tracks/motion", arrows, static=False)
            tails = {number: tails.get(number, []) for number in ids}
            for number, centre in zip(ids, each.centres, strict=True):
                tail = [*tails[number], (each.stamp_s, centre)]
                tails[number] = [p for p in tail if p[0] >= each.stamp_s - TAIL_S]
            lines = [np.array([centre for _, centre in tails[number]]) for number in ids]
            strips = self.rr.LineStrips3D(lines, colors=colours, radii=self._px(LINE_PX))
            self.log("world/tracks/tails", strips, static=False)

    def _write_scores(self) -> None:
        for curve, colour in zip(self.view.curves, cycle(PAPER_COLOURS)):
            entity = f"scores/{curve.board}/{curve.metric}"
            rgb = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
            name = f"{curve.board}: {curve.metric}"
            self.log(entity, self.rr.SeriesLines(names=name, colors=rgb, widths=2 * LINE_PX))
            self.stream.send_columns(
                entity,
                indexes=[self.rr.TimeColumn(TIMELINE, duration=curve.stamps_s)],
                columns=self.rr.Scalars.columns(scalars=curve.values),
            )
        text = self.rr.TextDocument(_summary(self.view), media_type=self.rr.MediaType.MARKDOWN)
        self.log("summary", text)

    # ----------------------------------------------------------------------------------------------

    def _write_scans(self, episode: Episode, progress: Progress) -> None:
        """Write the returns of each scan where they were at its stamp, as the ego truly moved."""
        truths = self.view.truths
        poses = [each.world_from_ego @ self.ego_from_lidar for each in truths]
        for k, (frame, truth) in enumerate(sensed(episode)):
            progress("scans", k, len(truths))
            self.at(truth.stamp_s)
            name = rig(episode.rig).lidar.name
            entity = f"world/ego/{name}/returns"
            scan = frame.lidar
            if scan is None:
                self.log(entity, self.rr.Points3D(np.empty((0, 3))), static=False)
                continue
            before, after = max(k - 1, 0), min(k + 1, len(truths) - 1)
            passed_s = truths[after].stamp_s - truths[before].stamp_s
            points = _at_stamp(scan, poses[before], poses[k], poses[after], passed_s)
            colours = (
                {"colors": _grey(scan.intensity)}
                if self.returns == "intensity"
                else {"class_ids": _classes(truth)}
            )
            dots = self.rr.Points3D(points, radii=self._px(RETURN_PX), **colours)
            self.log(entity, dots, static=False)
        progress("scans", len(truths), len(truths))

    def _write_images(self, episode: Episode, progress: Progress) -> None:
        """Write images with the boxes of road users and those that were detected."""
        rows = tuple(image_rows(episode, 0.0))
        images = self.view.images
        detected: dict[int, ImageDetections] = {}
        if images is not None:
            detected = dict(zip(images.rows.tolist(), images.filled, strict=True))
        place = f"world/ego/{camera_of(rig(episode.rig)).name}"
        for k, picture in enumerate(pictures(episode, rows)):
            progress("images", k, len(rows))
            truth, image = picture.truth, picture.frame.camera
            self.at(truth.stamp_s)
            self._write_ego(truth)
            if image is None:
                self.log(f"{place}/image", self.rr.Clear(recursive=False), static=False)
            else:
                pixels = self.rr.Image(image.pixels).compress(jpeg_quality=JPEG_QUALITY)
                self.log(f"{place}/image", pixels, static=False)
            self.log(f"{place}/image/truth", self._image_truth(truth), static=False)
            if picture.index in detected:
                detections = detected[picture.index]
                boxes = self._image_boxes(detections.boxes, **_looks(detections))
                self.log(f"{place}/image/detections", boxes, static=False)
        progress("images", len(rows), len(rows))

    def _image_truth(self, truth: Truth) -> Any:
        """Return the boxes of the road users of which a pixel is visible."""
        assert truth.image_boxes is not None
        rows = np.flatnonzero(truth.visible_pixels > 0)
        names = _object_names(truth)
        return self._image_boxes(
            truth.image_boxes[rows],
            class_ids=truth.categories[rows],
            labels=[names[row] for row in rows],
        )

    def _image_boxes(self, boxes: np.ndarray, **looks: Any) -> Any:
        return self.rr.Boxes2D(
            array=boxes, array_format=self.rr.Box2DFormat.XYXY, show_labels=False, **looks
        )

    def _outlines(self, record: Truth | Detections, **looks: Any) -> Any:
        """Return boxes without faces, which hide no returns; labels are shown when pointed at."""
        mode = self.rr.components.FillMode.MajorWireframe
        return self._boxes(record, fill_mode=mode, show_labels=False, **looks)

    def _boxes(
        self, record: Truth | Detections | Tracks, px: float | list[float] = LINE_PX, **looks: Any
    ) -> Any:
        half, none = record.yaws / 2, np.zeros(len(record))
        return self.rr.Boxes3D(
            centers=record.centres,
            sizes=record.sizes,
            quaternions=np.column_stack([none, none, np.sin(half), np.cos(half)]),
            radii=self._px(px),
            **looks,
        )


def _on_ground(places: np.ndarray, terrain: Terrain | None) -> np.ndarray:
    """Return (N, 2) places as (N, 3) points of the ground."""
    heights = np.zeros(len(places)) if terrain is None else terrain.heights(places)
    return np.column_stack([places, heights])


def _object_names(truth: Truth) -> list[str]:
    pairs = zip(truth.categories.tolist(), truth.ids.tolist(), strict=True)
    return [f"{Category(category).name.lower()} {number}" for category, number in pairs]


def _looks(detections: Detections | ImageDetections) -> dict[str, Any]:
    """Return the colours and the labels of detections: category and score."""
    pairs = zip(detections.categories.tolist(), detections.scores.tolist(), strict=True)
    categories = [(Category(number), score) for number, score in pairs]
    colours = [DETECTION_COLOURS[category.family] for category, _ in categories]
    return {
        "colors": np.array(colours).reshape(-1, 3),
        "labels": [f"{category.name.lower()} {score:.2f}" for category, score in categories],
    }


def _classes(truth: Truth) -> np.ndarray:
    """Return (P,) uint16, the class of each return: a category, or one of the three others."""
    sources = truth.sources
    classes = np.full(len(sources), SCENERY_CLASS, np.uint16)
    classes[sources == GROUND] = GROUND_CLASS
    classes[sources == WEATHER] = WEATHER_CLASS
    for number, category in zip(truth.ids, truth.categories, strict=True):
        classes[sources == number] = category
    return classes


def _grey(intensity: np.ndarray) -> np.ndarray:
    """Return (N, 3) uint8, brighter for stronger returns; none is black."""
    levels = (55 + 200 * np.clip(intensity, 0, 1)).astype(np.uint8)
    return np.repeat(levels[:, None], 3, axis=1)


def _at_stamp(scan: LidarScan, before: Pose, now: Pose, after: Pose, passed_s: float) -> np.ndarray:
    """Return (N, 3) points in the LiDAR's frame at the stamp of a scan.

    before, now, after: `world_from_lidar` at the scan and those beside it; between them the LiDAR
    is taken to move at constant rates. passed_s: from the first to the last of them.
    """
    from scipy.spatial.transform import Rotation

    if passed_s <= 0:
        return scan.points
    turn = Rotation.from_matrix(before.rotation.T @ after.rotation).as_rotvec() / passed_s
    shift = now.rotation.T @ (after.translation - before.translation) / passed_s
    offsets_s = scan.time_offset_s.astype(np.float64)[:, None]
    turned: np.ndarray = Rotation.from_rotvec(offsets_s * turn).apply(scan.points)
    moved: np.ndarray = turned + offsets_s * shift
    return moved


def _summary(view: EpisodeView) -> str:
    """Return the scores of the whole episode, and what is not shown, as Markdown."""
    lines = [f"**{view.title}**", "", COLOUR_NOTE, ""]
    for name, scores in view.scores.items():
        lines += [f"| {name} | |", "|---|---|"]
        for column in board_named(name).columns:
            if column.metric in scores and np.isfinite(scores[column.metric].value):
                value = f"{scores[column.metric].value:.{column.decimals}f}"
                lines.append(f"| {column.heading} | {value} |")
        lines.append("")
    return "\n".join([*lines, *view.notes]) + "\n"


def _layout(view: EpisodeView) -> Any:
    """Return which views are shown at first: the world large, images and scores beside it."""
    import rerun.blueprint as rrb

    views = list(_views_beside(view, rrb))
    # The first one, mostly the image, is larger than the others.
    beside = rrb.Vertical(*views, row_shares=[2, *[1] * (len(views) - 1)])
    return rrb.Blueprint(
        rrb.Horizontal(_world_view(view, rrb), beside, column_shares=[3, 2]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        collapse_panels=True,
    )


def _world_view(view: EpisodeView, rrb: Any) -> Any:
    """Return the world from behind the ego, in whose frame it is: so the eye goes with it."""
    has_ego = len(view.truths) > 0
    eye = {"position": EYE_M, "look_target": LOOK_AT_M} if has_ego else {}
    # Colours are made for a dark background, whatever the user's theme is.
    return rrb.Spatial3DView(
        origin="world/ego" if has_ego else "world",
        contents="/world/**",
        name="world",
        background=GROUND_COLOUR,
        eye_controls=rrb.EyeControls3D(**eye),
    )


def _views_beside(view: EpisodeView, rrb: Any) -> Iterator[Any]:
    """Yield images, ratios, and one behind the other the remaining scores."""
    mount = None if view.episode is None else rig(view.episode.rig).camera
    if mount is not None:
        yield rrb.Spatial2DView(origin=f"world/ego/{mount.name}", name=mount.name)
    behind = [rrb.TextDocumentView(origin="summary", name="whole episode")]
    for unit in dict.fromkeys(curve.unit for curve in view.curves):
        own = [curve for curve in view.curves if curve.unit == unit]
        entities = [f"scores/{each.board}/{each.metric}" for each in own]
        if unit == "1":
            # MOTA may be negative.
            least = min([0.0, *(float(each.values.min(initial=0.0)) for each in own)])
            axis = rrb.ScalarAxis(range=(least, 1.0))
            yield rrb.TimeSeriesView(
                origin="/", contents=entities, name="ratios so far", axis_y=axis
            )
        else:
            name = f"{', '.join(each.metric for each in own)} ({unit})"
            behind.append(rrb.TimeSeriesView(origin="/", contents=entities, name=name))
    yield rrb.Tabs(*behind)
