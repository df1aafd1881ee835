"""Drawing with smooth edges and letters: shapes at twice the size, letters at the final one."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from roadscope.core.palette import GROUND_COLOUR, Rgb

FINER = 2
"""Shapes are drawn so many times larger, and averaged at the end."""
DOT = 3
"""Side of a dot in pixels of the larger image."""
PLATE = 0.65
"""Opacity of the ground behind letters."""


class _Text(NamedTuple):
    """Letters with their upper left corner, pixels."""

    text: str
    corner: tuple[float, float]
    colour: Rgb
    size: int
    plate: bool


class Canvas:
    """An image to draw on; points are (x, y) in pixels, x to the right, y down.

    Letters lie above all shapes.
    """

    def __init__(self, width: int, height: int, ground: Rgb = GROUND_COLOUR) -> None:
        self.width, self.height = width, height
        self._image = Image.new("RGB", (width * FINER, height * FINER), ground)
        self._opaque = ImageDraw.Draw(self._image)
        self._mixing = ImageDraw.Draw(self._image, "RGBA")
        self._texts: list[_Text] = []

    def polygon(
        self, corners: np.ndarray, colour: Rgb, *, fill: float = 1.0, line_px: float = 0.0
    ) -> None:
        """Draw a (K, 2) polygon: its inside with opacity `fill`, its outline opaque."""
        points = _flat(corners)
        if fill > 0:
            self._pen(fill).polygon(points, fill=_with_opacity(colour, fill))
        if line_px > 0:
            # Beyond the first corner, so that it is joined as the others are.
            width = round(line_px * FINER)
            self._pen(1.0).line(points + points[:4], colour, width, joint="curve")

    def line(
        self, points: np.ndarray, colour: Rgb, width_px: float, *, opacity: float = 1.0
    ) -> None:
        """Draw a stroke through (K, 2) points."""
        if len(points) > 1:
            width, joint = max(1, round(width_px * FINER)), "curve" if len(points) > 2 else None
            self._pen(opacity).line(
                _flat(points), _with_opacity(colour, opacity), width, joint=joint
            )

    def dashes(self, points: np.ndarray, colour: Rgb, width_px: float, dash_px: float) -> None:
        """Draw a broken stroke through (K, 2) points; gaps are as long as dashes."""
        if len(points) < 2:
            return
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
        for start in np.arange(0.0, along[-1], 2 * dash_px):
            inner = points[(along > start) & (along < start + dash_px)]
            ends = [
                [np.interp(at, along, column) for column in points.T]
                for at in (start, min(start + dash_px, along[-1]))
            ]
            self.line(np.vstack([ends[:1], inner, ends[1:]]), colour, width_px)

    def circle(
        self, centre: np.ndarray, radius_px: float, colour: Rgb, *, line_px: float = 0.0
    ) -> None:
        """Draw a disc, or a ring if a line width is given."""
        box = _flat(np.stack([centre - radius_px, centre + radius_px]))
        if line_px > 0:
            self._pen(1.0).ellipse(box, outline=colour, width=round(line_px * FINER))
        else:
            self._pen(1.0).ellipse(box, fill=colour)

    def dots(self, points: np.ndarray, levels: np.ndarray, colours: np.ndarray) -> None:
        """Draw (N, 2) points as small squares; the highest level lies on top.

        levels: (N,) uint8 from 1 on, rows of the (L, 3) colours.
        """
        width, height = self._image.size
        x, y = np.floor(points.T * FINER - (DOT // 2)).astype(np.int32)
        inside = (x >= 0) & (x <= width - DOT) & (y >= 0) & (y <= height - DOT)
        cells, levels = (y * width + x)[inside], levels[inside]
        order = np.argsort(levels, kind="stable")
        corners = np.zeros((height, width), np.uint8)
        # Of those that share a pixel, the last one is drawn.
        corners.reshape(-1)[cells[order]] = levels[order]
        rows = corners.copy()
        for step in range(1, DOT):
            np.maximum(rows[step:], corners[:-step], out=rows[step:])
        top = rows.copy()
        for step in range(1, DOT):
            np.maximum(top[:, step:], rows[:, :-step], out=top[:, step:])
        layer = Image.fromarray(top)
        # A mask of bits is pasted faster than opacities.
        mask = layer.point([0] + [255] * 255, "1")
        layer.putpalette(colours.astype(int).ravel().tolist())
        self._image.paste(layer.convert("RGB"), mask=mask)

    def paste(self, pixels: np.ndarray, corner: np.ndarray, *, width: int, height: int) -> None:
        """Show an (H, W, 3) uint8 image, stretched; its upper left corner is at (x, y)."""
        # The larger image is averaged at the end.
        larger = Image.fromarray(pixels).resize(
            (width * FINER, height * FINER), Image.Resampling.NEAREST
        )
        x, y = (round(float(v) * FINER) for v in corner)
        self._image.paste(larger, (x, y))

    def text(
        self, text: str, corner: np.ndarray, colour: Rgb, size: int, *, plate: bool = False
    ) -> None:
        """Write with the upper left corner at (x, y). plate: on darkened ground."""
        self._texts.append(_Text(text, (float(corner[0]), float(corner[1])), colour, size, plate))

    def image(self) -> np.ndarray:
        """Return the (H, W, 3) uint8 image."""
        final = self._image.reduce(FINER)
        pen = ImageDraw.Draw(final, "RGBA")
        for text, corner, colour, size, plate in self._texts:
            x, y = round(corner[0]), round(corner[1])
            if plate:
                width, height = text_px(text, size)
                box = [x - 2, y - 1, x + width + 1, y + height]
                pen.rectangle(box, fill=_with_opacity(GROUND_COLOUR, PLATE))
            final.paste(colour, (x, y), _letters(text, size))
        return np.array(final)

    def _pen(self, opacity: float) -> ImageDraw.ImageDraw:
        """Return a pen; one that mixes colours is slower."""
        return self._opaque if opacity >= 1 else self._mixing


@lru_cache(maxsize=4096)
def text_px(text: str, size: int) -> tuple[int, int]:
    """Return width and height of a line of text in pixels."""
    return int(np.ceil(_font(size).getlength(text))), round(size * 1.25)


@lru_cache(maxsize=4096)
def _letters(text: str, size: int) -> Image.Image:
    """Return letters as opacities."""
    width, height = text_px(text, size)
    letters = Image.new("L", (width + 2, height + 2))
    ImageDraw.Draw(letters).text((0, 0), text, font=_font(size), fill=255)
    return letters


@lru_cache
def _font(size: int) -> Any:
    return ImageFont.load_default(size)


def _flat(points: np.ndarray) -> list[float]:
    """Return coordinates in the larger image, whose pixels have their centres at whole numbers."""
    flat: list[float] = (np.asarray(points, np.float64) * FINER - 0.5).ravel().tolist()
    return flat


def _with_opacity(colour: Rgb, opacity: float) -> tuple[int, ...]:
    return colour if opacity >= 1 else (*colour, round(255 * opacity))
