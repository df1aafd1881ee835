"""Patterns on vehicles: bodywork, wheels, lamps, plates, windows.

`out` is as in `shading.shade_row`. `frame` is a row of `Appearance.frames`.
"""

from __future__ import annotations

import numpy as np

from roadscope.core import Category
from roadscope.core.jit import compiled
from roadscope.envs.imaging.raster import Vector

TRUCK, CAR, BUS, VAN = (
    int(Category.TRUCK),
    int(Category.CAR),
    int(Category.BUS),
    int(Category.VAN),
)
SLANT = 0.8
"""Slope of the normal of a car's windows. Prisms approximate sloping windows by steps."""


@compiled(forceinline=True, borrowing=True)
def _scale(out: np.ndarray, factor: float) -> None:
    out[0], out[1], out[2] = out[0] * factor, out[1] * factor, out[2] * factor


@compiled(forceinline=True, borrowing=True)
def _set(out: np.ndarray, red: float, green: float, blue: float, gloss: float) -> None:
    out[0], out[1], out[2], out[3] = red, green, blue, gloss


@compiled(forceinline=True, borrowing=True)
def _emit(out: np.ndarray, red: float, green: float, blue: float) -> None:
    out[4], out[5], out[6] = red, green, blue


@compiled(forceinline=True, borrowing=True)
def _pane(out: np.ndarray) -> None:
    """Draw window glass: dark, and it mirrors."""
    out[0], out[1], out[2], out[3] = 0.015, 0.018, 0.02, 0.10


@compiled(borrowing=True)
def slanted(frame: np.ndarray, normal: Vector, x: float, y: float) -> Vector:
    """Return the normal of a sloping window where a stack of prisms has a step."""
    scale = 1.0 / np.sqrt(1.0 + SLANT * SLANT)
    if normal.z == 0.0:
        return Vector(normal.x * scale, normal.y * scale, SLANT * scale)
    dx, dy = x - frame[0], y - frame[1]
    along = (dx * frame[2] + dy * frame[3]) / max(frame[4], 0.1)
    across = (dy * frame[2] - dx * frame[3]) / max(frame[5], 0.1)
    if abs(along) * 2.2 > abs(across):
        sign = scale if along > 0.0 else -scale
        return Vector(sign * frame[2], sign * frame[3], SLANT * scale)
    sign = scale if across > 0.0 else -scale
    return Vector(-sign * frame[3], sign * frame[2], SLANT * scale)


@compiled(borrowing=True)
def glass(
    paint: np.ndarray,
    frame: np.ndarray,
    along_pane: float,
    length: float,
    along: float,
    z: float,
    ahead: float,
    aside: float,
    out: np.ndarray,
) -> None:
    """Draw windows; on flanks also the pillars between them, in the colour of the body."""
    if abs(aside) < 0.85:
        return
    end = min(along_pane, length - along_pane)
    pillar = False
    if frame[7] == BUS:
        gap = (along_pane / 1.55) % 1.0
        pillar = gap < 0.06 or end < 0.10
        if frame[6] > 0.0 and abs(z / frame[6] - 0.70) < 0.006:
            pillar = True
    elif frame[7] == VAN:
        pillar = end < 0.06
    else:
        share = along / max(frame[4], 0.1)
        pillar = end < 0.045 or abs(share + 0.14) < 0.018
    if pillar:
        dim = 0.25 if frame[7] == BUS else 0.8
        _set(out, dim * paint[0], dim * paint[1], dim * paint[2], 0.03)


@compiled(borrowing=True)
def bodywork(
    frame: np.ndarray,
    seed: float,
    along: float,
    across: float,
    z: float,
    ahead: float,
    aside: float,
    lamps: bool,
    out: np.ndarray,
) -> None:
    """Draw flanks, front or rear of a body; roofs and bonnets stay plain."""
    half, wide, height, category = frame[4], frame[5], frame[6], frame[7]
    big = height > 2.2
    if abs(aside) > 0.6:
        _flank(half, height, big, along, z, category, out)
    elif ahead > 0.5:
        _front(wide, height, big, across, z, category, lamps, out)
    elif ahead < -0.5:
        _rear(wide, height, big, across, z, seed, lamps, out)
    elif z < 0.9 * height and (abs(across) > 0.93 * wide or abs(along) > 0.95 * half):
        # Ledges between the steps of a body stand for rounded edges: they mirror no horizon.
        _scale(out, 0.75)
        out[3] = 0.0


@compiled(forceinline=True, borrowing=True)
def axles(half: float, height: float) -> tuple[float, float, float]:
    """Return the positions of the front and rear axle along a body, and the wheels' radius."""
    radius = 0.48 if height > 2.8 else 0.33
    front, rear = half - (0.85 if half < 3.2 else 1.5), -half + (0.9 if half < 3.2 else 2.2)
    return front, rear, radius


@compiled(borrowing=True)
def wheel(away: float, radius: float, angle: float, out: np.ndarray) -> None:
    """Draw tyre, rim or hub at a distance `away` from the axle, metres; angle: radians."""
    share = away / radius
    if share > 0.66:
        _set(out, 0.014, 0.014, 0.015, 0.0)
    elif share > 0.60:
        _set(out, 0.30, 0.30, 0.31, 0.05)
    elif share > 0.16:
        spoke = 0.26 if (angle * 5.0 / (2.0 * np.pi)) % 1.0 < 0.5 else 0.05
        _set(out, spoke, spoke, 1.02 * spoke, 0.05)
    else:
        _set(out, 0.16, 0.16, 0.165, 0.05)


@compiled(borrowing=True)
def _flank(
    half: float, height: float, big: bool, along: float, z: float, category: float, out: np.ndarray
) -> None:
    front, rear, radius = axles(half, height)
    nearest = front if abs(along - front) < abs(along - rear) else rear
    dx, dz = along - nearest, z - radius
    away = np.sqrt(dx * dx + dz * dz)
    if away < radius:
        wheel(away, radius, np.arctan2(dz, dx) if away < 0.6 * radius else 0.0, out)
        return
    if away < 1.10 * radius:
        _set(out, 0.008, 0.008, 0.009, 0.0)
        return
    if z < 0.17 * height and not big:
        _scale(out, 0.5)
    if half < 3.2:
        _doors(half, height, along, z, out)
    if category == TRUCK and along > half - 1.7 and 0.52 * height < z < 0.74 * height:
        if along < half - 0.25:
            _pane(out)
    elif category == VAN and 0.30 * half < along < 0.62 * half and 0.58 < z / height < 0.82:
        _pane(out)


@compiled(borrowing=True)
def _doors(half: float, height: float, along: float, z: float, out: np.ndarray) -> None:
    seams = min(abs(along - 0.21 * half), min(abs(along + 0.30 * half), abs(along - 0.62 * half)))
    if seams < 0.010 and z < 0.64 * height:
        _scale(out, 0.5)
    handle = min(abs(along - 0.05 * half + 0.1), abs(along + 0.38 * half))
    if handle < 0.09 and abs(z - 0.56 * height) < 0.018:
        _scale(out, 0.6)
    if abs(z - 0.47 * height) < 0.012:
        _scale(out, 1.12)


@compiled(borrowing=True)
def _front(
    wide: float,
    height: float,
    big: bool,
    across: float,
    z: float,
    category: float,
    lamps: bool,
    out: np.ndarray,
) -> None:
    side, level = abs(across) / wide, z / height
    if big:
        level *= 1.5 if height < 2.8 else 1.6
    if category == BUS and z > 0.82 * height:
        if side < 0.7 and 0.86 * height < z < 0.96 * height:
            lit = (across / 0.09) % 1.0 < 0.6 and side < 0.55
            _set(out, 0.02, 0.02, 0.02, 0.05)
            if lit:
                _emit(out, 0.75, 0.42, 0.05)
        return
    if 0.56 < side < 0.93 and 0.395 < level < 0.485:
        _set(out, 0.55, 0.57, 0.60, 0.25)
        if lamps:
            _emit(out, 9.0, 8.4, 7.0)
    elif side < 0.50 and 0.33 < level < 0.43:
        bar = 0.012 if (z / 0.03) % 1.0 < 0.6 else 0.04
        _set(out, bar, bar, bar, 0.05)
    elif abs(across) < 0.26 and abs(z - 0.31 * min(height, 1.7)) < 0.056:
        _plate(across, z, out)
    elif level < 0.22:
        _scale(out, 0.4)
    if category == TRUCK and 0.50 * height < z < 0.74 * height and side < 0.92:
        _pane(out)


@compiled(borrowing=True)
def _rear(
    wide: float,
    height: float,
    big: bool,
    across: float,
    z: float,
    seed: float,
    lamps: bool,
    out: np.ndarray,
) -> None:
    side, level = abs(across) / wide, z / height
    if big:
        level *= 0.9
    low = 0.40 + 0.06 * seed
    if 0.62 + 0.1 * seed < side < 0.97 and low < level < low + 0.10:
        _set(out, 0.28, 0.012, 0.012, 0.12)
        if side < 0.74 + 0.06 * seed and level < low + 0.04:
            _set(out, 0.5, 0.48, 0.45, 0.12)
        elif lamps:
            _emit(out, 2.2, 0.10, 0.08)
    elif abs(across) < 0.26 and abs(z - 0.36 * min(height, 1.8)) < 0.056:
        _plate(across, z, out)
    elif level < 0.24:
        _scale(out, 0.35)
    elif big and side < 0.8 and 0.58 < z / height < 0.80 and height < 2.9:
        _pane(out)
        if abs(across) < 0.04:
            _set(out, 0.1, 0.1, 0.1, 0.0)


@compiled(forceinline=True, borrowing=True)
def _plate(across: float, z: float, out: np.ndarray) -> None:
    letter = (across + 0.3) / 0.06
    gap = letter - np.floor(letter)
    ink = abs(across) < 0.20 and 0.2 < gap < 0.72 and (z / 0.03) % 1.0 < 0.8
    shade = 0.12 if ink else 0.62
    _set(out, shade, shade, shade if across < 0.215 else 2.5 * shade, 0.0)
