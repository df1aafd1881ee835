"""Pictures and videos of one episode with its detections, tracks, odometry and running scores.

Also a picture of its middle image with the boxes of a camera detector.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from roadscope.benchmarks.cache import FolderError, usable_file, write_atomically
from roadscope.benchmarks.episode import Episode, check_episode, sensing_of, timeline_of
from roadscope.benchmarks.images import camera_of, image_rows, pictures
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.trajectory_errors import absolute_errors
from roadscope.benchmarks.nodes.images import ImageNode
from roadscope.benchmarks.nodes.poses import start_from_ego
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.records import EpisodeTracks
from roadscope.benchmarks.references import check_image_source
from roadscope.benchmarks.report.judged_scenes import ALARMS, MISSES, SWITCHES, judged_scene
from roadscope.benchmarks.single import Summary
from roadscope.core import CameraImage, ImageDetections, NotInstalledError, Pose, Requirement
from roadscope.core.answers import STAMP_TOLERANCE_S
from roadscope.core.palette import (
    ASPHALT_COLOUR,
    DETECTION_COLOURS,
    HIDDEN_COLOUR,
    LABEL_COLOUR,
    ODOMETRY_COLOUR,
    TRACK_COLOURS,
    TRUTH_COLOUR,
)
from roadscope.envs.drawing.birds_eye import OBJECT
from roadscope.envs.drawing.composed import WIDTH, Snapshot, composed_frame
from roadscope.envs.drawing.panels import RunningScore, image_view
from roadscope.envs.sensors.rigs import rig

PICTURES = (".png", ".jpg", ".webp")
GIF, MP4 = ".gif", ".mp4"
MOVIEPY = Requirement("moviepy", "pip install roadscope[video]")
TAIL_S = 1.0
"""Length of the tails of tracks."""
GIF_COLOURS = 255
"""A GIF has 256; one of them stands for pixels that do not change."""
TINTS = 1.0, 0.75, 0.5, 0.3
"""Shares of colours that have a meaning, mixed with that of asphalt."""
MOST_GIF_FRAMES = 1500
"""All frames are in memory until the file is written, a megabyte each."""
LEAST_SCORE = 0.3
"""Boxes in images with lower scores are not drawn: they would hide the picture."""


def picture_path(path: Path | str) -> Path:
    """Return the path; raise `FolderError` if no picture can be written there."""
    return usable_file(path, PICTURES, "a picture")


def check_video(episode: Episode, path: Path | str, *, every: int = 1) -> Path:
    """Return the path; raise an error if no video of the episode can be written there.

    An MP4 needs MoviePy: `NotInstalledError` without it. A GIF must not be long: `FolderError`.
    every: it shows every n-th scan.
    """
    place = usable_file(path, (GIF, MP4), "a video")
    if place.suffix.lower() == MP4:
        if MOVIEPY.missing:
            raise NotInstalledError(f"{place}: {MOVIEPY.missing}; a .gif needs nothing more")
        return place
    check_episode(episode)
    length_s = episode.duration_s or timeline_of(episode).end_s
    frames = length_s / sensing_of(episode).rig.lidar.spec.period_s / every
    if frames > MOST_GIF_FRAMES:
        raise FolderError(
            f"{place}: a GIF of {frames:.0f} frames does not fit into memory, "
            f"{MOST_GIF_FRAMES} at most: choose fewer --seconds, a greater --video-every, or a .mp4"
        )
    return place


def save_image(pixels: np.ndarray, path: Path) -> None:
    """Write (H, W, 3) uint8 pixels in the format of the path's ending."""
    from PIL import Image

    ending = Image.registered_extensions()[path.suffix.lower()]
    write_atomically(path, partial(Image.fromarray(pixels).save, format=ending))


def save_picture(
    summary: Summary,
    path: Path | str,
    *,
    colour_by: str = OBJECT,
    camera_detector: str | None = None,
) -> None:
    """Write the composed frame of the middle scan to an image file.

    camera_detector: one whose boxes are drawn in the image.
    """
    path = picture_path(path)
    middle = len(summary.tracks) // 2
    pictures = RunPictures(
        summary, colour_by=colour_by, camera_detector=camera_detector, scans=[middle]
    )
    save_image(pictures.frame(middle), path)


def save_video(
    summary: Summary,
    path: Path | str,
    *,
    colour_by: str = OBJECT,
    camera_detector: str | None = None,
    width: int = WIDTH,
    every: int = 1,
    progress: Progress | None = None,
) -> None:
    """Write composed frames of an episode as a GIF, or as an MP4 with the extra `video`.

    camera_detector: one whose boxes are drawn in the images.
    width: of the video, pixels. every: it shows every n-th scan.
    """
    path = check_video(summary.episode, path, every=every)
    scans = range(0, len(summary.tracks), every)
    pictures = RunPictures(
        summary, colour_by=colour_by, camera_detector=camera_detector, scans=scans
    )
    video = _Video(pictures, scans, width, progress or silent)
    write = _write_gif if path.suffix.lower() == GIF else _write_mp4
    write_atomically(path, partial(write, video))


class RunPictures:
    """The composed frames of an episode, one of each scan.

    scans: numbers of the scans in whose images the camera detector looks for objects; None: all.
    """

    def __init__(
        self,
        summary: Summary,
        *,
        colour_by: str = OBJECT,
        camera_detector: str | None = None,
        scans: Sequence[int] | None = None,
    ) -> None:
        self._summary, self._colour_by = summary, colour_by
        self._sensing, self._timeline = sensing_of(summary.episode), timeline_of(summary.episode)
        self._image_boxes: dict[int, ImageDetections | None] | None = None
        if camera_detector is not None:
            drawn = range(len(self)) if scans is None else scans
            rows = () if self._image_rows is None else self._image_rows[drawn]
            self._image_boxes = _image_boxes(
                summary.episode, camera_detector, rows=np.unique(rows).tolist()
            )

    def __len__(self) -> int:
        return len(self._summary.tracks)

    @property
    def period_s(self) -> float:
        """Seconds from frame to frame."""
        return self._sensing.rig.lidar.spec.period_s

    def frame(self, index: int) -> np.ndarray:
        """Return the composed frame of a scan, (720, 1280, 3) uint8."""
        return composed_frame(self.snapshot(index), colour_by=self._colour_by)

    def snapshot(self, index: int) -> Snapshot:
        """Return what the frame of a scan shows."""
        summary, episode = self._summary, self._summary.episode
        frame, truth = self._sensing.sense(self._timeline, index)
        first = max(0, index - round(TAIL_S / self.period_s))
        image, image_truth, boxes = None, None, None
        if self._image_rows is not None:
            row = int(self._image_rows[index])
            image, image_truth = self._sensing.sense_image(self._timeline, row)
            boxes = None if self._image_boxes is None else self._image_boxes.get(row)
        condition = "" if episode.condition == "clear" else f", {episode.condition}"
        return Snapshot(
            frame,
            truth,
            self._timeline,
            self._sensing.rig,
            title=f"{episode.scenario}, seed {episode.seed}, {episode.rig}{condition}",
            scores=tuple(score.until(index) for score in self._scores),
            image=image,
            image_truth=image_truth,
            detections=summary.detections.detections[index],
            tracks=summary.tracks[index],
            past=summary.tracks[first:index],
            image_detections=boxes,
            path=self._path[: index + 1],
            odometry=None if self._odometry is None else self._odometry[: index + 1],
        )

    @cached_property
    def _stamps_s(self) -> np.ndarray:
        return np.array([truth.stamp_s for truth in self._summary.detections.truths])

    @cached_property
    def _path(self) -> np.ndarray:
        poses = [truth.world_from_ego for truth in self._summary.detections.truths]
        return np.array([pose.translation[:2] for pose in poses])

    @cached_property
    def _image_rows(self) -> np.ndarray | None:
        """Numbers of the images nearest in time to the scans."""
        if self._sensing.rig.camera is None:
            return None
        rows = np.array(image_rows(self._summary.episode, 0.0))
        image_s = np.array([self._sensing.rig.camera.stamp_s(int(row)) for row in rows])
        nearest: np.ndarray = rows[np.abs(image_s - self._stamps_s[:, None]).argmin(axis=1)]
        return nearest

    @cached_property
    def _odometry(self) -> np.ndarray | None:
        """Places of the ego by the odometry, world frame; the first pose is the true one."""
        poses = self._summary.poses
        if poses is None:
            return None
        mount = self._sensing.calibration.pose(self._sensing.rig.lidar.name)
        world_from_start = Pose(poses.trajectories.truth[0]) @ mount.inverse()
        places = start_from_ego(poses, self._summary.episode, self._stamps_s.tolist())
        return np.array([(world_from_start @ place).translation[:2] for place in places])

    @cached_property
    def _scores(self) -> list[RunningScore]:
        """The running scores of the whole episode."""
        summary = self._summary
        detected = judged_scene(summary.detections, summary.detections, summary.rule)
        tracks = EpisodeTracks(summary.tracks, summary.detections.times)
        tracked = judged_scene(tracks, summary.detections, summary.rule)
        frames = np.arange(1, len(self) + 1)
        alarms = np.cumsum(detected.counts(ALARMS)) / frames
        scores = [
            RunningScore("detected", _share(detected.hits(), detected.counts(MISSES)), top=1.0),
            RunningScore("false / frame", alarms),
            RunningScore("tracked", _share(tracked.hits(), tracked.counts(MISSES)), top=1.0),
            RunningScore("ID switches", np.cumsum(tracked.counts(SWITCHES)), decimals=0),
        ]
        poses = summary.poses
        if poses is not None:
            errors_m = absolute_errors(poses.trajectories, "origin").positions_m
            rows = np.searchsorted(poses.stamps_s, self._stamps_s + STAMP_TOLERANCE_S) - 1
            errors_m = np.where(rows < 0, np.nan, errors_m[rows])
            scores.append(RunningScore("odometry (m)", errors_m))
        return scores


def _share(hits: np.ndarray, misses: np.ndarray) -> np.ndarray:
    """Return (T,) share of hits so far; NaN before there is anything to hit."""
    so_far, possible = np.cumsum(hits), np.cumsum(hits + misses)
    shares: np.ndarray = np.where(possible > 0, so_far / np.maximum(possible, 1), np.nan)
    return shares


# --------------------------------------------------------------------------------------------------
# The boxes of camera detectors.


def check_camera_detector(episode: Episode, detector: str) -> None:
    """Refuse a rig without camera, and a wrong detector."""
    check_episode(episode)
    camera_of(rig(episode.rig))
    check_image_source(detector)


def check_view(episode: Episode, detector: str, path: Path | str) -> None:
    """Refuse a rig without camera, a wrong detector, and a file that cannot be written."""
    check_camera_detector(episode, detector)
    usable_file(path, PICTURES, "an image")


def save_view(episode: Episode, detector: str, path: Path | str) -> int:
    """Write the middle image with boxes drawn in to a file; return the number of boxes.

    detector: spec of a camera detector, `oracle` or a noise model. Boxes have a score of at least
    `LEAST_SCORE`. Images that are lost by a fault are left out; `ValueError` if all are lost.
    """
    check_view(episode, detector, path)
    row, image = _middle_image(episode)
    boxes = _image_boxes(episode, detector, rows=[row])[row]
    assert boxes is not None
    save_image(image_view(image.pixels, boxes), Path(path))
    return len(boxes)


def _middle_image(episode: Episode) -> tuple[int, CameraImage]:
    """Return the number of the middle image of those that are not lost, and the image."""
    rows = image_rows(episode, 0.0)
    middle = len(rows) // 2
    for row in sorted(rows, key=lambda number: abs(number - rows[middle])):
        (picture,) = pictures(episode, (row,))
        if picture.frame.camera is not None:
            return row, picture.frame.camera
    raise ValueError(f"no image of {episode.scenario} is left: {episode.condition}")


@dataclass(frozen=True)
class _DrawnImages(ImageNode):
    """The detections in the images that pictures show."""

    rows: tuple[int, ...] = ()

    def image_rows(self) -> tuple[int, ...]:
        return self.rows


def _image_boxes(
    episode: Episode, detector: str, *, rows: Sequence[int]
) -> dict[int, ImageDetections | None]:
    """Return the boxes of a camera detector by the number of the image."""
    node = _DrawnImages(check_image_source(detector), episode, 0.0, rows=tuple(rows))
    answers = node.compute(RunOptions())
    return {
        int(row): None if boxes is None else boxes.select(boxes.scores >= LEAST_SCORE)
        for row, boxes in zip(answers.rows, answers.detections, strict=True)
    }


# --------------------------------------------------------------------------------------------------
# Files.


class _Video(NamedTuple):
    """What is written to a file.

    rows: numbers of the scans that are shown. width: of the video, pixels.
    """

    pictures: RunPictures
    rows: range
    width: int
    progress: Progress

    @property
    def period_s(self) -> float:
        """Seconds from frame to frame."""
        return self.pictures.period_s * self.rows.step

    def frames(self) -> Iterator[Any]:
        """Yield all frames as images."""
        for done, row in enumerate(self.rows):
            self.progress("video", done, len(self.rows))
            yield self.frame(row)
        self.progress("video", len(self.rows), len(self.rows))

    def frame(self, row: int) -> Any:
        """Return a frame of about the width; its sides are even numbers, as codecs need them."""
        from PIL import Image

        image = Image.fromarray(self.pictures.frame(row))
        if self.width == image.width:
            return image
        size = 2 * round(self.width / 2), 2 * round(image.height * self.width / image.width / 2)
        return image.resize(size, Image.Resampling.LANCZOS)


def _write_gif(video: _Video, path: Path) -> None:
    """Write an endless GIF; all frames have the same colours, so that nothing flickers."""
    colours = _gif_colours(video)
    first, *others = (frame.quantize(palette=colours, dither=0) for frame in video.frames())
    first.save(
        path,
        format="GIF",
        save_all=True,
        append_images=others,
        duration=round(1000 * video.period_s),
        loop=0,
    )


def _gif_colours(video: _Video) -> Any:
    """Return an image with the colours of four frames, and of all that has a colour of its own."""
    from PIL import Image

    own = np.array(
        [
            TRUTH_COLOUR,
            HIDDEN_COLOUR,
            ODOMETRY_COLOUR,
            LABEL_COLOUR,
            *DETECTION_COLOURS.values(),
            *TRACK_COLOURS,
        ]
    )
    # Smooth edges need tints.
    tints = np.concatenate(
        [np.array(ASPHALT_COLOUR) + share * (own - ASPHALT_COLOUR) for share in TINTS]
    )
    samples = np.unique(np.linspace(0, len(video.rows) - 1, 4).astype(int)).tolist()
    frames = np.concatenate([np.asarray(video.frame(video.rows[k])) for k in samples])
    sampled = Image.fromarray(frames).quantize(GIF_COLOURS - len(tints))
    colours = Image.new("P", (1, 1))
    colours.putpalette([*(sampled.getpalette() or []), *tints.astype(int).ravel().tolist()])
    return colours


def _write_mp4(video: _Video, path: Path) -> None:
    from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter

    writer = FFMPEG_VideoWriter(
        str(path),
        video.frame(0).size,
        1 / video.period_s,
        pixel_format="yuv420p",
        # The name of a file that is not complete yet does not end in .mp4.
        ffmpeg_params=["-f", "mp4"],
    )
    try:
        for frame in video.frames():
            writer.write_frame(np.asarray(frame))
    finally:
        writer.close()
