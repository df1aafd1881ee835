"""Words on the bird's-eye picture: distances of the rings, ids of tracks, a legend."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from roadscope.core import Tracks, TrackState
from roadscope.envs.gym.canvas import Canvas, Colour, text_px
from roadscope.envs.gym.render_colours import (
    COASTING_LINE_PX,
    DETECTION,
    EGO,
    FAMILIES,
    TRACK_LINE_PX,
    TRACKS,
)
from roadscope.envs.gym.render_colours import track_colour as colour_of
from roadscope.envs.gym.render_road import BACKGROUND, RING_M
from roadscope.envs.gym.render_view import View, box_corners

LABEL: Colour = (190, 198, 208)
MARGIN_PX = 2.0
ROW_PX = 16
SWATCH_PX = np.array([22.0, 8.0])


class Labels:
    """Words on a canvas, none over another.

    taken: (4,) low x, low y, high x, high y in pixels of each word so far.
    """

    def __init__(self, canvas: Canvas) -> None:
        self.canvas = canvas
        self.taken: list[np.ndarray] = []

    def write(self, text: str, places: np.ndarray, colour: Colour, scale: int = 2) -> bool:
        """Write at the first of (K, 2) upper left corners that is free; False if none is."""
        for place in places:
            box = np.concatenate([place - MARGIN_PX, place + text_px(text, scale) + MARGIN_PX])
            if self._inside(box) and not _overlap(box, self.taken):
                self.reserve(box)
                self.canvas.polygon(_corners(box), BACKGROUND, fill=0.6)
                self.canvas.text(text, place, colour, scale)
                return True
        return False

    def reserve(self, box: np.ndarray) -> None:
        """Keep words that are still to come out of a (4,) box."""
        self.taken.append(box)

    def _inside(self, box: np.ndarray) -> bool:
        return bool((box[:2] >= 0).all() and box[2] <= self.canvas.width
                    and box[3] <= self.canvas.height)  # fmt: skip


def write_distances(labels: Labels, view: View) -> None:
    """Write the radius on each ring, behind the ego to its right, where least happens."""
    step = RING_M / view.metres_per_px
    diagonal = np.sqrt([0.5, 0.5])
    for ring in range(1, int(view.size_px / step) + 1):
        text = f"{ring * RING_M:.0f} m"
        place = view.home + ring * step * diagonal - text_px(text, 2) / 2
        labels.write(text, place[None], LABEL)


def write_ids(labels: Labels, view: View, tracks: Tracks) -> None:
    """Write ids beside their boxes, the nearest first, as far as there is room for them.

    tracks: world frame. Coasting tracks come after all others.
    """
    away = np.linalg.norm(tracks.centres[:, :2] - view.world_from_ego.translation[:2], axis=1)
    for row in np.lexsort((away, tracks.states == TrackState.COASTING)):
        corners = view.pixels(box_corners(tracks.centres[row], tracks.sizes[row], tracks.yaws[row]))
        text = str(tracks.ids[row])
        places = _beside(corners.min(axis=0), corners.max(axis=0), text_px(text, 2))
        labels.write(text, places, colour_of(int(tracks.ids[row])))


def draw_legend(labels: Labels, *, detections: bool, tracks: bool) -> None:
    """Say at the lower left what the colours mean; too small a picture goes without."""
    picture, opacity = _legend(detections, tracks)
    height, width = opacity.shape
    canvas = labels.canvas
    if 2 * width > canvas.width or 2 * height > canvas.height:
        return
    region = canvas.pixels[-height:, :width]
    region += opacity[..., None] * (picture - region)
    labels.reserve(np.array([0, canvas.height - height, width, canvas.height], float))


@lru_cache(maxsize=4)
def _legend(detections: bool, tracks: bool) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) picture of the legend and its (H, W) opacity."""
    rows = [("ego", EGO, 0.35, 1.5)]
    rows += [(f"true {family.name.lower()}", c, 0.12, 1.5) for family, c in FAMILIES.items()]
    if detections:
        rows.append(("detection", DETECTION, 0.0, 1.5))
    if tracks:
        rows.append(("track, 1 s ahead", TRACKS[3], 0.15, TRACK_LINE_PX))
        rows.append(("coasting track", TRACKS[6], 0.15, COASTING_LINE_PX))
    width = max(text_px(text, 2)[0] for text, *_ in rows) + SWATCH_PX[0] + 24
    canvas = Canvas(np.full((len(rows) * ROW_PX + 8, int(width), 3), BACKGROUND, np.uint8))
    for number, row in enumerate(rows):
        middle = np.array([8 + SWATCH_PX[0] / 2, 4 + (number + 0.5) * ROW_PX])
        _draw_swatch(canvas, middle, row)
        canvas.text(row[0], np.array([16 + SWATCH_PX[0], middle[1] - 5]), LABEL)
    picture = canvas.image()
    drawn = (picture != BACKGROUND).any(axis=2)
    return picture, np.where(drawn, 1.0, 0.7).astype(np.float32)


def _draw_swatch(canvas: Canvas, middle: np.ndarray, row: tuple[str, Colour, float, float]) -> None:
    """Draw what a row explains: a box, shorter and with the line of its way for a track."""
    text, colour, fill, line_px = row
    low, high = middle - SWATCH_PX / 2, middle + SWATCH_PX / 2
    if "track" in text:
        end = np.array([high[0], middle[1]])
        high = high - [SWATCH_PX[0] * 0.35, 0]
        canvas.line((low + high) / 2, end, colour, 1.5)
    canvas.polygon(_corners(np.concatenate([low, high])), colour, fill=fill, line_px=line_px)


def _beside(low: np.ndarray, high: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(4, 2) corners for a word beside a box: right below, right above, left above and below."""
    right, left = high[0] + 3, low[0] - 3 - size[0]
    below, above = high[1] - 5, low[1] - 5
    return np.array([[right, below], [right, above], [left, above], [left, below]])


def _overlap(box: np.ndarray, others: list[np.ndarray]) -> bool:
    return any(
        bool((box[:2] < other[2:]).all() and (other[:2] < box[2:]).all()) for other in others
    )


def _corners(box: np.ndarray) -> np.ndarray:
    return box[[[0, 1], [2, 1], [2, 3], [0, 3]]]
