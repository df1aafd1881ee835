"""What is drawn on the surfaces of things: wheels, lamps, plates, windows, clothes, leaves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.jit import compiled
from roadscope.envs.imaging.facade_kernels import cladding, facade, sign
from roadscope.envs.imaging.noise_kernels import blend_of, cell_of, grain
from roadscope.envs.imaging.vehicle_kernels import bodywork, glass
from roadscope.envs.world.materials import Pattern

BODYWORK, COACH = int(Pattern.BODYWORK), int(Pattern.COACH)
FACADE, CLADDING = int(Pattern.FACADE), int(Pattern.CLADDING)
SIGN, PLASTER, METAL = int(Pattern.SIGN), int(Pattern.PLASTER), int(Pattern.METAL)
CLOTH, LEAVES, GLASS = int(Pattern.CLOTH), int(Pattern.LEAVES), int(Pattern.GLASS)
SKIN, LANTERN, PLAIN = int(Pattern.SKIN), int(Pattern.LANTERN), int(Pattern.PLAIN)
PEDESTRIAN = int(Category.PEDESTRIAN)


class Looks(NamedTuple):
    """How P prisms look.

    colours: (P, 3) linear RGB. patterns: (P,). gloss: (P,).
    frames: (P, 8) of the thing a prism belongs to: middle x y, cosine and sine of its heading,
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
    looks: Looks,
    noise: np.ndarray,
    m: int,
    edge: tuple[float, float, float],
    normal: tuple[float, float, float],
    place: tuple[float, float, float],
    lamps: bool,
    out: np.ndarray,
) -> None:
    """Write colour (3), gloss and own light (3) of a point on a prism into out (7,).

    edge: x, y where an upright face begins, and its length.
    """
    pattern, frame = looks.patterns[m], looks.frames[m]
    x, y, z = place
    dx, dy = x - frame[0], y - frame[1]
    along, across = dx * frame[2] + dy * frame[3], dy * frame[2] - dx * frame[3]
    ahead = normal[0] * frame[2] + normal[1] * frame[3]
    aside = normal[1] * frame[2] - normal[0] * frame[3]
    out[0], out[1], out[2] = looks.colours[m, 0], looks.colours[m, 1], looks.colours[m, 2]
    out[3], out[4], out[5], out[6] = looks.gloss[m], 0.0, 0.0, 0.0
    if pattern == FACADE:
        way = (x - edge[0]) * -normal[1] + (y - edge[1]) * normal[0]
        facade(noise, way, edge[2], z, looks.spans[m], normal[2], looks.seeds[m], lamps, out)
    elif pattern == LEAVES:
        _leaves(noise, frame, x, y, z, out)
    elif pattern in (BODYWORK, COACH):
        bodywork(frame, looks.seeds[m], along, across, z, ahead, aside, lamps, out)
    elif pattern == GLASS:
        way = (x - edge[0]) * -normal[1] + (y - edge[1]) * normal[0]
        glass(looks.paints[m], frame, way, edge[2], along, z, ahead, aside, out)
    elif pattern == CLOTH:
        _cloth(noise, frame, looks.spans[m], along, across, z, out)
    elif pattern == SKIN:
        _head(frame, looks.spans[m], looks.seeds[m], along, z, normal[2], out)
    elif pattern == CLADDING:
        cladding(along, across, z, ahead, aside, frame, lamps, out)
    elif pattern == SIGN:
        way = (x - edge[0]) * -normal[1] + (y - edge[1]) * normal[0]
        sign(way, edge[2], looks.spans[m], z, ahead, out)
    elif pattern == PLASTER:
        _scale(out, 0.82 + 0.3 * blend_of(noise, (x + y) * 14.0, z * 14.0))
        if normal[2] == 0.0 and looks.spans[m, 1] > 3.0 and (x + 1.7 * y) % 4.0 < 0.05:
            _scale(out, 0.7)
    elif pattern == METAL:
        _scale(out, 0.88 + 0.24 * blend_of(noise, (x + y) * 11.0, z * 40.0))
    elif pattern == LANTERN and lamps and normal[2] <= 0.0:
        out[4], out[5], out[6] = 5.0, 3.6, 1.9


@compiled(forceinline=True, borrowing=True)
def _scale(out: np.ndarray, factor: float) -> None:
    out[0], out[1], out[2] = out[0] * factor, out[1] * factor, out[2] * factor


@compiled(forceinline=True, borrowing=True)
def _leaves(
    noise: np.ndarray, frame: np.ndarray, x: float, y: float, z: float, out: np.ndarray
) -> None:
    """Bright twigs outside and on top, dark ones inside and below."""
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
    """Folds; on people sleeves and hands on the trunk, a gap between the legs, and shoes."""
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
    """Hair or a cap above and behind, and a face ahead."""
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
