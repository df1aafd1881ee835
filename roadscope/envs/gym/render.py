"""A bird's-eye picture of one tick: road, returns, boxes, tracks; the ego drives up the page."""

from __future__ import annotations

import numpy as np

from roadscope.core import WEATHER, Category, Detections, Frame, Tracks, TrackState, Truth
from roadscope.envs.gym.canvas import Canvas, Colour
from roadscope.envs.gym.render_colours import (
    COASTING_LINE_PX,
    DETECTION,
    EGO,
    FAMILIES,
    TRACK_LINE_PX,
    track_colour,
)
from roadscope.envs.gym.render_labels import Labels, draw_legend, write_distances, write_ids
from roadscope.envs.gym.render_road import blank, draw_road
from roadscope.envs.gym.render_view import View, box_corners
from roadscope.envs.traffic.timeline import Timeline
from roadscope.envs.world.prisms import Prisms

GROUND_RETURN: Colour = (66, 78, 104)
WEATHER_RETURN: Colour = (112, 92, 116)
SOLID: Colour = (92, 84, 76)
FOLIAGE: Colour = (40, 84, 52)
HEIGHTS_M = np.array([0.2, 0.8, 1.6, 3.0, 6.0])
HEIGHT_COLOURS = np.array(
    [(70, 120, 220), (60, 200, 200), (130, 225, 90), (250, 215, 70), (250, 130, 60)], np.float32
)
PALETTE = np.stack(
    [
        np.interp(np.linspace(HEIGHTS_M[0], HEIGHTS_M[-1], 201), HEIGHTS_M, c)
        for c in HEIGHT_COLOURS.T
    ],
    axis=1,
)
PALETTE = np.concatenate([[(0, 0, 0), WEATHER_RETURN, GROUND_RETURN], PALETTE]).astype(np.float32)
"""Level 1 is rain and fog, 2 the ground, 3 to 203 go from HEIGHTS_M[0] to the last."""


def birds_eye(
    frame: Frame, truth: Truth, timeline: Timeline,
    *, tracks: Tracks | None = None, detections: Detections | None = None,
    scenery: Prisms | None = None, legend: bool = True,
    size_px: int = 600, metres_per_px: float = 0.2,
) -> np.ndarray:  # fmt: skip
    """(size_px, size_px, 3) uint8: what one tick measured over what was there.

    Lanes are grey; returns go from blue (low) to orange (high), those of the ground are dim,
    those of rain and fog a dull violet; true boxes are coloured by family, their point shows
    ahead; detections are orange; tracks carry colour and number of their id and a line as long
    as one second's way, and have a thin outline while they coast. A number that would cover
    another word is left out.
    legend: whether the colours are explained, in pictures that are large enough.
    scenery: outlines to draw below the returns, world frame.
    """
    view = View(truth.world_from_ego, size_px, metres_per_px)
    canvas = Canvas(blank(size_px, metres_per_px))
    draw_road(canvas, view, timeline.road)
    if scenery is not None:
        _draw_scenery(canvas, view, scenery)
    _draw_returns(canvas, view, frame, truth, timeline)
    for row, family in enumerate(Category(c).family for c in truth.categories):
        box = box_corners(truth.centres[row], truth.sizes[row], truth.yaws[row])
        _draw_box(canvas, view.pixels(box), FAMILIES[family], fill=0.12)
    _draw_ego(canvas, view, timeline)
    if detections is not None:
        _draw_detections(canvas, view, detections)
    if tracks is not None:
        tracks = tracks.moved(view.world_from_ego, "world") if tracks.frame == "ego" else tracks
        _draw_tracks(canvas, view, tracks)
    labels = Labels(canvas)
    if legend:
        draw_legend(labels, detections=detections is not None, tracks=tracks is not None)
    write_distances(labels, view)
    if tracks is not None:
        write_ids(labels, view, tracks)
    return canvas.image()


def _draw_scenery(canvas: Canvas, view: View, scenery: Prisms) -> None:
    centre = view.world_from_ego.translation[:2]
    near = np.linalg.norm(scenery.footprints[:, 0] - centre, axis=1) < view.radius_m
    outlines = view.pixels(scenery.footprints[near])
    porous = scenery.extinctions[near] > 0
    for outline, corners, foliage in zip(outlines, scenery.corners[near], porous, strict=True):
        canvas.polygon(outline[:corners], FOLIAGE if foliage else SOLID, fill=0.6)


def _draw_returns(
    canvas: Canvas, view: View, frame: Frame, truth: Truth, timeline: Timeline
) -> None:
    """Draw returns where they were at the stamp: own motion and true motion are taken out."""
    scan = frame.lidar
    if scan is None or len(scan) == 0:
        return
    mount = frame.calibration.pose(scan.sensor)
    # Plain sums: a small matrix product over many rows waits for threads of the BLAS library.
    ahead, left, height = (
        scan.points[:, 0] * row[0] + scan.points[:, 1] * row[1] + scan.points[:, 2] * row[2] + shift
        for row, shift in zip(mount.rotation, mount.translation, strict=True)
    )
    offsets = scan.time_offset_s.astype(np.float64)
    knots = np.linspace(offsets.min(), offsets.max() + 1e-6, 11)
    ego = timeline.at(frame.stamp_s + knots)
    x, y, yaw = (
        np.interp(offsets, knots, column)
        for column in (ego.axles[:, 0, 0], ego.axles[:, 0, 1], ego.yaws[:, 0])
    )
    cos, sin = np.cos(yaw), np.sin(yaw)
    world = np.stack([x + cos * ahead - sin * left, y + sin * ahead + cos * left], axis=1)
    _halt(world, offsets, truth)
    shares = np.clip((height - HEIGHTS_M[0]) / (HEIGHTS_M[-1] - HEIGHTS_M[0]), -0.004, 1)
    levels = (shares * 200 + 3).astype(np.uint8)
    if len(truth.sources) == len(levels):
        levels[truth.sources == WEATHER] = 1
    canvas.dots(view.pixels(world), levels, PALETTE)


def _halt(world: np.ndarray, offsets_s: np.ndarray, truth: Truth) -> None:
    """Take the motion of what it came from out of each (P, 2) return, in place."""
    rows = np.flatnonzero(truth.sources >= 0)
    if len(rows) == 0 or len(truth) == 0:
        return
    order = np.argsort(truth.ids)
    sources = truth.sources[rows]
    found = order[np.clip(np.searchsorted(truth.ids[order], sources), 0, len(order) - 1)]
    moving = truth.ids[found] == sources
    rows, found = rows[moving], found[moving]
    world[rows] -= truth.velocities[found] * offsets_s[rows, None]


def _draw_box(
    canvas: Canvas, corners: np.ndarray, colour: Colour, *, fill: float, line_px: float = 1.5
) -> None:
    """Draw a box of pixel corners with a wedge that points ahead."""
    canvas.polygon(corners, colour, fill=fill, line_px=line_px)
    front = (corners[1] + corners[2]) / 2
    base = (corners[1:3] - front) * 0.6 + front + (corners[[0, 3]] - corners[1:3]) * 0.18
    canvas.polygon(np.stack([front, base[1], base[0]]), colour, fill=0.9)


def _draw_ego(canvas: Canvas, view: View, timeline: Timeline) -> None:
    pose, size = view.world_from_ego, timeline.sizes[0]
    ahead = pose.rotation[:2, 0] * timeline.centre_ahead_m[0]
    corners = box_corners(pose.translation[:2] + ahead, size, pose.yaw)
    _draw_box(canvas, view.pixels(corners), EGO, fill=0.35)


def _draw_detections(canvas: Canvas, view: View, detections: Detections) -> None:
    if detections.frame == "ego":
        detections = detections.moved(view.world_from_ego, "world")
    for centre, size, yaw in zip(
        detections.centres, detections.sizes, detections.yaws, strict=True
    ):
        canvas.polygon(
            view.pixels(box_corners(centre, size, yaw)), DETECTION, fill=0.0, line_px=1.5
        )


def _draw_tracks(canvas: Canvas, view: View, tracks: Tracks) -> None:
    for row, number in enumerate(tracks.ids):
        colour = track_colour(int(number))
        centre = tracks.centres[row]
        corners = view.pixels(box_corners(centre, tracks.sizes[row], tracks.yaws[row]))
        coasting = tracks.states[row] == TrackState.COASTING
        line_px = COASTING_LINE_PX if coasting else TRACK_LINE_PX
        canvas.polygon(corners, colour, fill=0.15, line_px=line_px)
        ends = view.pixels(np.stack([centre[:2], centre[:2] + tracks.velocities[row]]))
        canvas.line(ends[0], ends[1], colour, 1.5)
