"""A corridor around the inside of a building, for Zhang 2022's experiments on the floor of one.

The paper gives neither width nor furniture of its corridor; those here are of an ordinary office
building, fixed before anything was measured. World frame: x and y along the sides, the middle line
of the corridor runs counter-clockwise around a rectangle whose first corner is the origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.envs.world.prisms import Prisms, placed, rectangle

LENGTH_M, DEPTH_M = 26.0, 14.0
"""Sides of the rectangle that the middle line goes around."""
WIDTH_M, CEILING_M = 3.0, 2.8
WALL_M = 0.2
PAINT, TILES, FRAME, WOOD = 0.6, 0.7, 0.3, 0.4
"""Reflectivities of walls, ceiling, door frames and furniture."""
TURN_M = 1.0
"""Radius on which the middle line goes around corners."""

Box = tuple[float, float, float, float, float, float, float]
"""Centre x and y, length, width, bottom, top, metres, and reflectivity."""


def building(seed: int) -> Prisms:
    """Return walls, ceiling, door frames and furniture; the seed places the last two."""
    rng = np.random.default_rng(seed)
    boxes = [*_walls(), *_ceiling()]
    for side in range(4):
        boxes += _along(side, rng)
    return Prisms.join([_prism(box, number) for number, box in enumerate(boxes)])


def _walls() -> list[Box]:
    boxes: list[Box] = []
    for outward in (1, -1):
        reach = outward * (WIDTH_M + WALL_M) / 2
        length, depth = LENGTH_M + 2 * reach + WALL_M, DEPTH_M + 2 * reach + WALL_M
        for low in (True, False):
            y = -reach if low else DEPTH_M + reach
            x = -reach if low else LENGTH_M + reach
            boxes.append((LENGTH_M / 2, y, length, WALL_M, 0.0, CEILING_M, PAINT))
            boxes.append((x, DEPTH_M / 2, WALL_M, depth, 0.0, CEILING_M, PAINT))
    return boxes


def _ceiling() -> list[Box]:
    heights = CEILING_M, CEILING_M + WALL_M
    across = [
        (LENGTH_M / 2, y, LENGTH_M + WIDTH_M, WIDTH_M, *heights, TILES) for y in (0.0, DEPTH_M)
    ]
    beside = [
        (x, DEPTH_M / 2, WIDTH_M, DEPTH_M - WIDTH_M, *heights, TILES) for x in (0.0, LENGTH_M)
    ]
    return [*across, *beside]


def _along(side: int, rng: np.random.Generator) -> list[Box]:
    """Return what stands along both walls of a side: door frames, and furniture between them."""
    boxes: list[Box] = []
    length = LENGTH_M if side % 2 == 0 else DEPTH_M
    for wall in (-1, 1):
        at = rng.uniform(2.0, 4.0)
        while at < length - 2.0:
            depth, across, height = 0.08, 0.12, 2.2
            frame = across, depth, height
            boxes += [_beside(side, wall, at + post, frame, FRAME) for post in (-0.5, 0.5)]
            if rng.random() < 0.4 and at + 2.2 < length - 2.0:
                size = rng.uniform(0.5, 1.2), 0.25, rng.uniform(0.8, 1.9)
                boxes.append(_beside(side, wall, at + 1.6, size, WOOD))
            at += rng.uniform(3.0, 5.0)
    return boxes


def _beside(
    side: int, wall: int, along_m: float, size: tuple[float, float, float], reflectivity: float
) -> Box:
    """Return a box against a wall; wall: 1 on the left of who goes around, -1 on the right."""
    length, depth, height = size
    (x, y), (ahead_x, ahead_y) = corner(side), direction(side)
    across = wall * (WIDTH_M - depth) / 2
    centre = x + along_m * ahead_x - across * ahead_y, y + along_m * ahead_y + across * ahead_x
    sides = (length, depth) if side % 2 == 0 else (depth, length)
    return (*centre, *sides, 0.0, height, reflectivity)


def corner(side: int) -> tuple[float, float]:
    """Return where a side of the middle line begins, metres."""
    return ((0.0, 0.0), (LENGTH_M, 0.0), (LENGTH_M, DEPTH_M), (0.0, DEPTH_M))[side % 4]


def direction(side: int) -> tuple[float, float]:
    """Return the way a side of the middle line runs."""
    return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[side % 4]


def _prism(box: Box, number: int) -> Prisms:
    x, y, length, width, bottom, top, reflectivity = box
    outline = placed(rectangle(length, width), np.array([[x, y]]), np.zeros(1))[0]
    return Prisms.of(outline, bottom, top, owner=-2 - number, reflectivity=reflectivity)


@dataclass(frozen=True, slots=True)
class Way:
    """The middle line with round corners, as a function of the way gone from the first corner."""

    turn_m: float = TURN_M

    @property
    def length_m(self) -> float:
        """Once around."""
        return 2 * (LENGTH_M + DEPTH_M) - 8 * self.turn_m + 2 * np.pi * self.turn_m

    def at(self, gone_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (T, 2) places and (T,) unwrapped yaws of (T,) metres, from the end of a turn."""
        pieces = [(side - 2 * self.turn_m, np.pi / 2 * self.turn_m)
                  for side in (LENGTH_M, DEPTH_M, LENGTH_M, DEPTH_M)]  # fmt: skip
        rounds, rest = np.divmod(gone_m, self.length_m)
        places, yaws = np.empty((len(gone_m), 2)), np.empty(len(gone_m))
        begin = 0.0
        for side, (straight, bend) in enumerate(pieces):
            here = (rest >= begin) & (rest < begin + straight + bend)
            along = np.minimum(rest[here] - begin, straight)
            turned = (rest[here] - begin - along) / self.turn_m
            ahead, left = np.array(direction(side)), np.array(direction(side + 1))
            arc = self.turn_m * (
                np.sin(turned)[:, None] * ahead + (1 - np.cos(turned))[:, None] * left
            )
            start = np.array(corner(side)) + self.turn_m * ahead
            places[here] = start + along[:, None] * ahead + arc
            yaws[here] = side * np.pi / 2 + turned
            begin += straight + bend
        return places, yaws + 2 * np.pi * rounds
