"""What is drawn on buildings, on boxes of trucks, and on signs."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.imaging.noise_kernels import cell_of, grain

STOREY_M, BAY_M = 3.0, 2.6
CORNICE_M = 0.45


@compiled(forceinline=True, borrowing=True)
def facade(
    noise: np.ndarray,
    way: float,
    length: float,
    z: float,
    span: np.ndarray,
    up: float,
    seed: float,
    lamps: bool,
    out: np.ndarray,
) -> None:
    """Storeys of windows, as many as are whole; shops below in some houses; a cornice.

    way: along the wall from where it begins, length of the wall, metres.
    """
    if up > 0.5:
        out[0], out[1], out[2] = 0.15, 0.135, 0.125
        return
    stain = 0.86 + 0.2 * cell_of(noise, (way + 60.0 * seed) * 9.0, z * 6.0)
    out[0], out[1], out[2] = out[0] * stain, out[1] * stain, out[2] * stain
    bays = np.floor(length / BAY_M)
    high = span[1] - span[0] - CORNICE_M
    storeys = np.floor(high / STOREY_M + 0.4)
    if bays < 1.0 or storeys < 1.0 or z > span[1] - CORNICE_M:
        _scale(out, 1.08 if z > span[1] - 0.25 else 0.97)
        return
    bay, storey = way * (bays / length), (z - span[0]) * (storeys / high)
    u, v = bay - np.floor(bay), storey - np.floor(storey)
    if span[0] > 1.0:
        storey += np.floor(span[0] / STOREY_M)
    if storey < 1.0 and seed > 0.55:
        _shop(bay, u, v, seed, lamps, out)
        return
    if storey < 1.0 and np.floor(bay) == np.floor(bays * (0.3 + 0.5 * seed)):
        _door(u, v, seed, out)
        return
    half = 0.20 + 0.14 * seed
    low = 0.30 if seed < 0.5 else 0.20
    off = abs(u - 0.5)
    if off < half and low < v < 0.82:
        _window(bay, storey, u, v, half, low, seed, lamps, out)
    elif off < half + 0.02 and low - 0.04 < v <= low:
        _scale(out, 1.15)
    elif v < 0.03 and seed < 0.7:
        _scale(out, 0.85)


@compiled(forceinline=True, borrowing=True)
def _scale(out: np.ndarray, factor: float) -> None:
    out[0], out[1], out[2] = out[0] * factor, out[1] * factor, out[2] * factor


@compiled(borrowing=True)
def _window(
    bay: float,
    storey: float,
    u: float,
    v: float,
    half: float,
    low: float,
    seed: float,
    lamps: bool,
    out: np.ndarray,
) -> None:
    off = abs(u - 0.5)
    if off > half - 0.025 or v < low + 0.025 or v > 0.795 or off < 0.011:
        shade = 0.5 if seed < 0.7 else 0.10
        out[0], out[1], out[2], out[3] = shade, shade, 0.97 * shade, 0.02
        return
    chance = grain(np.floor(bay) + 911.0 * seed, np.floor(storey))
    # Curtains at the sides of some windows, blinds half down in others.
    curtain = chance < 0.35 and off > half * 0.55
    blind = 0.35 <= chance < 0.5 and v > 0.55
    if curtain or blind:
        out[0], out[1], out[2], out[3] = 0.30, 0.29, 0.26, 0.08
    else:
        out[0], out[1], out[2], out[3] = 0.022, 0.026, 0.030, 0.15
    if lamps and chance > 0.55:
        dim = 0.35 + 0.65 * grain(np.floor(bay) + 91.0 * seed, np.floor(storey) + 7.0)
        dim *= 0.75 + 0.5 * (v - low)
        out[4], out[5], out[6] = 0.75 * dim, 0.52 * dim, 0.26 * dim


@compiled(borrowing=True)
def _shop(bay: float, u: float, v: float, seed: float, lamps: bool, out: np.ndarray) -> None:
    if 0.05 < u < 0.95 and 0.10 < v < 0.74:
        shelf = 0.5 + 0.5 * grain(bay * 6.0, v * 9.0)
        out[0], out[1], out[2], out[3] = 0.05 * shelf, 0.045 * shelf, 0.04 * shelf, 0.12
        if lamps:
            out[4], out[5], out[6] = 0.75 * shelf, 0.62 * shelf, 0.42 * shelf
    elif 0.77 < v < 0.95:
        board = grain(seed * 977.0, 3.0)
        out[0], out[1] = 0.05 + 0.3 * board, 0.08 + 0.15 * (1.0 - board)
        out[2] = 0.06 + 0.25 * grain(seed * 977.0, 5.0)
        letters = 0.80 < v < 0.92 and 0.2 < u < 0.8 and grain(u * 22.0, seed * 50.0) > 0.45
        if letters:
            out[0], out[1], out[2] = 0.6, 0.58, 0.5
            if lamps:
                out[4], out[5], out[6] = 0.6, 0.55, 0.4


@compiled(borrowing=True)
def _door(u: float, v: float, seed: float, out: np.ndarray) -> None:
    if 0.28 < u < 0.72 and v < 0.72:
        if 0.33 < u < 0.67 and v < 0.68:
            tone = 0.5 + 0.5 * seed
            out[0], out[1], out[2] = 0.12 * tone, 0.06 * tone, 0.035 * tone
            if v > 0.5:
                out[0], out[1], out[2], out[3] = 0.03, 0.033, 0.035, 0.14
        else:
            out[0], out[1], out[2] = 0.42, 0.41, 0.38


@compiled(borrowing=True)
def cladding(
    along: float,
    across: float,
    z: float,
    ahead: float,
    aside: float,
    frame: np.ndarray,
    lamps: bool,
    out: np.ndarray,
) -> None:
    """Ribs and a stripe on the sides of a truck's box, doors and lamps at its rear."""
    _scale(out, 0.90 + 0.10 * min(1.0, 0.4 * z))
    if abs(aside) > 0.5:
        if (along / 0.6) % 1.0 < 0.05:
            _scale(out, 0.85)
        if 0.52 < z / frame[6] < 0.60:
            _scale(out, 0.45)
    elif ahead < -0.5:
        side = abs(across) / max(frame[5], 0.1)
        if abs(across) < 0.02 or abs(side - 0.93) < 0.015:
            _scale(out, 0.4)
        elif abs(abs(across) - 0.35) < 0.02 or abs(abs(across) - 0.6) < 0.02:
            _scale(out, 0.7)
        low = 0.36 * frame[6]
        if side > 0.72 and low < z < low + 0.16:
            out[0], out[1], out[2], out[3] = 0.28, 0.012, 0.012, 0.10
            if lamps:
                out[4], out[5], out[6] = 2.0, 0.08, 0.06
        elif z < low + 0.02:
            pale = (across / 0.3) % 1.0 < 0.5
            out[0], out[1] = 0.5 if pale else 0.4, 0.5 if pale else 0.02
            out[2] = out[1]


@compiled(borrowing=True)
def sign(
    way: float, length: float, span: np.ndarray, z: float, ahead: float, out: np.ndarray
) -> None:
    """Draw some kinds of plates in front, grey metal behind; way along the plate, metres."""
    side = 0.5 * (span[1] - span[0])
    across = way - 0.5 * length
    level = abs(z - span[0] - side) / side
    edge = max(abs(across) / side, level)
    if length < 0.2 or ahead > -0.5:
        out[0], out[1], out[2] = 0.28, 0.28, 0.29
        return
    pale = out[0] > 0.5 and out[1] > 0.5
    if edge > 0.86:
        if pale:
            out[0], out[1], out[2] = 0.45, 0.02, 0.02
        else:
            out[0], out[1], out[2] = 0.6, 0.6, 0.6
    elif pale:
        if abs(across) < 0.16 * side and level < 0.5:
            out[0], out[1], out[2] = 0.02, 0.02, 0.02
    elif level < 0.10 and abs(across) < 0.6 * side:
        out[0], out[1], out[2] = 0.62, 0.62, 0.62
