"""A bird's-eye view: road, returns, true boxes, detections, tracks, paths; ahead is upwards."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from roadscope.core import (
    GROUND,
    WEATHER,
    Category,
    Detections,
    Family,
    Frame,
    LidarScan,
    Pose,
    Tracks,
    TrackState,
    Truth,
)
from roadscope.core.palette import (
    ASPHALT_COLOUR,
    COLOUR_SCALE,
    DETECTION_COLOURS,
    GROUND_COLOUR,
    HIDDEN_COLOUR,
    LABEL_COLOUR,
    MARKING_COLOUR,
    ODOMETRY_COLOUR,
    PAVEMENT_COLOUR,
    RETURN_COLOURS,
    RING_COLOUR,
    TRACK_COLOURS,
    TRUTH_COLOUR,
    VERGE_COLOUR,
    Rgb,
    track_colour,
)
from roadscope.envs.drawing.canvas import Canvas, text_px
from roadscope.envs.drawing.labels import (
    ROW_PX,
    TEXT_PX,
    LabelPlacer,
    LegendRow,
    draw_legend,
    places_beside,
)
from roadscope.envs.traffic.terrain import tilt_angles
from roadscope.envs.traffic.timeline import Timeline
from roadscope.envs.world.ground import PAVED, SHOULDERS_M, surface_of

OBJECT, INTENSITY = "object", "intensity"
"""What returns can be coloured by."""
EGO_FROM_BOTTOM = 0.36
"""Distance of the ego from the lower edge, a share of the height."""
RING_M = 20.0
"""Distance of the rings around the ego."""
DASH_M, GAP_M = 4.0, 12.0
"""Length of a dash of a lane marking, and distance from dash to dash."""
TRUTH_PX, DETECTION_PX, TRACK_PX, COASTING_PX, PATH_PX = 1.5, 1.0, 3.0, 1.0, 2.0
"""Widths of outlines and of paths."""
DIAMOND_PX = 3.5 * np.array([[-1, 0], [0, -1], [1, 0], [0, 1]])
"""Corners of the mark in the middle of a detection."""
LEAST_RADIUS_PX = 3.0
"""Of the circle of a person on foot."""
LONGEST_M = 20.0
"""Half the length of the longest road user, amply."""
LEVELS = 200
"""Levels of a scale of measured values."""
HEIGHTS_M = 0.0, 4.0
"""Ends of the scale of heights above the ground."""

# --------------------------------------------------------------------------------------------------
# Coordinates.


@dataclass(frozen=True)
class BirdsEyeView:
    """Maps world coordinates to pixels of a picture."""

    world_from_ego: Pose
    width_px: int
    height_px: int
    metres_per_px: float

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return (..., 2) pixels, x right and y down, of (..., 2) points in metres, world frame."""
        ahead, centre = self.world_from_ego.rotation[:2, 0], self.world_from_ego.translation
        cos, sin = ahead / np.hypot(*ahead)
        x, y = points[..., 0] - centre[0], points[..., 1] - centre[1]
        ahead, left = x * cos + y * sin, y * cos - x * sin
        placed: np.ndarray = self.home + np.stack([-left, -ahead], axis=-1) / self.metres_per_px
        return placed

    @property
    def home(self) -> np.ndarray:
        """(2,) pixel of the ego's rear axle."""
        return np.array([0.5 * self.width_px, (1 - EGO_FROM_BOTTOM) * self.height_px])

    @property
    def radius_m(self) -> float:
        """Greatest distance from the ego of anything in the picture, metres."""
        far = np.hypot(self.width_px / 2, (1 - EGO_FROM_BOTTOM) * self.height_px)
        return float(far) * self.metres_per_px

    def near(self, points: np.ndarray, margin_m: float = 0.0) -> np.ndarray:
        """Return (N,) bool, which (N, 2) points or more columns may be in the picture."""
        away = points[:, :2] - self.world_from_ego.translation[:2]
        inside: np.ndarray = np.hypot(*away.T) < self.radius_m + margin_m
        return inside


def box_corners(centres: np.ndarray, sizes: np.ndarray, yaws: np.ndarray | float) -> np.ndarray:
    """Return (..., 4, 2) corners from above: rear right, front right, front left, rear left.

    centres, sizes: (..., 2) or more columns. yaws: (...).
    """
    cos, sin = np.cos(yaws), np.sin(yaws)
    ahead = np.stack([cos, sin], axis=-1) * sizes[..., :1] / 2
    left = np.stack([-sin, cos], axis=-1) * sizes[..., 1:2] / 2
    offsets = np.stack([-ahead - left, ahead - left, ahead + left, left - ahead], axis=-2)
    corners: np.ndarray = offsets + centres[..., None, :2]
    return corners


# --------------------------------------------------------------------------------------------------
# The ground: rings, verges, asphalt and lane markings.


def draw_rings(canvas: Canvas, view: BirdsEyeView) -> None:
    """Draw a ring around the ego every 20 m."""
    step = RING_M / view.metres_per_px
    for ring in range(1, int(view.radius_m / RING_M) + 1):
        canvas.circle(view.home, ring * step, RING_COLOUR, line_px=1.0)


def draw_road(canvas: Canvas, view: BirdsEyeView, timeline: Timeline) -> None:
    """Draw verges or pavements, asphalt, and lane markings."""
    surface = surface_of(timeline.road)
    strips = surface.strips[view.near((surface.strips[:, :2] + surface.strips[:, 2:4]) / 2, 12.0)]
    beside_m = SHOULDERS_M.get(timeline.style, 0.0)
    verge = PAVEMENT_COLOUR if timeline.style in PAVED else VERGE_COLOUR
    for wider_m, colour in ((beside_m, verge), (0.0, ASPHALT_COLOUR)):
        for corners in _strip_corners(view, strips, wider_m):
            canvas.polygon(corners, colour)
    lines = surface.lines[view.near(surface.lines)]
    lines = lines[(lines[:, 5] == 0) | (lines[:, 4] % GAP_M < DASH_M)]
    ends = view.pixels(lines[:, :4].reshape(-1, 2, 2))
    for each in ends:
        canvas.line(each, MARKING_COLOUR, 1.0)
    for x, y, yaw, length, width, _ in timeline.obstacles:
        corners = box_corners(np.array([x, y]), np.array([length, width]), yaw)
        canvas.polygon(view.pixels(corners), RETURN_COLOURS["scenery"], fill=0.5)


def _strip_corners(view: BirdsEyeView, strips: np.ndarray, wider_m: float) -> np.ndarray:
    """Return (N, 4, 2) pixels of the corners of pieces of lanes, a little longer than they are."""
    start, end, half = strips[:, :2], strips[:, 2:4], strips[:, 4:] + wider_m
    ahead = (end - start) / np.maximum(np.linalg.norm(end - start, axis=1, keepdims=True), 1e-9)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) * half
    longer = ahead * (0.3 + wider_m)
    corners = [start - longer - left, end + longer - left, end + longer + left]
    return view.pixels(np.stack([*corners, start - longer + left], axis=1))


# --------------------------------------------------------------------------------------------------
# Returns.

_KINDS = tuple(RETURN_COLOURS)
_SCALE_COLOURS = np.stack(
    [
        np.interp(np.linspace(0, len(COLOUR_SCALE) - 1, LEVELS), range(len(COLOUR_SCALE)), each)
        for each in np.array(COLOUR_SCALE, float).T
    ],
    axis=1,
)
SCALE_COLOURS = np.concatenate([[(0, 0, 0)], _SCALE_COLOURS])
"""(1 + LEVELS, 3) colours of levels of measured values, from 1 on."""
OBJECT_COLOURS = np.array([(0, 0, 0), *RETURN_COLOURS.values()], float)


def scale_levels(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return (...) uint8 rows of `SCALE_COLOURS` of measured values."""
    shares = np.clip((values - low) / (high - low), 0.0, 1.0)
    levels: np.ndarray = (1 + shares * (LEVELS - 1)).astype(np.uint8)
    return levels


def object_levels(sources: np.ndarray) -> np.ndarray:
    """Return (N,) uint8 rows of `OBJECT_COLOURS` of the sources of returns, as in `Truth`."""
    kinds = np.select(
        [sources >= 0, sources == GROUND, sources == WEATHER],
        [_KINDS.index("road user"), _KINDS.index("ground"), _KINDS.index("rain, fog")],
        _KINDS.index("scenery"),
    )
    return (kinds + 1).astype(np.uint8)


def draw_returns(
    canvas: Canvas,
    view: BirdsEyeView,
    frame: Frame,
    truth: Truth,
    timeline: Timeline,
    *,
    colour_by: str,
) -> None:
    """Draw returns, compensated for ego motion and true object motion up to the stamp."""
    scan = frame.lidar
    if scan is None or len(scan) == 0:
        return
    offsets = scan.time_offset_s.astype(np.float64)
    in_ego = frame.calibration.pose(scan.sensor).apply(scan.points)
    world = _places_from_above(in_ego, frame.stamp_s, offsets, timeline)
    _compensate_motion(world, offsets, truth)
    if colour_by == INTENSITY or len(truth.sources) != len(scan):
        canvas.dots(view.pixels(world), scale_levels(scan.intensity, 0.0, 1.0), SCALE_COLOURS)
    else:
        canvas.dots(view.pixels(world), object_levels(truth.sources), OBJECT_COLOURS)


def _places_from_above(
    points: np.ndarray, stamp_s: float, offsets_s: np.ndarray, timeline: Timeline
) -> np.ndarray:
    """Return (P, 2) places, world frame, of (P, 3) points in the ego frame of their own time."""
    knots = np.linspace(offsets_s.min(), offsets_s.max() + 1e-6, 11)
    states = timeline.at(stamp_s + knots)
    at_returns = partial(np.interp, offsets_s, knots)
    x, y = (at_returns(column) for column in states.axles[:, 0].T)
    yaw = at_returns(states.yaws[:, 0])
    ahead, left, up = points.T
    if timeline.terrain is not None:
        _, rises, leans = timeline.stances(states)[:, 0].T
        pitch, roll = tilt_angles(rises, leans)
        cos, sin = at_returns(np.cos(roll)), at_returns(np.sin(roll))
        left, up = cos * left - sin * up, sin * left + cos * up
        ahead = at_returns(np.cos(pitch)) * ahead + at_returns(np.sin(pitch)) * up
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack([x + cos * ahead - sin * left, y + sin * ahead + cos * left], axis=1)


def _compensate_motion(world: np.ndarray, offsets_s: np.ndarray, truth: Truth) -> None:
    """Compensate each (P, 2) return for the motion of its object up to the stamp, in place."""
    rows = np.flatnonzero(truth.sources >= 0)
    if len(rows) == 0 or len(truth) == 0:
        return
    order = np.argsort(truth.ids)
    sources = truth.sources[rows]
    actors = order[np.clip(np.searchsorted(truth.ids[order], sources), 0, len(order) - 1)]
    moving = truth.ids[actors] == sources
    rows, actors = rows[moving], actors[moving]
    world[rows] -= truth.velocities[actors] * offsets_s[rows, None]


# --------------------------------------------------------------------------------------------------
# Road users, detections, tracks.


def draw_truth(canvas: Canvas, view: BirdsEyeView, truth: Truth) -> None:
    """Draw true road users in white, those without any return in grey."""
    boxes = view.pixels(box_corners(truth.centres, truth.sizes, truth.yaws))
    for row in np.flatnonzero(view.near(truth.centres, LONGEST_M)):
        colour = HIDDEN_COLOUR if truth.lidar_returns[row] == 0 else TRUTH_COLOUR
        draw_user(canvas, boxes[row], Category(int(truth.categories[row])).family, colour)


def draw_user(canvas: Canvas, corners: np.ndarray, family: Family, colour: Rgb) -> None:
    """Draw (4, 2) pixel corners: a box with a wedge ahead, or a circle for a person on foot."""
    if family == Family.PEDESTRIAN:
        radius = max(LEAST_RADIUS_PX, float(np.ptp(corners, axis=0).max()) / 2)
        canvas.circle(corners.mean(axis=0), radius, colour, line_px=TRUTH_PX)
        return
    canvas.polygon(corners, colour, fill=0.0, line_px=TRUTH_PX)
    front = (corners[1] + corners[2]) / 2
    back = (corners[[0, 3]] - corners[1:3]) * (0.5 if family == Family.CYCLIST else 0.18)
    base = (corners[1:3] - front) * 0.7 + front + back
    canvas.polygon(np.stack([front, base[1], base[0]]), colour)


def draw_ego(canvas: Canvas, view: BirdsEyeView, timeline: Timeline) -> None:
    """Draw the ego, filled."""
    pose, size = view.world_from_ego, timeline.sizes[0]
    centre = pose.translation[:2] + pose.rotation[:2, 0] * timeline.centre_ahead_m[0]
    _draw_own(canvas, view.pixels(box_corners(centre, size, pose.yaw)))


def _draw_own(canvas: Canvas, corners: np.ndarray) -> None:
    canvas.polygon(corners, TRUTH_COLOUR)
    front = (corners[1] + corners[2]) / 2 + (corners[0] - corners[1]) * 0.1
    base = corners[1:3] * 0.7 + front * 0.3 + (corners[[0, 3]] - corners[1:3]) * 0.2
    canvas.polygon(np.stack([front, base[1], base[0]]), GROUND_COLOUR)


def draw_odometry(canvas: Canvas, points: np.ndarray) -> None:
    """Draw the (K, 2) pixels of a path that an odometry estimates, with a ring at its end."""
    canvas.dashes(points, ODOMETRY_COLOUR, PATH_PX, 6.0)
    canvas.circle(points[-1], 5.0, ODOMETRY_COLOUR, line_px=PATH_PX)


def draw_detections(canvas: Canvas, view: BirdsEyeView, detections: Detections) -> None:
    """Draw detections, world frame, in the colours of their families."""
    boxes = view.pixels(box_corners(detections.centres, detections.sizes, detections.yaws))
    for row in np.flatnonzero(view.near(detections.centres, LONGEST_M)):
        colour = DETECTION_COLOURS[Category(int(detections.categories[row])).family]
        draw_detection(canvas, boxes[row], colour)


def draw_detection(canvas: Canvas, corners: np.ndarray, colour: Rgb) -> None:
    """Draw an outline of (4, 2) pixel corners, and a diamond in its middle."""
    canvas.polygon(corners, colour, fill=0.0, line_px=DETECTION_PX)
    canvas.polygon(corners.mean(axis=0) + DIAMOND_PX, colour)


def draw_tracks(
    canvas: Canvas, view: BirdsEyeView, tracks: Tracks, past: Sequence[Tracks] = ()
) -> None:
    """Draw tracks, world frame, with tails through their past and a line to one second ahead.

    past: the tracks of earlier frames, world frame, the latest last.
    """
    tails, coasting = _tails(tracks, past), tracks.states == TrackState.COASTING
    boxes = view.pixels(box_corners(tracks.centres, tracks.sizes, tracks.yaws))
    places = tracks.centres[:, :2]
    ahead = view.pixels(np.stack([places, places + tracks.velocities], axis=1))
    for row in np.flatnonzero(view.near(places, LONGEST_M)):
        number = int(tracks.ids[row])
        tail = view.pixels(np.array([*tails[number], places[row]]))
        colour = track_colour(number)
        _draw_track(canvas, boxes[row], colour, ahead[row], tail, coasting=bool(coasting[row]))


def _draw_track(
    canvas: Canvas,
    corners: np.ndarray,
    colour: Rgb,
    ahead: np.ndarray,
    tail: np.ndarray,
    *,
    coasting: bool,
) -> None:
    canvas.line(tail, colour, PATH_PX, opacity=0.5)
    canvas.polygon(corners, colour, fill=0.25, line_px=COASTING_PX if coasting else TRACK_PX)
    canvas.line(ahead, colour, 1.0)


def _tails(tracks: Tracks, past: Sequence[Tracks]) -> dict[int, list[np.ndarray]]:
    """Return by id the centres of a track in earlier frames, the oldest first."""
    tails: dict[int, list[np.ndarray]] = {number: [] for number in tracks.ids.tolist()}
    for earlier in past:
        for number, centre in zip(earlier.ids.tolist(), earlier.centres, strict=True):
            if number in tails:
                tails[number].append(centre[:2])
    return tails


# --------------------------------------------------------------------------------------------------
# Labels and legends.


def write_distances(labels: LabelPlacer, view: BirdsEyeView) -> None:
    """Write the radius on each ring, behind the ego to its right, where there is least traffic."""
    step = RING_M / view.metres_per_px
    diagonal = np.sqrt([0.5, 0.5])
    for ring in range(1, int(view.radius_m / RING_M) + 1):
        text = f"{ring * RING_M:.0f} m"
        place = view.home + ring * step * diagonal - np.array(text_px(text, TEXT_PX)) / 2
        labels.write(text, place[None], LABEL_COLOUR)


def write_ids(labels: LabelPlacer, view: BirdsEyeView, tracks: Tracks) -> None:
    """Write ids beside their boxes where there is space, the nearest tracks first.

    tracks: world frame. Coasting tracks come last.
    """
    away = np.linalg.norm(tracks.centres[:, :2] - view.world_from_ego.translation[:2], axis=1)
    boxes = view.pixels(box_corners(tracks.centres, tracks.sizes, tracks.yaws))
    for row in np.lexsort((away, tracks.states == TrackState.COASTING)):
        if away[row] < view.radius_m:
            number = int(tracks.ids[row])
            labels.write(str(number), places_beside(boxes[row], str(number)), track_colour(number))


def _symbol(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the corners of a box that points to the right: rear right, then ahead and around."""
    return np.array([[low[0], high[1]], high, [high[0], low[1]], low])


def _user_symbol(
    canvas: Canvas, low: np.ndarray, high: np.ndarray, *, family: Family, colour: Rgb
) -> None:
    middle = (low + high) / 2
    half = {Family.VEHICLE: (12, 4.5), Family.CYCLIST: (7, 2.2), Family.PEDESTRIAN: (3.5, 3.5)}
    size = np.array(half[family])
    draw_user(canvas, _symbol(middle - size, middle + size), family, colour)


def _box_symbol(canvas: Canvas, low: np.ndarray, high: np.ndarray, *, colour: Rgb) -> None:
    draw_detection(canvas, _symbol(low, high), colour)


def _track_symbol(
    canvas: Canvas, low: np.ndarray, high: np.ndarray, *, colour: Rgb, coasting: bool
) -> None:
    middle, half, reach = (low + high) / 2, np.array([5, 4.5]), np.array([12, 0])
    tail, ahead = np.array([middle - reach, middle]), np.array([middle, middle + reach])
    _draw_track(
        canvas, _symbol(middle - half, middle + half), colour, ahead, tail, coasting=coasting
    )


def _dot_symbol(canvas: Canvas, low: np.ndarray, high: np.ndarray, *, colour: Rgb) -> None:
    for x, y in ((4, 2), (10, 6), (14, 1), (20, 5)):
        canvas.circle(low + np.array([x, y]), 1.6, colour)


def _path_symbol(canvas: Canvas, low: np.ndarray, high: np.ndarray) -> None:
    canvas.line(_level(low, high), TRUTH_COLOUR, PATH_PX)


def _odometry_symbol(canvas: Canvas, low: np.ndarray, high: np.ndarray) -> None:
    draw_odometry(canvas, _level(low, high - np.array([5, 0])))


def _level(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the ends of a line from left to right through the middle of a box."""
    middle = (low[1] + high[1]) / 2
    return np.array([[low[0], middle], [high[0], middle]])


def _ego_symbol(canvas: Canvas, low: np.ndarray, high: np.ndarray) -> None:
    _draw_own(canvas, _symbol(low, high))


def user_rows() -> Iterator[LegendRow]:
    """Yield the legend of the ego, its path and the true road users."""
    yield LegendRow("ego", _ego_symbol)
    yield LegendRow("ego's path", _path_symbol)
    for family in Family:
        draw = partial(_user_symbol, family=family, colour=TRUTH_COLOUR)
        yield LegendRow(f"true {family.value}", draw)


def truth_rows() -> Iterator[LegendRow]:
    """Yield the legend of the ego, its path and the true road users, seen or not."""
    yield from user_rows()
    hidden = partial(_user_symbol, family=Family.VEHICLE, colour=HIDDEN_COLOUR)
    yield LegendRow("without returns", hidden)


def detection_rows() -> Iterator[LegendRow]:
    """Yield the legend of detections."""
    for family, colour in DETECTION_COLOURS.items():
        yield LegendRow(f"detected {family.value}", partial(_box_symbol, colour=colour))


def track_rows() -> Iterator[LegendRow]:
    """Yield the legend of tracks."""
    first, second = (
        partial(_track_symbol, colour=TRACK_COLOURS[0], coasting=coasting)
        for coasting in (False, True)
    )
    yield LegendRow("track (by id)", first)
    yield LegendRow("coasting track", second)


def odometry_row() -> LegendRow:
    """Return the legend of the path that an odometry estimates."""
    return LegendRow("odometry's path", _odometry_symbol)


def return_rows() -> Iterator[LegendRow]:
    """Yield the legend of returns by what they came from."""
    for name, colour in RETURN_COLOURS.items():
        yield LegendRow(f"return: {name}", partial(_dot_symbol, colour=colour))


# --------------------------------------------------------------------------------------------------
# A scan alone.


def scan_view(scan: LidarScan, ego_from_lidar: Pose, detections: Detections) -> np.ndarray:
    """Return an (800, 800, 3) uint8 picture of a scan of which no truth is known.

    The way ahead is upwards. Returns are coloured by height, detections by family.
    detections: ego frame.
    """
    size_px = 800
    view = BirdsEyeView(Pose.identity(), size_px, size_px, metres_per_px=0.15)
    canvas = Canvas(size_px, size_px)
    draw_rings(canvas, view)
    placed = ego_from_lidar.apply(scan.points)
    canvas.dots(view.pixels(placed[:, :2]), scale_levels(placed[:, 2], *HEIGHTS_M), SCALE_COLOURS)
    draw_detections(canvas, view, detections)
    lidar = view.pixels(ego_from_lidar.translation[:2])
    canvas.circle(lidar, LEAST_RADIUS_PX, TRUTH_COLOUR)
    labels = LabelPlacer(canvas)
    rows = [
        LegendRow("LiDAR", lambda c, low, high: c.circle((low + high) / 2, 3.0, TRUTH_COLOUR)),
        *detection_rows(),
        LegendRow(f"return, {HEIGHTS_M[0]:g} to {HEIGHTS_M[1]:g} m high", scale_symbol),
    ]
    height, width = ROW_PX * len(rows), 190
    low = np.array([12.0, size_px - 12.0 - height])
    draw_legend(canvas, rows, low, width)
    labels.reserved.append(np.array([0, low[1], low[0] + width, size_px]))
    write_distances(labels, view)
    return canvas.image()


def scale_symbol(canvas: Canvas, low: np.ndarray, high: np.ndarray) -> None:
    """Draw the scale of measured values, low to high."""
    edges = np.linspace(low[0], high[0], 13)
    for k, left in enumerate(edges[:-1]):
        colour = tuple(SCALE_COLOURS[1 + round(k / 11 * (LEVELS - 1))].astype(int).tolist())
        canvas.polygon(_symbol(np.array([left, low[1]]), np.array([edges[k + 1], high[1]])), colour)
