"""Patterns on surfaces: facades, signs, clothes, leaves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.jit import compiled
from roadscope.envs.imaging.noise import blend_of, cell_of, grain
from roadscope.envs.imaging.raster import Solids, Vector
from roadscope.envs.imaging.vehicle_patterns import bodywork, glass
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.world.materials import MATERIALS, Pattern

# --------------------------------------------------------------------------------------------------
# Patterns of buildings, boxes of trucks, and signs.

FLOOR_M, BAY_M = 3.0, 2.6
CORNICE_M = 0.45
"""Height of a floor, width of a bay, height of the cornice; chosen by hand."""


@compiled(forceinline=True, borrowing=True)
def facade(
    noise: np.ndarray,
    along_wall: float,
    length: float,
    z: float,
    span: np.ndarray,
    up: float,
    seed: float,
    lamps: bool,
    out: np.ndarray,
) -> None:
    """Draw whole floors of windows, shops on the ground floor of some houses, and a cornice.

    along_wall: distance along the wall from its start, metres; length: of the wall.
    """
    if up > 0.5:
        out[0], out[1], out[2] = 0.15, 0.135, 0.125
        return
    stain = 0.86 + 0.2 * cell_of(noise, (along_wall + 60.0 * seed) * 9.0, z * 6.0)
    out[0], out[1], out[2] = out[0] * stain, out[1] * stain, out[2] * stain
    bays = np.floor(length / BAY_M)
    high = span[1] - span[0] - CORNICE_M
    floors = np.floor(high / FLOOR_M + 0.4)
    if bays < 1.0 or floors < 1.0 or z > span[1] - CORNICE_M:
        _scale(out, 1.08 if z > span[1] - 0.25 else 0.97)
        return
    bay, floor_number = along_wall * (bays / length), (z - span[0]) * (floors / high)
    u, v = bay - np.floor(bay), floor_number - np.floor(floor_number)
    if span[0] > 1.0:
        floor_number += np.floor(span[0] / FLOOR_M)
    if floor_number < 1.0 and seed > 0.55:
        _shop(bay, u, v, seed, lamps, out)
        return
    if floor_number < 1.0 and np.floor(bay) == np.floor(bays * (0.3 + 0.5 * seed)):
        _door(u, v, seed, out)
        return
    half = 0.20 + 0.14 * seed
    low = 0.30 if seed < 0.5 else 0.20
    off = abs(u - 0.5)
    if off < half and low < v < 0.82:
        _window(bay, floor_number, u, v, half, low, seed, lamps, out)
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
    floor_number: float,
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
    chance = grain(np.floor(bay) + 911.0 * seed, np.floor(floor_number))
    # Curtains at the sides of some windows, blinds half down in others.
    curtain = chance < 0.35 and off > half * 0.55
    blind = 0.35 <= chance < 0.5 and v > 0.55
    if curtain or blind:
        out[0], out[1], out[2], out[3] = 0.30, 0.29, 0.26, 0.08
    else:
        out[0], out[1], out[2], out[3] = 0.022, 0.026, 0.030, 0.15
    if lamps and chance > 0.55:
        dim = 0.35 + 0.65 * grain(np.floor(bay) + 91.0 * seed, np.floor(floor_number) + 7.0)
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
    """Draw ribs and a stripe on the sides of a truck's box, doors and lamps at its rear."""
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
    along_plate: float, length: float, span: np.ndarray, z: float, ahead: float, out: np.ndarray
) -> None:
    """Draw a sign on the front of a plate, grey metal on its back; along_plate in metres."""
    side = 0.5 * (span[1] - span[0])
    across = along_plate - 0.5 * length
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


# --------------------------------------------------------------------------------------------------
# Patterns of all surfaces.

BODYWORK, COACH = int(Pattern.BODYWORK), int(Pattern.COACH)
FACADE, CLADDING = int(Pattern.FACADE), int(Pattern.CLADDING)
SIGN, PLASTER, METAL = int(Pattern.SIGN), int(Pattern.PLASTER), int(Pattern.METAL)
CLOTH, LEAVES, GLASS = int(Pattern.CLOTH), int(Pattern.LEAVES), int(Pattern.GLASS)
SKIN, LANTERN, PLAIN = int(Pattern.SKIN), int(Pattern.LANTERN), int(Pattern.PLAIN)
PEDESTRIAN = int(Category.PEDESTRIAN)


class Edge(NamedTuple):
    """Start of the lower edge of an upright face, world frame, and its length, metres."""

    x: float
    y: float
    length: float


class Appearance(NamedTuple):
    """Appearance of P prisms.

    colours: (P, 3) linear RGB. patterns: (P,). gloss: (P,).
    frames: (P, 8) of the thing that a prism belongs to: middle x y, cosine and sine of its heading,
        half length and width, height, metres, and its category, -1 for scenery.
    lit: (P,) share of the sun that reaches it. seeds: (P,) a number in 0 to 1 per thing.
    paints: (P, 3) colour of the thing's lowest prism. spans: (P, 2) bottom and top, metres.
    """

    colours: np.ndarray
    patterns: np.ndarray
    gloss: np.ndarray
    frames: np.ndarray
    lit: np.ndarray
    seeds: np.ndarray
    paints: np.ndarray
    spans: np.ndarray


@compiled(forceinline=True, borrowing=True)
def paint(
    appearance: Appearance,
    noise: np.ndarray,
    m: int,
    edge: Edge,
    normal: Vector,
    point: Vector,
    lamps: bool,
    out: np.ndarray,
) -> None:
    """Write colour (3), gloss and emitted light (3) of a point on a prism into out (7,)."""
    pattern, frame = appearance.patterns[m], appearance.frames[m]
    x, y, z = point
    dx, dy = x - frame[0], y - frame[1]
    along, across = dx * frame[2] + dy * frame[3], dy * frame[2] - dx * frame[3]
    ahead = normal.x * frame[2] + normal.y * frame[3]
    aside = normal.y * frame[2] - normal.x * frame[3]
    out[0], out[1], out[2] = (
        appearance.colours[m, 0],
        appearance.colours[m, 1],
        appearance.colours[m, 2],
    )
    out[3], out[4], out[5], out[6] = appearance.gloss[m], 0.0, 0.0, 0.0
    if pattern == FACADE:
        along_face = (x - edge.x) * -normal.y + (y - edge.y) * normal.x
        facade(
            noise,
            along_face,
            edge.length,
            z,
            appearance.spans[m],
            normal.z,
            appearance.seeds[m],
            lamps,
            out,
        )
    elif pattern == LEAVES:
        _leaves(noise, frame, x, y, z, out)
    elif pattern in (BODYWORK, COACH):
        bodywork(frame, appearance.seeds[m], along, across, z, ahead, aside, lamps, out)
    elif pattern == GLASS:
        along_face = (x - edge.x) * -normal.y + (y - edge.y) * normal.x
        glass(appearance.paints[m], frame, along_face, edge.length, along, z, ahead, aside, out)
    elif pattern == CLOTH:
        _cloth(noise, frame, appearance.spans[m], along, across, z, out)
    elif pattern == SKIN:
        _head(frame, appearance.spans[m], appearance.seeds[m], along, z, normal.z, out)
    elif pattern == CLADDING:
        cladding(along, across, z, ahead, aside, frame, lamps, out)
    elif pattern == SIGN:
        along_face = (x - edge.x) * -normal.y + (y - edge.y) * normal.x
        sign(along_face, edge.length, appearance.spans[m], z, ahead, out)
    elif pattern == PLASTER:
        _scale(out, 0.82 + 0.3 * blend_of(noise, (x + y) * 14.0, z * 14.0))
        if normal.z == 0.0 and appearance.spans[m, 1] > 3.0 and (x + 1.7 * y) % 4.0 < 0.05:
            _scale(out, 0.7)
    elif pattern == METAL:
        _scale(out, 0.88 + 0.24 * blend_of(noise, (x + y) * 11.0, z * 40.0))
    elif pattern == LANTERN and lamps and normal.z <= 0.0:
        out[4], out[5], out[6] = 5.0, 3.6, 1.9


@compiled(forceinline=True, borrowing=True)
def _leaves(
    noise: np.ndarray, frame: np.ndarray, x: float, y: float, z: float, out: np.ndarray
) -> None:
    """Draw leaves: bright outside and on top, dark inside and below."""
    dx, dy = x - frame[0], y - frame[1]
    wide = max(0.3, max(frame[4], frame[5]))
    outside = min(1.0, (dx * dx + dy * dy) / (wide * wide))
    high = min(1.0, max(0.0, z / max(frame[6], 0.5)))
    clump = cell_of(noise, (x + 0.6 * y) * 28.0, (z + 0.35 * y) * 28.0)
    leaf = grain((x + 0.37 * y) / 0.06, (z + 0.73 * y) / 0.06)
    tone = (0.25 + 0.35 * outside + 0.45 * high) * (0.45 + 0.9 * clump) * (0.75 + 0.5 * leaf)
    _scale(out, 1.25 * tone)
    out[0] *= 0.9 + 0.35 * clump


@compiled(borrowing=True)
def _cloth(
    noise: np.ndarray,
    frame: np.ndarray,
    span: np.ndarray,
    along: float,
    across: float,
    z: float,
    out: np.ndarray,
) -> None:
    """Draw folds; on people also sleeves, hands, a gap between the legs, and shoes."""
    _scale(out, 0.75 + 0.4 * cell_of(noise, (along + across) * 60.0, z * 30.0))
    if frame[7] != PEDESTRIAN:
        return
    side = across / max(frame[5], 0.05)
    level = (z - span[0]) / (span[1] - span[0])
    if span[0] < 0.1:
        if level < 0.09:
            out[0], out[1], out[2] = 0.025, 0.022, 0.02
        elif abs(side) < 0.05 + 0.08 * (1.0 - level):
            _scale(out, 0.35)
        return
    if abs(side) > 0.70:
        if level < 0.10:
            out[0], out[1], out[2] = 0.30, 0.18, 0.12
        _scale(out, 0.88)
    elif abs(side) > 0.64:
        _scale(out, 0.5)
    elif level > 0.90 and abs(side) < 0.22:
        out[0], out[1], out[2] = 0.28, 0.17, 0.12


@compiled(borrowing=True)
def _head(
    frame: np.ndarray,
    span: np.ndarray,
    seed: float,
    along: float,
    z: float,
    up: float,
    out: np.ndarray,
) -> None:
    """Draw hair or a cap above and behind, and a face ahead."""
    level = (z - span[0]) / (span[1] - span[0])
    line = 0.62 if along > 0.02 else 0.22
    if up > 0.5 or level > line:
        if seed < 0.35:
            out[0], out[1], out[2] = 0.012, 0.010, 0.009
        elif seed < 0.65:
            out[0], out[1], out[2] = 0.06, 0.032, 0.015
        elif seed < 0.8:
            out[0], out[1], out[2] = 0.22, 0.15, 0.07
        else:
            out[0], out[1], out[2] = 0.20, 0.20, 0.21
    elif along > 0.05 and 0.44 < level < 0.52:
        _scale(out, 0.55)


# --------------------------------------------------------------------------------------------------
# Appearance of the prisms of a scene.

_COLOURS = np.array([m.colour for m in MATERIALS])
_PATTERNS = np.array([int(m.pattern) for m in MATERIALS])
_GLOSS = np.array([m.gloss for m in MATERIALS])
LANTERN_M = 5.0
"""Metal that begins at this height is the lantern of a lamp post."""


def appearance_of(
    scene: Scene, solids: Solids, stamp_s: float, categories: np.ndarray
) -> Appearance:
    """Return colour, pattern and frame of every prism."""
    static, moving = scene.static, scene.moving
    rows = np.concatenate([static.materials, moving.materials]).astype(np.int64)
    yaws = scene.poses_at(np.array([stamp_s]))[0][moving.owners, 2]
    headings = np.concatenate([static.headings, moving.headings + yaws])
    kinds = np.concatenate([np.full(len(static), -1.0), categories[moving.owners]])
    owners, firsts, things = np.unique(solids.owners, return_index=True, return_inverse=True)
    frames = _frames(solids, headings, kinds, things, len(owners))
    seeds = (owners.astype(np.int64) * 2654435761 % 2**32 / 2**32)[things]
    colours, patterns = _COLOURS[rows], _PATTERNS[rows]
    patterns[(patterns == METAL) & (solids.bottoms > LANTERN_M)] = LANTERN
    return Appearance(
        colours,
        patterns,
        _GLOSS[rows],
        frames,
        np.ones(len(rows)),
        seeds,
        colours[firsts][things],
        np.column_stack([solids.bottoms, solids.tops]),
    )


def _frames(
    solids: Solids, headings: np.ndarray, kinds: np.ndarray, things: np.ndarray, count: int
) -> np.ndarray:
    """Return the (P, 8) frames of the things that prisms belong to."""
    cosine, sine = np.cos(headings)[:, None], np.sin(headings)[:, None]
    x, y = solids.footprints[..., 0], solids.footprints[..., 1]
    along, across = x * cosine + y * sine, y * cosine - x * sine
    lows, highs = np.full((2, count), np.inf), np.full((3, count), -np.inf)
    for i, values in enumerate((along, across)):
        np.minimum.at(lows[i], things, values.min(axis=1, initial=np.inf))
        np.maximum.at(highs[i], things, values.max(axis=1, initial=-np.inf))
    np.maximum.at(highs[2], things, solids.tops)
    u, v = ((lows + highs[:2]) / 2)[:, things]
    half = ((highs[:2] - lows) / 2)[:, things]
    c, s = cosine[:, 0], sine[:, 0]
    return np.column_stack([u * c - v * s, u * s + v * c, c, s, *half, highs[2][things], kinds])
