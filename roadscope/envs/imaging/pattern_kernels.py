"""What is drawn on the surfaces of things: wheels, lamps, plates, windows, seams."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.jit import compiled
from roadscope.envs.imaging.ground_kernels import grain, smooth_grain
from roadscope.envs.world.materials import Pattern

BODYWORK, COACH = int(Pattern.BODYWORK), int(Pattern.COACH)
FACADE, CLADDING = int(Pattern.FACADE), int(Pattern.CLADDING)
SIGN, PLASTER, METAL = int(Pattern.SIGN), int(Pattern.PLASTER), int(Pattern.METAL)
CLOTH, LEAVES, GLASS = int(Pattern.CLOTH), int(Pattern.LEAVES), int(Pattern.GLASS)
TRUCK, CAR = int(Category.TRUCK), int(Category.CAR)
STOREY_M, BAY_M = 3.0, 2.6
SLANT = 0.8
"""Rise over run of the normal of car windows, which prisms can only show as steps."""


class Looks(NamedTuple):
    """How P prisms look.

    colours: (P, 3) linear RGB. patterns: (P,). gloss: (P,).
    frames: (P, 8) of the thing a prism belongs to: middle x y, cosine and sine of its heading,
        half length and width, height, metres, and its category, -1 for scenery.
    lit: (P,) share of the sun that reaches it. seeds: (P,) a number in 0 to 1 per thing.
    """

    colours: np.ndarray
    patterns: np.ndarray
    gloss: np.ndarray
    frames: np.ndarray
    lit: np.ndarray
    seeds: np.ndarray


@compiled(borrowing=True)
def paint(
    looks: Looks,
    m: int,
    normal: tuple[float, float, float],
    place: tuple[float, float, float],
    lamps: bool,
    out: np.ndarray,
) -> None:
    """Write colour (3), gloss and own light (3) of a point on a prism into out (7,)."""
    pattern, frame = looks.patterns[m], looks.frames[m]
    x, y, z = place
    dx, dy = x - frame[0], y - frame[1]
    along, across = dx * frame[2] + dy * frame[3], dy * frame[2] - dx * frame[3]
    ahead = normal[0] * frame[2] + normal[1] * frame[3]
    aside = normal[1] * frame[2] - normal[0] * frame[3]
    out[0], out[1], out[2] = looks.colours[m, 0], looks.colours[m, 1], looks.colours[m, 2]
    out[3], out[4], out[5], out[6] = looks.gloss[m], 0.0, 0.0, 0.0
    if pattern in (BODYWORK, COACH):
        _bodywork(frame, looks.seeds[m], along, across, z, ahead, aside, lamps, out)
    elif pattern == FACADE:
        _facade(x, y, z, normal, looks.seeds[m], lamps, out)
    elif pattern == CLADDING:
        groove = 0.82 if (along / 0.4) % 1.0 < 0.08 and abs(aside) > 0.5 else 1.0
        _scale(out, groove * (0.92 + 0.08 * min(1.0, z)))
        if abs(ahead) > 0.5 and abs(across) < 0.02:
            _scale(out, 0.4)
    elif pattern == SIGN:
        _sign(frame, along, across, z, ahead, out)
    elif pattern == PLASTER:
        _scale(out, 0.8 + 0.3 * smooth_grain((x + y) / 0.4, z / 0.4))
    elif pattern == METAL:
        _scale(out, 0.85 + 0.3 * smooth_grain((x + y) / 0.9, z / 0.2))
    elif pattern == CLOTH:
        _scale(out, 0.8 + 0.35 * smooth_grain((along + across) / 0.12, z / 0.16))
    elif pattern == LEAVES:
        _scale(out, 0.45 + 1.1 * grain((x + 0.37 * y) / 0.11, (z + 0.73 * y) / 0.11))


@compiled(forceinline=True, borrowing=True)
def _scale(out: np.ndarray, factor: float) -> None:
    out[0], out[1], out[2] = out[0] * factor, out[1] * factor, out[2] * factor


@compiled(forceinline=True, borrowing=True)
def _set(out: np.ndarray, red: float, green: float, blue: float, gloss: float) -> None:
    out[0], out[1], out[2], out[3] = red, green, blue, gloss


@compiled(forceinline=True, borrowing=True)
def _shine(out: np.ndarray, red: float, green: float, blue: float) -> None:
    out[4], out[5], out[6] = red, green, blue


@compiled(borrowing=True)
def slanted(
    frame: np.ndarray, normal: tuple[float, float, float], x: float, y: float
) -> tuple[float, float, float]:
    """Return the normal of a sloping window where a stack of prisms has a step."""
    scale = 1.0 / np.sqrt(1.0 + SLANT * SLANT)
    if normal[2] == 0.0:
        return normal[0] * scale, normal[1] * scale, SLANT * scale
    dx, dy = x - frame[0], y - frame[1]
    along = (dx * frame[2] + dy * frame[3]) / max(frame[4], 0.1)
    across = (dy * frame[2] - dx * frame[3]) / max(frame[5], 0.1)
    if abs(along) * 2.2 > abs(across):
        sign = scale if along > 0.0 else -scale
        return sign * frame[2], sign * frame[3], SLANT * scale
    sign = scale if across > 0.0 else -scale
    return -sign * frame[3], sign * frame[2], SLANT * scale


@compiled(borrowing=True)
def _bodywork(
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
    half, wide, height, category = frame[4], frame[5], frame[6], frame[7]
    big = height > 2.2
    if abs(aside) > 0.6:
        _flank(half, height, big, along, z, category, out)
    elif ahead > 0.5:
        _front(wide, height, big, across, z, category, lamps, out)
    elif ahead < -0.5:
        _rear(wide, height, big, across, z, seed, lamps, out)


@compiled(borrowing=True)
def _flank(
    half: float, height: float, big: bool, along: float, z: float, category: float, out: np.ndarray
) -> None:
    radius = 0.48 if height > 2.8 else 0.33
    front, rear = half - (0.85 if half < 3.2 else 1.5), -half + (0.9 if half < 3.2 else 2.2)
    away_front = np.sqrt((along - front) ** 2 + (z - radius) ** 2)
    away_rear = np.sqrt((along - rear) ** 2 + (z - radius) ** 2)
    away = min(away_front, away_rear)
    if away < radius:
        if away < 0.62 * radius:
            spoke = 0.30 if away > 0.12 * radius else 0.12
            _set(out, spoke, spoke, 1.02 * spoke, 0.06)
        else:
            _set(out, 0.016, 0.016, 0.017, 0.0)
        return
    if away < 1.12 * radius:
        _set(out, 0.008, 0.008, 0.009, 0.0)
        return
    if z < 0.17 * height and not big:
        _scale(out, 0.45)
    seams = min(abs(along - 0.21 * half), min(abs(along + 0.30 * half), abs(along - 0.62 * half)))
    if half < 3.2 and seams < 0.012 and z < 0.66 * height:
        _scale(out, 0.35)
    handle = min(abs(along - 0.05 * half + 0.1), abs(along + 0.38 * half))
    if half < 3.2 and handle < 0.09 and abs(z - 0.56 * height) < 0.018:
        _scale(out, 0.5)
    if category == TRUCK and along > half - 1.7 and 0.52 * height < z < 0.74 * height:
        _set(out, 0.015, 0.018, 0.02, 0.10)


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
        level *= 0.55 if height < 2.8 else 1.6
    if 0.54 < side < 0.93 and 0.40 < level < 0.485:
        _set(out, 0.62, 0.64, 0.68, 0.25)
        if lamps:
            _shine(out, 9.0, 8.4, 7.0)
    elif side < 0.48 and 0.33 < level < 0.43:
        _set(out, 0.01, 0.01, 0.011, 0.05)
    elif abs(across) < 0.26 and abs(z - 0.31 * min(height, 1.7)) < 0.056:
        _plate(across, z, out)
    elif level < 0.22:
        _scale(out, 0.4)
    if category == TRUCK and 0.50 * height < z < 0.74 * height and side < 0.92:
        _set(out, 0.015, 0.018, 0.02, 0.10)


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
    if 0.60 + 0.1 * seed < side < 0.96 and low < level < low + 0.11:
        _set(out, 0.28, 0.012, 0.012, 0.12)
        if lamps:
            _shine(out, 2.2, 0.10, 0.08)
    elif abs(across) < 0.26 and abs(z - 0.36 * min(height, 1.8)) < 0.056:
        _plate(across, z, out)
    elif level < 0.24:
        _scale(out, 0.4)


@compiled(forceinline=True, borrowing=True)
def _plate(across: float, z: float, out: np.ndarray) -> None:
    ink = abs(across) < 0.21 and (across / 0.055) % 1.0 < 0.62 and (z / 0.025) % 1.0 < 0.85
    shade = 0.05 if ink else 0.70
    _set(out, shade, shade, shade, 0.0)


@compiled(borrowing=True)
def _facade(
    x: float,
    y: float,
    z: float,
    normal: tuple[float, float, float],
    seed: float,
    lamps: bool,
    out: np.ndarray,
) -> None:
    along = x * -normal[1] + y * normal[0]
    if normal[2] > 0.5:
        _set(out, 0.16, 0.14, 0.13, 0.0)
        return
    _scale(out, 0.85 + 0.2 * smooth_grain(along / 1.3, z / 1.3))
    bay, storey = along / BAY_M, z / STOREY_M
    u, v = bay - np.floor(bay), storey - np.floor(storey)
    if storey < 1.0 and seed > 0.6:
        if 0.06 < u < 0.94 and 0.12 < v < 0.80:
            _set(out, 0.03, 0.032, 0.035, 0.14)
            if lamps:
                _shine(out, 0.9, 0.75, 0.5)
        return
    if 0.24 < u < 0.76 and 0.30 < v < 0.82:
        if u < 0.28 or u > 0.72 or v < 0.34 or v > 0.78 or abs(u - 0.5) < 0.015:
            _set(out, 0.55, 0.55, 0.53, 0.02)
        else:
            _set(out, 0.03, 0.035, 0.04, 0.16)
            if lamps and grain(np.floor(bay) + 91.0 * seed, np.floor(storey)) > 0.62:
                _shine(out, 0.85, 0.65, 0.35)
    elif v < 0.03:
        _scale(out, 0.8)


@compiled(borrowing=True)
def _sign(
    frame: np.ndarray, along: float, across: float, z: float, ahead: float, out: np.ndarray
) -> None:
    side = max(frame[4], frame[5])
    level = abs(z - (frame[6] - side)) / side
    edge = max(abs(across) / side, level)
    if abs(ahead) < 0.5:
        _set(out, 0.3, 0.3, 0.3, 0.0)
    elif edge > 0.86:
        _set(out, 0.45, 0.02, 0.02, 0.0)
    elif abs(across) < 0.16 * side and level < 0.55:
        _set(out, 0.02, 0.02, 0.02, 0.0)
