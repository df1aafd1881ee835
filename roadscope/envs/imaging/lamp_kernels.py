"""Light of lamps at night: a map of the ground around, and the own headlights."""

from __future__ import annotations

import numpy as np

from roadscope.core import Category
from roadscope.core.jit import compiled
from roadscope.envs.imaging.face_kernels import Lens, Solids

POOL_SIDE, POOL_M = 256, 0.75
"""Cells along a side of the map and their edge."""
LANTERN_LIGHT, HEADLIGHT = 0.85, 1.3
"""Light below a lantern 6 m up, and 6 m ahead of headlights."""
HEADLIGHT_HEIGHT_M = 0.65
LONGEST_M = 45.0
_PEDESTRIAN, _CYCLIST = int(Category.PEDESTRIAN), int(Category.CYCLIST)


@compiled(borrowing=True)
def light_pools(
    solids: Solids,
    lanterns: np.ndarray,
    frames: np.ndarray,
    corner: tuple[float, float],
    pools: np.ndarray,
) -> None:
    """Fill pools (side, side, 2) float32 with the light of street lamps and of headlights.

    lanterns: (P,) bool. frames: (P, 8), see `pattern_kernels.Looks`. corner: x y of the first
    cell's corner. A vehicle's first prism bears its headlights.
    """
    pools[:] = 0.0
    before = -1
    for m in range(len(lanterns)):
        if lanterns[m]:
            _lantern(frames[m], solids.bottoms[m], corner, pools)
        owner = solids.owners[m]
        kind = frames[m, 7]
        first = owner >= 0 and owner != before and solids.corners[m] > 0
        if first and kind not in (_PEDESTRIAN, _CYCLIST):
            _headlights(frames[m], corner, pools)
        before = owner


@compiled(borrowing=True)
def _lantern(
    frame: np.ndarray, height: float, corner: tuple[float, float], pools: np.ndarray
) -> None:
    x, y = (frame[0] - corner[0]) / POOL_M, (frame[1] - corner[1]) / POOL_M
    reach = 22.0 / POOL_M
    for i in range(max(0, int(y - reach)), min(POOL_SIDE, int(y + reach))):
        for j in range(max(0, int(x - reach)), min(POOL_SIDE, int(x + reach))):
            dx, dy = (j + 0.5 - x) * POOL_M, (i + 0.5 - y) * POOL_M
            square = dx * dx + dy * dy
            away = square + height * height
            edge = max(0.0, 1.0 - square / 484.0)
            pools[i, j, 0] += LANTERN_LIGHT * edge * 36.0 * height / (away * np.sqrt(away))


@compiled(borrowing=True)
def _headlights(frame: np.ndarray, corner: tuple[float, float], pools: np.ndarray) -> None:
    cosine, sine = frame[2], frame[3]
    x, y = frame[0] + frame[4] * cosine, frame[1] + frame[4] * sine
    column, row = (x - corner[0]) / POOL_M, (y - corner[1]) / POOL_M
    reach = LONGEST_M / POOL_M
    for i in range(max(0, int(row - reach)), min(POOL_SIDE, int(row + reach))):
        for j in range(max(0, int(column - reach)), min(POOL_SIDE, int(column + reach))):
            dx, dy = (j + 0.5 - column) * POOL_M, (i + 0.5 - row) * POOL_M
            along, across = dx * cosine + dy * sine, dy * cosine - dx * sine
            if along > 0.0:
                pools[i, j, 1] += beam(along, across)


@compiled(forceinline=True, borrowing=True)
def beam(along: float, across: float) -> float:
    """Light of headlights on the ground ahead of them: a dipped beam."""
    wide = 0.30 * along + 1.0
    side = across / wide
    value: float = (
        HEADLIGHT * np.exp(-side * side - along / 15.0) * along / (along + 2.5)
        if along < LONGEST_M
        else 0.0
    )
    return value


@compiled(forceinline=True, borrowing=True)
def pools_at(
    pools: np.ndarray, corner: tuple[float, float], x: float, y: float
) -> tuple[float, float]:
    """Light of street lamps and of headlights at a place, linear between the cells of the map."""
    u, v = (x - corner[0]) / POOL_M - 0.5, (y - corner[1]) / POOL_M - 0.5
    if not (0.0 <= u < POOL_SIDE - 1.0 and 0.0 <= v < POOL_SIDE - 1.0):
        return 0.0, 0.0
    j, i = int(u), int(v)
    u, v = u - j, v - i
    return _between(pools, i, j, 0, u, v), _between(pools, i, j, 1, u, v)


@compiled(forceinline=True, borrowing=True)
def _between(pools: np.ndarray, i: int, j: int, kind: int, u: float, v: float) -> float:
    high = pools[i, j, kind] + u * (pools[i, j + 1, kind] - pools[i, j, kind])
    low = pools[i + 1, j, kind] + u * (pools[i + 1, j + 1, kind] - pools[i + 1, j, kind])
    value: float = high + v * (low - high)
    return value


@compiled(borrowing=True)
def own_beam(lens: Lens, x: float, y: float, z: float, upright: bool) -> float:
    """Light of the headlights of the vehicle that bears the camera, 1 m ahead of it."""
    ax, ay = lens.rotation[2, 0], lens.rotation[2, 1]
    size = np.sqrt(ax * ax + ay * ay)
    if size < 1e-6:
        return 0.0
    ax, ay = ax / size, ay / size
    dx, dy = x - lens.origin[0], y - lens.origin[1]
    along, across = dx * ax + dy * ay - 1.0, dy * ax - dx * ay
    if along <= 0.0:
        return 0.0
    light = beam(along, across)
    if upright:
        # A wall faces the lamps, the ground hardly; above the beam's edge little light is left.
        light *= min(2.5, along / (4.0 * HEADLIGHT_HEIGHT_M))
        above = (z - HEADLIGHT_HEIGHT_M) / along
        light *= min(1.0, max(0.10, 1.0 - 25.0 * (above - 0.005)))
    return light
