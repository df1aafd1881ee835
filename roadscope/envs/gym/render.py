"""A bird's-eye picture of one tick: road, returns, boxes, tracks; the ego drives upwards."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from roadscope.core import (
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
from roadscope.envs.gym.canvas import Canvas, Rgb, text_px
from roadscope.envs.traffic.road_map import RoadMap
from roadscope.envs.traffic.timeline import Timeline
from roadscope.envs.world.prisms import Prisms
from roadscope.envs.world.road_memo import cached_per_road

# --------------------------------------------------------------------------------------------------
# Coordinates of the bird's-eye picture.

EGO_FROM_BOTTOM = 0.4
"""Distance of the ego from the lower edge, a share of the height."""


@dataclass(frozen=True)
class BirdsEyeView:
    """Maps world coordinates to pixels of a square picture."""

    world_from_ego: Pose
    size_px: int
    metres_per_px: float

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return (..., 2) pixels, x right and y down, of (..., 2) points in metres, world frame."""
        (cos, sin), centre = self.world_from_ego.rotation[:2, 0], self.world_from_ego.translation
        x, y = points[..., 0] - centre[0], points[..., 1] - centre[1]
        ahead, left = x * cos + y * sin, y * cos - x * sin
        placed: np.ndarray = self.home + np.stack([-left, -ahead], axis=-1) / self.metres_per_px
        return placed

    @property
    def home(self) -> np.ndarray:
        """(2,) pixel of the ego's rear axle."""
        return home_px(self.size_px)

    @property
    def radius_m(self) -> float:
        """Greatest distance from the ego of anything in the picture, metres."""
        return self.size_px * self.metres_per_px * 0.8


def home_px(size_px: int) -> np.ndarray:
    """Return the (2,) pixel of the ego's rear axle."""
    return np.array([0.5, 1 - EGO_FROM_BOTTOM]) * size_px


def box_corners(centre: np.ndarray, size: np.ndarray, yaw: float) -> np.ndarray:
    """Return (4, 2) corners from above: rear right, front right, front left, rear left."""
    ahead = np.array([np.cos(yaw), np.sin(yaw)]) * size[0] / 2
    left = np.array([-np.sin(yaw), np.cos(yaw)]) * size[1] / 2
    offsets = np.stack([-ahead - left, ahead - left, ahead + left, left - ahead])
    corners: np.ndarray = offsets + centre[:2]
    return corners


# --------------------------------------------------------------------------------------------------
# Colours of the bird's-eye picture and its legend.

EGO: Rgb = (245, 245, 245)
DETECTION: Rgb = (255, 150, 50)
FAMILIES: dict[Family, Rgb] = {
    Family.VEHICLE: (76, 190, 255),
    Family.CYCLIST: (255, 110, 220),
    Family.PEDESTRIAN: (255, 225, 80),
}
TRACKS: tuple[Rgb, ...] = (
    (255, 99, 99),
    (255, 186, 73),
    (240, 240, 90),
    (140, 230, 100),
    (80, 225, 190),
    (110, 170, 255),
    (180, 140, 255),
    (255, 130, 200),
)
TRACK_LINE_PX = 2.0
COASTING_LINE_PX = 0.8
LIDAR_PX = 2.5
"""Colours of the ego, detections, families of boxes and ids of tracks, widths of outlines, and half
the side of the square that stands for a LiDAR; chosen by hand."""


def track_colour(number: int) -> Rgb:
    """Return the colour of a track by its id; ids that are a few apart differ."""
    return TRACKS[number % len(TRACKS)]


# --------------------------------------------------------------------------------------------------
# The ground of the bird's-eye picture: rings of distance, asphalt and lane borders.

BACKGROUND: Rgb = (16, 19, 24)
ASPHALT: Rgb = (44, 49, 57)
MARKING: Rgb = (104, 112, 124)
RING: Rgb = (48, 55, 66)
RING_M = 20.0
PIECE_M = 25.0
"""Colours of the ground, distance of the rings, and greatest length of drawn pieces of lanes;
chosen by hand."""


@lru_cache(maxsize=8)
def blank(size_px: int, metres_per_px: float) -> np.ndarray:
    """Return an empty picture with a ring around the ego every 20 m."""
    canvas = Canvas(np.full((size_px, size_px, 3), BACKGROUND, np.uint8))
    home = home_px(size_px)
    y, x = np.ogrid[:size_px, :size_px]
    distance = np.hypot(x - home[0], y - home[1])
    step = RING_M / metres_per_px
    from_ring = np.abs((distance + step / 2) % step - step / 2)
    canvas.cover(np.where(distance > step / 2, np.clip(1.2 - from_ring, 0, 1), 0.0), RING)
    return canvas.image()


def draw_road(canvas: Canvas, view: BirdsEyeView, road: RoadMap) -> None:
    """Draw asphalt on all lane strips, and lines at the borders of their union."""
    depth = np.full((view.size_px, view.size_px), -2.0, np.float32)
    ends, half_widths = _pieces(road)
    centre = view.world_from_ego.translation[:2]
    near = np.linalg.norm(ends.mean(axis=1) - centre, axis=1) < view.radius_m + PIECE_M
    for (start, end), half in zip(view.pixels(ends[near]), half_widths[near], strict=True):
        _deepen(depth, start, end, half / view.metres_per_px)
    canvas.cover(np.clip(depth + 0.5, 0, 1), ASPHALT)
    canvas.cover(np.clip(1.1 - np.abs(depth - 0.3), 0, 1) * 0.8, MARKING)


@cached_per_road
def _pieces(road: RoadMap) -> tuple[np.ndarray, np.ndarray]:
    """Return straight pieces of lanes: (N, 2, 2) start and end in metres, (N,) half widths."""
    ends, half_widths = [np.empty((0, 2, 2))], [np.empty(0)]
    for points, widths in road.lanes():
        if len(points) < 2:
            continue
        knees = _knees(points)
        for a, b in pairwise(knees):
            count = max(1, int(np.ceil(np.linalg.norm(points[b] - points[a]) / PIECE_M)))
            cuts = points[a] + np.linspace(0, 1, count + 1)[:, None] * (points[b] - points[a])
            ends.append(np.stack([cuts[:-1], cuts[1:]], axis=1))
            half_widths.append(np.full(count, (widths[a] + widths[b]) / 4))
    return np.concatenate(ends), np.concatenate(half_widths)


def _knees(points: np.ndarray) -> np.ndarray:
    """Return the rows of a polyline to keep: one for each 0.1 rad of turn."""
    steps = np.diff(points, axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turned = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(headings)))])
    changes = np.flatnonzero(np.diff(np.floor(turned / 0.1 + 0.5))) + 1
    return np.concatenate([[0], changes, [len(points) - 1]])


def _deepen(depth: np.ndarray, start: np.ndarray, end: np.ndarray, half_px: float) -> None:
    """Update, in place, how deep each pixel lies inside the road, in pixels, by one strip."""
    length = float(np.hypot(*(end - start)))
    if length < 1e-6:
        return
    # Plain floats keep the map's single precision.
    cos, sin = ((end - start) / length).tolist()
    half_px, reach = float(half_px), half_px + 3
    low = np.maximum(np.floor(np.minimum(start, end) - reach), 0).astype(int)
    high = np.minimum(np.ceil(np.maximum(start, end) + reach) + 1, depth.shape[0]).astype(int)
    if (low >= high).any():
        return
    x = np.arange(low[0], high[0], dtype=np.float32)[None, :] - np.float32(start[0])
    y = np.arange(low[1], high[1], dtype=np.float32)[:, None] - np.float32(start[1])
    u = x * cos + y * sin
    v = y * cos - x * sin
    strip = np.minimum(half_px - np.abs(v), np.minimum(u, length - u) + 2.5)
    window = depth[low[1] : high[1], low[0] : high[0]]
    np.maximum(window, strip, out=window)


# --------------------------------------------------------------------------------------------------
# Text on the bird's-eye picture: distances of the rings, ids of tracks, a legend.

LABEL: Rgb = (190, 198, 208)
MARGIN_PX = 2.0
ROW_PX = 16
SWATCH_PX = np.array([22.0, 8.0])
"""Colour of labels, margin around them, and height of rows and size of symbols in the legend;
chosen by hand."""


class LabelPlacer:
    """Writes labels on a canvas without overlap.

    reserved: (4,) low x, low y, high x, high y in pixels of each label so far.
    """

    def __init__(self, canvas: Canvas) -> None:
        self.canvas = canvas
        self.reserved: list[np.ndarray] = []

    def write(self, text: str, places: np.ndarray, colour: Rgb, scale: int = 2) -> bool:
        """Write at the first of (K, 2) upper left corners that is free; False if none is."""
        for place in places:
            box = np.concatenate([place - MARGIN_PX, place + text_px(text, scale) + MARGIN_PX])
            if self._inside(box) and not _overlap(box, self.reserved):
                self.reserve(box)
                self.canvas.polygon(_corners(box), BACKGROUND, fill=0.6)
                self.canvas.text(text, place, colour, scale)
                return True
        return False

    def reserve(self, box: np.ndarray) -> None:
        """Keep further labels out of a (4,) box."""
        self.reserved.append(box)

    def _inside(self, box: np.ndarray) -> bool:
        return bool(
            (box[:2] >= 0).all() and box[2] <= self.canvas.width and box[3] <= self.canvas.height
        )


def write_distances(labels: LabelPlacer, view: BirdsEyeView) -> None:
    """Write the radius on each ring, behind the ego to its right, where there is least traffic."""
    step = RING_M / view.metres_per_px
    diagonal = np.sqrt([0.5, 0.5])
    for ring in range(1, int(view.size_px / step) + 1):
        text = f"{ring * RING_M:.0f} m"
        place = view.home + ring * step * diagonal - text_px(text, 2) / 2
        labels.write(text, place[None], LABEL)


def write_ids(labels: LabelPlacer, view: BirdsEyeView, tracks: Tracks) -> None:
    """Write ids beside their boxes where there is space, the nearest tracks first.

    tracks: world frame. Coasting tracks come last.
    """
    away = np.linalg.norm(tracks.centres[:, :2] - view.world_from_ego.translation[:2], axis=1)
    for row in np.lexsort((away, tracks.states == TrackState.COASTING)):
        corners = view.pixels(box_corners(tracks.centres[row], tracks.sizes[row], tracks.yaws[row]))
        text = str(tracks.ids[row])
        places = _places_beside(corners.min(axis=0), corners.max(axis=0), text_px(text, 2))
        labels.write(text, places, track_colour(int(tracks.ids[row])))


class _LegendRow(NamedTuple):
    """A row of the legend: its text, and how the box beside it is drawn."""

    text: str
    colour: Rgb
    fill: float
    line_px: float


def draw_legend(labels: LabelPlacer, *, detections: bool, tracks: bool) -> None:
    """Draw the legend of a picture with truth."""
    rows = [_LegendRow("ego", EGO, 0.35, 1.5)]
    rows += [
        _LegendRow(f"true {family.name.lower()}", colour, 0.12, 1.5)
        for family, colour in FAMILIES.items()
    ]
    if detections:
        rows.append(_LegendRow("detection", DETECTION, 0.0, 1.5))
    if tracks:
        rows.append(_LegendRow("track, 1 s ahead", TRACKS[3], 0.15, TRACK_LINE_PX))
        rows.append(_LegendRow("coasting track", TRACKS[6], 0.15, COASTING_LINE_PX))
    _draw_rows(labels, tuple(rows))


def _draw_rows(labels: LabelPlacer, rows: tuple[_LegendRow, ...]) -> None:
    """Draw a legend at the lower left, if the picture is large enough."""
    picture, opacity = _legend(rows)
    height, width = opacity.shape
    canvas = labels.canvas
    if 2 * width > canvas.width or 2 * height > canvas.height:
        return
    region = canvas.pixels[-height:, :width]
    region += opacity[..., None] * (picture - region)
    labels.reserve(np.array([0, canvas.height - height, width, canvas.height], float))


@lru_cache(maxsize=4)
def _legend(rows: tuple[_LegendRow, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the (H, W, 3) picture of a legend and its (H, W) opacity."""
    width = max(text_px(row.text, 2)[0] for row in rows) + SWATCH_PX[0] + 24
    canvas = Canvas(np.full((len(rows) * ROW_PX + 8, int(width), 3), BACKGROUND, np.uint8))
    for number, row in enumerate(rows):
        middle = np.array([8 + SWATCH_PX[0] / 2, 4 + (number + 0.5) * ROW_PX])
        _draw_swatch(canvas, middle, row)
        canvas.text(row.text, np.array([16 + SWATCH_PX[0], middle[1] - 5]), LABEL)
    picture = canvas.image()
    drawn = (picture != BACKGROUND).any(axis=2)
    return picture, np.where(drawn, 1.0, 0.7).astype(np.float32)


def _draw_swatch(canvas: Canvas, middle: np.ndarray, row: _LegendRow) -> None:
    """Draw the symbol of a row: a box; for a track a shorter one with a line ahead."""
    low, high = middle - SWATCH_PX / 2, middle + SWATCH_PX / 2
    if "track" in row.text:
        end = np.array([high[0], middle[1]])
        high = high - [SWATCH_PX[0] * 0.35, 0]
        canvas.line((low + high) / 2, end, row.colour, 1.5)
    canvas.polygon(
        _corners(np.concatenate([low, high])), row.colour, fill=row.fill, line_px=row.line_px
    )


def _places_beside(low: np.ndarray, high: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return (4, 2) corners for a label: right below, right above, left above, left below."""
    right, left = high[0] + 3, low[0] - 3 - size[0]
    below, above = high[1] - 5, low[1] - 5
    return np.array([[right, below], [right, above], [left, above], [left, below]])


def _overlap(box: np.ndarray, others: list[np.ndarray]) -> bool:
    return any(
        bool((box[:2] < other[2:]).all() and (other[:2] < box[2:]).all()) for other in others
    )


def _corners(box: np.ndarray) -> np.ndarray:
    return box[[[0, 1], [2, 1], [2, 3], [0, 3]]]


# --------------------------------------------------------------------------------------------------
# The bird's-eye picture of one tick.

GROUND_RETURN: Rgb = (66, 78, 104)
WEATHER_RETURN: Rgb = (112, 92, 116)
SOLID: Rgb = (92, 84, 76)
FOLIAGE: Rgb = (40, 84, 52)
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
    frame: Frame,
    truth: Truth,
    timeline: Timeline,
    *,
    tracks: Tracks | None = None,
    detections: Detections | None = None,
    scenery: Prisms | None = None,
    legend: bool = True,
    size_px: int = 600,
    metres_per_px: float = 0.2,
) -> np.ndarray:
    """Return a (size_px, size_px, 3) uint8 picture of one tick: measurements over the truth.

    Lanes are grey. Returns go from blue (low) to orange (high); those of the ground are dim, those
    of rain and fog a dull violet. True boxes are coloured by family, and a wedge shows their front.
    Detections are orange. Tracks have a colour and a number by their id, and a line as long as
    their motion in one second; their outline is thin while they coast. A number that would cover
    other text is left out.

    legend: whether to explain the colours, in pictures that are large enough.
    scenery: outlines to draw below the returns, world frame.
    """
    view = BirdsEyeView(truth.world_from_ego, size_px, metres_per_px)
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
    labels = LabelPlacer(canvas)
    if legend:
        draw_legend(labels, detections=detections is not None, tracks=tracks is not None)
    write_distances(labels, view)
    if tracks is not None:
        write_ids(labels, view, tracks)
    return canvas.image()


def scan_view(
    scan: LidarScan,
    ego_from_lidar: Pose,
    detections: Detections,
    *,
    size_px: int = 800,
    metres_per_px: float = 0.15,
) -> np.ndarray:
    """Return a (size_px, size_px, 3) uint8 picture of a scan of which no truth is known.

    The way ahead is upwards. Colours are those of `birds_eye`; detections are coloured by family.
    detections: ego frame.
    """
    view = BirdsEyeView(Pose.identity(), size_px, metres_per_px)
    canvas = Canvas(blank(size_px, metres_per_px))
    placed = ego_from_lidar.apply(scan.points)
    canvas.dots(view.pixels(placed[:, :2]), _levels(placed[:, 2]), PALETTE)
    for row, number in enumerate(detections.categories.tolist()):
        box = box_corners(detections.centres[row], detections.sizes[row], detections.yaws[row])
        colour = FAMILIES[Category(number).family]
        canvas.polygon(view.pixels(box), colour, fill=0.15, line_px=TRACK_LINE_PX)
    middle = view.pixels(ego_from_lidar.translation[:2])
    canvas.polygon(_corners(np.concatenate([middle - LIDAR_PX, middle + LIDAR_PX])), EGO)
    labels = LabelPlacer(canvas)
    families = FAMILIES.items()
    rows = (_LegendRow(each.name.lower(), colour, 0.15, TRACK_LINE_PX) for each, colour in families)
    _draw_rows(labels, (_LegendRow("lidar", EGO, 1.0, 1.5), *rows))
    write_distances(labels, view)
    return canvas.image()


def _draw_scenery(canvas: Canvas, view: BirdsEyeView, scenery: Prisms) -> None:
    centre = view.world_from_ego.translation[:2]
    near = np.linalg.norm(scenery.footprints[:, 0] - centre, axis=1) < view.radius_m
    outlines = view.pixels(scenery.footprints[near])
    porous = scenery.extinctions[near] > 0
    for outline, corners, foliage in zip(outlines, scenery.corners[near], porous, strict=True):
        canvas.polygon(outline[:corners], FOLIAGE if foliage else SOLID, fill=0.6)


def _draw_returns(
    canvas: Canvas, view: BirdsEyeView, frame: Frame, truth: Truth, timeline: Timeline
) -> None:
    """Draw returns, compensated for ego motion and true object motion up to the stamp."""
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
    _compensate_motion(world, offsets, truth)
    levels = _levels(height)
    if len(truth.sources) == len(levels):
        levels[truth.sources == WEATHER] = 1
    canvas.dots(view.pixels(world), levels, PALETTE)


def _levels(heights: np.ndarray) -> np.ndarray:
    """Return the rows of `PALETTE` of returns at (N,) heights above the ground, metres."""
    shares = np.clip((heights - HEIGHTS_M[0]) / (HEIGHTS_M[-1] - HEIGHTS_M[0]), -0.004, 1)
    levels: np.ndarray = (shares * 200 + 3).astype(np.uint8)
    return levels


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


def _draw_box(
    canvas: Canvas, corners: np.ndarray, colour: Rgb, *, fill: float, line_px: float = 1.5
) -> None:
    """Draw a box of pixel corners with a wedge that points ahead."""
    canvas.polygon(corners, colour, fill=fill, line_px=line_px)
    front = (corners[1] + corners[2]) / 2
    base = (corners[1:3] - front) * 0.6 + front + (corners[[0, 3]] - corners[1:3]) * 0.18
    canvas.polygon(np.stack([front, base[1], base[0]]), colour, fill=0.9)


def _draw_ego(canvas: Canvas, view: BirdsEyeView, timeline: Timeline) -> None:
    pose, size = view.world_from_ego, timeline.sizes[0]
    ahead = pose.rotation[:2, 0] * timeline.centre_ahead_m[0]
    corners = box_corners(pose.translation[:2] + ahead, size, pose.yaw)
    _draw_box(canvas, view.pixels(corners), EGO, fill=0.35)


def _draw_detections(canvas: Canvas, view: BirdsEyeView, detections: Detections) -> None:
    if detections.frame == "ego":
        detections = detections.moved(view.world_from_ego, "world")
    for centre, size, yaw in zip(
        detections.centres, detections.sizes, detections.yaws, strict=True
    ):
        canvas.polygon(
            view.pixels(box_corners(centre, size, yaw)), DETECTION, fill=0.0, line_px=1.5
        )


def _draw_tracks(canvas: Canvas, view: BirdsEyeView, tracks: Tracks) -> None:
    for row, number in enumerate(tracks.ids):
        colour = track_colour(int(number))
        centre = tracks.centres[row]
        corners = view.pixels(box_corners(centre, tracks.sizes[row], tracks.yaws[row]))
        coasting = tracks.states[row] == TrackState.COASTING
        line_px = COASTING_LINE_PX if coasting else TRACK_LINE_PX
        canvas.polygon(corners, colour, fill=0.15, line_px=line_px)
        ends = view.pixels(np.stack([centre[:2], centre[:2] + tracks.velocities[row]]))
        canvas.line(ends[0], ends[1], colour, 1.5)
