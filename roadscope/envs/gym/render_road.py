"""The ground of the bird's-eye picture: rings of distance, asphalt and lane borders."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np

from roadscope.envs.gym.canvas import Canvas, Colour
from roadscope.envs.gym.render_view import View, home_px
from roadscope.envs.traffic.road_map import RoadMap
from roadscope.envs.world.road_memo import once_a_road

BACKGROUND: Colour = (16, 19, 24)
ASPHALT: Colour = (44, 49, 57)
MARKING: Colour = (104, 112, 124)
RING: Colour = (48, 55, 66)
RING_M = 20.0
PIECE_M = 25.0


@lru_cache(maxsize=8)
def blank(size_px: int, metres_per_px: float) -> np.ndarray:
    """Return an empty picture with a ring each 20 m around the ego."""
    canvas = Canvas(np.full((size_px, size_px, 3), BACKGROUND, np.uint8))
    home = home_px(size_px)
    y, x = np.ogrid[:size_px, :size_px]
    way = np.hypot(x - home[0], y - home[1])
    step = RING_M / metres_per_px
    from_ring = np.abs((way + step / 2) % step - step / 2)
    canvas.cover(np.where(way > step / 2, np.clip(1.2 - from_ring, 0, 1), 0.0), RING)
    return canvas.image()


def draw_road(canvas: Canvas, view: View, road: RoadMap) -> None:
    """Lay asphalt on all lane strips and a line where no strip goes deeper."""
    depth = np.full((view.size_px, view.size_px), -2.0, np.float32)
    ends, half_widths = _pieces(road)
    centre = view.world_from_ego.translation[:2]
    near = np.linalg.norm(ends.mean(axis=1) - centre, axis=1) < view.radius_m + PIECE_M
    for (start, end), half in zip(view.pixels(ends[near]), half_widths[near], strict=True):
        _deepen(depth, start, end, half / view.metres_per_px)
    canvas.cover(np.clip(depth + 0.5, 0, 1), ASPHALT)
    canvas.cover(np.clip(1.1 - np.abs(depth - 0.3), 0, 1) * 0.8, MARKING)


@once_a_road
def _pieces(road: RoadMap) -> tuple[np.ndarray, np.ndarray]:
    """Cut lanes into straight pieces: (N, 2, 2) start and end in metres, (N,) half widths."""
    ends, half_widths = [np.empty((0, 2, 2))], [np.empty(0)]
    for points, widths in road.lanes():
        if len(points) < 2:
            continue
        kept = _knees(points)
        for a, b in pairwise(kept):
            count = max(1, int(np.ceil(np.linalg.norm(points[b] - points[a]) / PIECE_M)))
            cuts = points[a] + np.linspace(0, 1, count + 1)[:, None] * (points[b] - points[a])
            ends.append(np.stack([cuts[:-1], cuts[1:]], axis=1))
            half_widths.append(np.full(count, (widths[a] + widths[b]) / 4))
    return np.concatenate(ends), np.concatenate(half_widths)


def _knees(points: np.ndarray) -> np.ndarray:
    """Pick the points to keep of a polyline: one for every 0.1 rad it has turned."""
    steps = np.diff(points, axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turned = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(headings)))])
    changes = np.flatnonzero(np.diff(np.floor(turned / 0.1 + 0.5))) + 1
    return np.concatenate([[0], changes, [len(points) - 1]])


def _deepen(depth: np.ndarray, start: np.ndarray, end: np.ndarray, half_px: float) -> None:
    """Raise the map of depths, in pixels, to that of one straight strip, its ends drawn over."""
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
