"""Drawing on an RGB array: anti-aliased convex shapes, dots and small text, in pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

Rgb = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

# Rows of three bits, top to bottom.
_GLYPHS = {
    "0": (7, 5, 5, 5, 7),
    "1": (2, 6, 2, 2, 7),
    "2": (7, 1, 7, 4, 7),
    "3": (7, 1, 7, 1, 7),
    "4": (5, 5, 7, 1, 1),
    "5": (7, 4, 7, 1, 7),
    "6": (7, 4, 7, 5, 7),
    "7": (7, 1, 1, 1, 1),
    "8": (7, 5, 7, 5, 7),
    "9": (7, 5, 7, 1, 7),
    "-": (0, 0, 7, 0, 0),
    "m": (0, 0, 7, 7, 5),
    " ": (0, 0, 0, 0, 0),
    ",": (0, 0, 0, 2, 4),
    "A": (2, 5, 7, 5, 5),
    "B": (6, 5, 6, 5, 6),
    "C": (3, 4, 4, 4, 3),
    "D": (6, 5, 5, 5, 6),
    "E": (7, 4, 6, 4, 7),
    "F": (7, 4, 6, 4, 4),
    "G": (3, 4, 5, 5, 3),
    "H": (5, 5, 7, 5, 5),
    "I": (7, 2, 2, 2, 7),
    "J": (1, 1, 1, 5, 2),
    "K": (5, 5, 6, 5, 5),
    "L": (4, 4, 4, 4, 7),
    "M": (5, 7, 7, 5, 5),
    "N": (6, 5, 5, 5, 5),
    "O": (2, 5, 5, 5, 2),
    "P": (6, 5, 6, 4, 4),
    "Q": (2, 5, 5, 6, 3),
    "R": (6, 5, 6, 5, 5),
    "S": (3, 4, 2, 1, 6),
    "T": (7, 2, 2, 2, 2),
    "U": (5, 5, 5, 5, 7),
    "V": (5, 5, 5, 5, 2),
    "W": (5, 5, 7, 7, 5),
    "X": (5, 5, 2, 5, 5),
    "Y": (5, 5, 2, 2, 2),
    "Z": (7, 1, 2, 4, 7),
}


class Canvas:
    """An image to draw on; points are (x, y) in pixels, x to the right, y down.

    pixels: (H, W, 3) float32, 0 to 255.
    """

    def __init__(self, pixels: np.ndarray) -> None:
        """Start from an (H, W, 3) image, which is copied."""
        self.pixels = pixels.astype(np.float32)
        self.height, self.width = pixels.shape[:2]

    def polygon(
        self, corners: np.ndarray, colour: Rgb, *, fill: float = 1.0, line_px: float = 0.0
    ) -> None:
        """Draw a convex (K, 2) polygon: its inside with opacity `fill`, its outline opaque."""
        window = self._window(corners, line_px / 2 + 1)
        if window is None:
            return
        columns, rows = window
        depth = polygon_depth(corners, np.arange(self.width)[columns], np.arange(self.height)[rows])
        cover = fill * np.clip(depth + 0.5, 0, 1)
        if line_px > 0:
            cover = np.maximum(cover, np.clip(line_px / 2 + 0.5 - np.abs(depth), 0, 1))
        self._mix((rows, columns), cover, colour)

    def line(self, start: np.ndarray, end: np.ndarray, colour: Rgb, width_px: float) -> None:
        """Draw a straight stroke."""
        along = np.asarray(end, float) - start
        length = float(np.hypot(*along))
        if length > 0:
            side = np.array([-along[1], along[0]]) / length * width_px / 2
            self.polygon(np.stack([start - side, end - side, end + side, start + side]), colour)

    def cover(self, opacity: np.ndarray, colour: Rgb) -> None:
        """Lay a colour over the whole image with (H, W) opacity."""
        touched = np.nonzero(opacity > 0)
        self._mix(touched, opacity[touched], colour)

    def dots(self, points: np.ndarray, levels: np.ndarray, palette: np.ndarray) -> None:
        """Draw (N, 2) points as squares of two pixels; the highest level lies on top.

        levels: (N,) uint8 from 1 on, rows of the (L, 3) palette.
        """
        x, y = np.floor(points.T).astype(np.int32)
        inside = (x >= 0) & (x < self.width - 1) & (y >= 0) & (y < self.height - 1)
        cells, levels = (y * self.width + x)[inside], levels[inside]
        order = np.argsort(levels, kind="stable")
        top = np.zeros((self.height, self.width), np.uint8)
        top.reshape(-1)[cells[order]] = levels[order]
        top[:, 1:] = np.maximum(top[:, 1:], top[:, :-1])
        top[1:] = np.maximum(top[1:], top[:-1])
        drawn = top > 0
        self.pixels[drawn] = palette[top[drawn]]

    def text(self, text: str, corner: np.ndarray, colour: Rgb, scale: int = 2) -> None:
        """Write with the upper left corner at (x, y); unknown characters become blanks.

        All letters become capitals, except the m of metres.
        """
        x, y = (round(float(v)) for v in corner)
        for character in text:
            rows = np.array(_GLYPHS.get(character) or _GLYPHS.get(character.upper(), _GLYPHS[" "]))
            glyph = (rows[:, None] >> np.array([2, 1, 0])) & 1
            dots = np.argwhere(np.kron(glyph, np.ones((scale, scale), int))) + np.array([y, x])
            inside = ((dots >= 0) & (dots < (self.height, self.width))).all(axis=1)
            self.pixels[tuple(dots[inside].T)] = colour
            x += 4 * scale

    def image(self) -> np.ndarray:
        """Return the (H, W, 3) uint8 image."""
        result: np.ndarray = (self.pixels + np.float32(0.5)).astype(np.uint8)
        return result

    def _window(self, corners: np.ndarray, margin_px: float) -> tuple[slice, slice] | None:
        low = np.floor(corners.min(axis=0) - margin_px).astype(int)
        high = np.ceil(corners.max(axis=0) + margin_px).astype(int) + 1
        low, high = np.maximum(low, 0), np.minimum(high, (self.width, self.height))
        if (low >= high).any():
            return None
        return slice(low[0], high[0]), slice(low[1], high[1])

    def _mix(self, place: Any, opacity: np.ndarray, colour: Rgb) -> None:
        region = self.pixels[place]
        share = opacity.astype(np.float32)[..., None]
        self.pixels[place] = region + share * (np.array(colour, np.float32) - region)


def text_px(text: str, scale: int) -> np.ndarray:
    """Return the (2,) width and height of a line of text in pixels."""
    return np.array([4 * len(text) - 1, 5]) * scale


def polygon_depth(corners: np.ndarray, xs: np.ndarray, ys: np.ndarray) -> np.ndarray:
    """Return (len(ys), len(xs)) depths of pixels inside a convex polygon; negative outside."""
    corners = np.asarray(corners, np.float64)
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    corners, sides, lengths = (a[lengths > 1e-9] for a in (corners, sides, lengths))
    normals = np.stack([-sides[:, 1], sides[:, 0]], axis=1) / lengths[:, None]
    if ((corners.mean(axis=0) - corners) * normals).sum() < 0:
        normals = -normals
    depth = np.full((len(ys), len(xs)), np.inf)
    for (nx, ny), offset in zip(normals, (corners * normals).sum(axis=1), strict=True):
        np.minimum(depth, (nx * xs)[None, :] + (ny * ys - offset)[:, None], out=depth)
    return depth
