"""Labels that never cover each other, and legends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from roadscope.core.palette import LABEL_COLOUR, Rgb
from roadscope.envs.drawing.canvas import Canvas, text_px

MARGIN_PX = 2.0
"""Least gap between labels."""
ROW_PX = 19
SWATCH_PX = np.array([24.0, 9.0])
"""Height of a row of a legend, and size of its symbols."""
TEXT_PX = 13
"""Size of letters, unless another is given."""
LEGEND_PX = 12


class LabelPlacer:
    """Writes labels on a canvas without overlap.

    reserved: (4,) low x, low y, high x, high y in pixels of each label so far.
    """

    def __init__(self, canvas: Canvas) -> None:
        self.canvas = canvas
        self.reserved: list[np.ndarray] = []

    def write(self, text: str, places: np.ndarray, colour: Rgb, size: int = TEXT_PX) -> bool:
        """Write at the first of (K, 2) upper left corners that is free; False if none is."""
        extent = np.array(text_px(text, size))
        lows, highs = places - MARGIN_PX, places + extent + MARGIN_PX
        free = (lows >= 0).all(axis=1) & (highs <= (self.canvas.width, self.canvas.height)).all(1)
        if self.reserved:
            others = np.array(self.reserved)
            is_separate = (lows[:, None] >= others[:, 2:]) | (highs[:, None] <= others[:, :2])
            free &= is_separate.any(axis=2).all(axis=1)
        if not free.any():
            return False
        first = int(np.argmax(free))
        self.reserved.append(np.concatenate([lows[first], highs[first]]))
        self.canvas.text(text, places[first], colour, size, plate=True)
        return True


def places_beside(corners: np.ndarray, text: str, size: int = TEXT_PX) -> np.ndarray:
    """Return (8, 2) corners for a label around (K, 2) corners of a shape, the best ones first."""
    (width, height), low, high = text_px(text, size), corners.min(axis=0), corners.max(axis=0)
    middle = (low + high) / 2
    right, left = high[0] + 4, low[0] - 4 - width
    below, above, level = high[1] + 4, low[1] - 4 - height, middle[1] - height / 2
    over = middle[0] - width / 2
    return np.array(
        [
            [right, level],
            [left, level],
            [right, above],
            [left, above],
            [right, below],
            [left, below],
            [over, above],
            [over, below],
        ]
    )


class LegendRow(NamedTuple):
    """A row of a legend. draw: draws the symbol into the box of (2,) low and (2,) high pixels."""

    text: str
    draw: Callable[[Canvas, np.ndarray, np.ndarray], None]


def legend_of(rows: Sequence[LegendRow], width: int) -> np.ndarray:
    """Return a legend as an image, (H, width, 3) uint8."""
    canvas = Canvas(width, _lines(rows, width) * ROW_PX)
    draw_legend(canvas, rows, np.zeros(2), width)
    return canvas.image()


def draw_legend(canvas: Canvas, rows: Sequence[LegendRow], low: np.ndarray, width: int) -> None:
    """Draw rows in columns, from an upper left corner on."""
    lines = _lines(rows, width)
    columns = -(-len(rows) // lines)
    for number, row in enumerate(rows):
        column, line = divmod(number, lines)
        corner = low + np.array([column * (width // columns), line * ROW_PX])
        start = corner + np.array([0, (ROW_PX - SWATCH_PX[1]) / 2])
        row.draw(canvas, start, start + SWATCH_PX)
        canvas.text(row.text, corner + np.array([SWATCH_PX[0] + 8, 2]), LABEL_COLOUR, LEGEND_PX)


def _lines(rows: Sequence[LegendRow], width: int) -> int:
    """Return the lines of a legend with as many columns as fit side by side."""
    widest = max(text_px(row.text, LEGEND_PX)[0] for row in rows) + SWATCH_PX[0] + 16
    return -(-len(rows) // max(1, int(width // widest)))
