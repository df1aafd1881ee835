"""One picture of one moment: bird's-eye view, camera image, range image, scores, legend."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from PIL import Image

from roadscope.core import Detections, Frame, ImageDetections, Tracks, Truth
from roadscope.core.palette import GROUND_COLOUR, LABEL_COLOUR, TRUTH_COLOUR
from roadscope.core.record import Record
from roadscope.envs.drawing.birds_eye import (
    INTENSITY,
    OBJECT,
    PATH_PX,
    BirdsEyeView,
    detection_rows,
    draw_detections,
    draw_ego,
    draw_odometry,
    draw_returns,
    draw_rings,
    draw_road,
    draw_tracks,
    draw_truth,
    odometry_row,
    return_rows,
    scale_symbol,
    track_rows,
    truth_rows,
    write_distances,
    write_ids,
)
from roadscope.envs.drawing.canvas import Canvas, text_px
from roadscope.envs.drawing.labels import LabelPlacer, LegendRow, legend_of
from roadscope.envs.drawing.panels import (
    SMALL_PX,
    RunningScore,
    camera_panel,
    range_panel,
    score_panel,
)
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.traffic.timeline import Timeline

WIDTH, HEIGHT = 1280, 720
"""Size of a composed frame, pixels."""
VIEW_PX = 720
METRES_PER_PX = 0.15
MARGIN, TITLE_PX = 12, 18
SIDE_PX = WIDTH - VIEW_PX - 2 * MARGIN
"""Width of what is beside the view."""
SCAN_PX, MOST_SCAN_PX = 64, 160
SCORES_PX, MOST_SCORES_PX = 84, 150
"""Heights of images of a scan and of scores: of rigs with a camera, and at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot(Record):
    """What one composed frame shows.

    frame, truth: of a scan. timeline: the traffic around its stamp.
    rig: the sensors, of which the layout depends.
    title: above the panels. scores: the figures so far.
    image, image_truth: the latest frame with an image, and its truth.
    detections, tracks: of the scan, world frame; None: not shown. past: earlier tracks.
    image_detections: of the image; None: not shown.
    path, odometry: (K, 2) metres, world frame, places of the ego so far, and where an odometry
        estimated them; None: not shown.
    """

    frame: Frame
    truth: Truth
    timeline: Timeline
    rig: Rig
    title: str = ""
    scores: tuple[RunningScore, ...] = ()
    image: Frame | None = None
    image_truth: Truth | None = None
    detections: Detections | None = None
    tracks: Tracks | None = None
    past: Sequence[Tracks] = ()
    image_detections: ImageDetections | None = None
    path: np.ndarray | None = None
    odometry: np.ndarray | None = None


def composed_frame(shown: Snapshot, *, colour_by: str = OBJECT) -> np.ndarray:
    """Return a (720, 1280, 3) uint8 picture; its layout depends on the rig alone.

    colour_by: what returns in the bird's-eye view are coloured by, `object` or `intensity`.
    """
    legend = _legend(_Contents.of(shown, colour_by), SIDE_PX)
    panels = _panels(shown, SIDE_PX, HEIGHT - 2 * MARGIN - len(legend))
    left = view_from_above(shown, colour_by=colour_by)
    return framed(left, shown.title, shown.truth.stamp_s, panels, legend)


def framed(
    left: np.ndarray,
    title: str,
    stamp_s: float,
    panels: Iterable[tuple[np.ndarray, int]],
    legend: np.ndarray,
) -> np.ndarray:
    """Return a (720, 1280, 3) uint8 picture: a view, and beside it title, panels and legend.

    left: (720, 720, 3). panels: images up to `SIDE_PX` wide, from top to bottom, with the gap below
    each. legend: (H, `SIDE_PX`, 3).
    """
    picture = np.array(Image.new("RGB", (WIDTH, HEIGHT), GROUND_COLOUR))
    picture[:, :VIEW_PX] = left
    x, top = VIEW_PX + MARGIN, MARGIN
    for panel, gap in ((_title(title, stamp_s), 8), *panels):
        picture[top : top + panel.shape[0], x : x + panel.shape[1]] = panel
        top += panel.shape[0] + gap
    picture[HEIGHT - MARGIN - len(legend) : HEIGHT - MARGIN, x : x + SIDE_PX] = legend
    return picture


def view_from_above(
    shown: Snapshot,
    *,
    colour_by: str = OBJECT,
    size_px: int = VIEW_PX,
    metres_per_px: float = METRES_PER_PX,
) -> np.ndarray:
    """Return the bird's-eye view alone, (size_px, size_px, 3) uint8, without a legend."""
    view = BirdsEyeView(shown.truth.world_from_ego, size_px, size_px, metres_per_px)
    canvas = Canvas(size_px, size_px)
    draw_road(canvas, view, shown.timeline)
    draw_rings(canvas, view)
    draw_returns(canvas, view, shown.frame, shown.truth, shown.timeline, colour_by=colour_by)
    if shown.path is not None:
        canvas.line(view.pixels(shown.path), TRUTH_COLOUR, PATH_PX)
    if shown.odometry is not None:
        draw_odometry(canvas, view.pixels(shown.odometry))
    draw_truth(canvas, view, shown.truth)
    draw_ego(canvas, view, shown.timeline)
    labels = LabelPlacer(canvas)
    if shown.tracks is not None:
        draw_tracks(canvas, view, shown.tracks, shown.past)
        write_ids(labels, view, shown.tracks)
    # Above the tracks, whose outlines are wider.
    if shown.detections is not None:
        draw_detections(canvas, view, shown.detections)
    write_distances(labels, view)
    return canvas.image()


def _title(title: str, stamp_s: float) -> np.ndarray:
    canvas = Canvas(SIDE_PX, TITLE_PX + 4)
    clock = f"{max(stamp_s, 0.0):.1f} s"
    right = SIDE_PX - text_px(clock, TITLE_PX)[0]
    canvas.text(_shortened(title, right - MARGIN), np.zeros(2), TRUTH_COLOUR, TITLE_PX)
    canvas.text(clock, np.array([right, 0]), TRUTH_COLOUR, TITLE_PX)
    return canvas.image()


@lru_cache
def _shortened(title: str, width: int) -> str:
    """Return the title, or its beginning with an ellipsis if it is wider."""
    short, length = title, len(title)
    while text_px(short, TITLE_PX)[0] > width and length > 0:
        length -= 1
        short = title[:length].rstrip(" ,+") + "..."
    return short


@lru_cache
def _caption(text: str, width: int) -> np.ndarray:
    canvas = Canvas(width, SMALL_PX + 5)
    canvas.text(text, np.zeros(2), LABEL_COLOUR, SMALL_PX)
    return canvas.image()


def _panels(shown: Snapshot, width: int, free: int) -> Iterator[tuple[np.ndarray, int]]:
    """Yield images from top to bottom with the gap below; they fill `free` pixels at most."""
    mount, spec = shown.rig.camera, shown.rig.lidar.spec
    scan = shown.frame.lidar
    free -= TITLE_PX + 12 + len(_caption("", width))
    range_text = f"LiDAR {spec.name}: range, ahead in the middle, bright at 1 m"
    if mount is None:
        height = min(MOST_SCAN_PX, (free - MOST_SCORES_PX - 3 * MARGIN) // 2)
        yield _caption(range_text, width), 0
        yield range_panel(width, height, scan, spec), MARGIN
        yield _caption(f"LiDAR {spec.name}: intensity, bright at 1", width), 0
        yield range_panel(width, height, scan, spec, intensity=True), MARGIN
        scores_px = MOST_SCORES_PX
    else:
        pinhole, scores_px = mount.spec.pinhole, SCORES_PX
        most = free - SCORES_PX - SCAN_PX - len(_caption("", width)) - 3 * MARGIN
        scale = min(width / pinhole.width, most / pinhole.height)
        yield _caption(f"camera {mount.spec.name}", width), 0
        yield (
            camera_panel(
                round(pinhole.width * scale),
                round(pinhole.height * scale),
                shown.image,
                shown.image_truth,
                detections=shown.image_detections,
                tracks=shown.tracks,
            ),
            MARGIN,
        )
        yield _caption(range_text, width), 0
        yield range_panel(width, SCAN_PX, scan, spec), MARGIN
    if shown.scores:
        yield score_panel(width, scores_px, shown.scores), MARGIN


class _Contents(NamedTuple):
    """What the legend depends on."""

    detections: bool
    tracks: bool
    odometry: bool
    colour_by: str

    @staticmethod
    def of(shown: Snapshot, colour_by: str) -> _Contents:
        detections = shown.detections is not None or shown.image_detections is not None
        return _Contents(
            detections, shown.tracks is not None, shown.odometry is not None, colour_by
        )


@lru_cache
def _legend(contents: _Contents, width: int) -> np.ndarray:
    """Return the legend of everything in the frame, (H, width, 3)."""
    rows = list(truth_rows())
    rows += detection_rows() if contents.detections else ()
    rows += track_rows() if contents.tracks else ()
    rows += [odometry_row()] if contents.odometry else []
    if contents.colour_by == INTENSITY:
        rows.append(LegendRow("return: intensity", scale_symbol))
    else:
        rows += return_rows()
    return legend_of(rows, width)
