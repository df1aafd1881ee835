"""Lamps, shadows, sky, and transmittance of the air."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.jit import compiled
from roadscope.envs.imaging.noise import blend_of
from roadscope.envs.imaging.raster import GROUND_FACE, NEAR_M, Lens, Point, Solids, into_camera
from roadscope.envs.world.prisms import MAX_EDGES

# --------------------------------------------------------------------------------------------------
# Light of lamps at night: a map of the ground around, and the ego's headlights.

POOL_SIDE, POOL_M = 256, 0.75
"""Cells along a side of the map, and the side of a cell."""
LANTERN_LIGHT, HEADLIGHT = 0.85, 1.3
"""Light below a lantern at a height of 6 m, and 6 m ahead of headlights; chosen by hand."""
HEADLIGHT_HEIGHT_M = 0.65
LONGEST_M = 45.0
"""Range of headlights."""
_PEDESTRIAN, _CYCLIST = int(Category.PEDESTRIAN), int(Category.CYCLIST)


@compiled(borrowing=True)
def light_pools(
    solids: Solids, lanterns: np.ndarray, frames: np.ndarray, origin: Point, pools: np.ndarray
) -> None:
    """Fill pools (side, side, 2) float32 with the light of street lamps and of headlights.

    lanterns: (P,) bool. frames: (P, 8), see `patterns.Appearance`. origin: corner of the
    first cell. A vehicle's first prism has its headlights.
    """
    pools[:] = 0.0
    before = -1
    for m in range(len(lanterns)):
        if lanterns[m]:
            _lantern(frames[m], solids.bottoms[m], origin, pools)
        owner = solids.owners[m]
        kind = frames[m, 7]
        first = owner >= 0 and owner != before and solids.corners[m] > 0
        if first and kind not in (_PEDESTRIAN, _CYCLIST):
            _headlights(frames[m], origin, pools)
        before = owner


@compiled(borrowing=True)
def _lantern(frame: np.ndarray, height: float, origin: Point, pools: np.ndarray) -> None:
    """Add the light of a street lamp at a height in metres to the map."""
    x, y = (frame[0] - origin.x) / POOL_M, (frame[1] - origin.y) / POOL_M
    reach = 22.0 / POOL_M
    for i in range(max(0, int(y - reach)), min(POOL_SIDE, int(y + reach))):
        for j in range(max(0, int(x - reach)), min(POOL_SIDE, int(x + reach))):
            dx, dy = (j + 0.5 - x) * POOL_M, (i + 0.5 - y) * POOL_M
            square = dx * dx + dy * dy
            from_lamp = square + height * height
            edge = max(0.0, 1.0 - square / 484.0)
            light = LANTERN_LIGHT * edge * 36.0 * height / (from_lamp * np.sqrt(from_lamp))
            pools[i, j, 0] += light


@compiled(borrowing=True)
def _headlights(frame: np.ndarray, origin: Point, pools: np.ndarray) -> None:
    """Add the light of a vehicle's headlights to the map."""
    cosine, sine = frame[2], frame[3]
    x, y = frame[0] + frame[4] * cosine, frame[1] + frame[4] * sine
    column, row = (x - origin.x) / POOL_M, (y - origin.y) / POOL_M
    reach = LONGEST_M / POOL_M
    for i in range(max(0, int(row - reach)), min(POOL_SIDE, int(row + reach))):
        for j in range(max(0, int(column - reach)), min(POOL_SIDE, int(column + reach))):
            dx, dy = (j + 0.5 - column) * POOL_M, (i + 0.5 - row) * POOL_M
            along, across = dx * cosine + dy * sine, dy * cosine - dx * sine
            if along > 0.0:
                pools[i, j, 1] += beam(along, across)


@compiled(forceinline=True, borrowing=True)
def beam(along: float, across: float) -> float:
    """Return the light of dipped headlights on the ground, metres ahead of and beside them."""
    wide = 0.30 * along + 1.0
    side = across / wide
    value: float = (
        HEADLIGHT * np.exp(-side * side - along / 15.0) * along / (along + 2.5)
        if along < LONGEST_M
        else 0.0
    )
    return value


@compiled(forceinline=True, borrowing=True)
def pools_at(pools: np.ndarray, origin: Point, x: float, y: float) -> tuple[float, float]:
    """Return the light of street lamps and of headlights at a point, interpolated in the map."""
    u, v = (x - origin.x) / POOL_M - 0.5, (y - origin.y) / POOL_M - 0.5
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
    """Return the light of the ego's headlights, which are 1 m ahead of the camera."""
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
        # A wall faces the lamps, the ground hardly does; above the beam's edge it is almost dark.
        light *= min(2.5, along / (4.0 * HEADLIGHT_HEIGHT_M))
        above = (z - HEADLIGHT_HEIGHT_M) / along
        light *= min(1.0, max(0.10, 1.0 - 25.0 * (above - 0.005)))
    return light


# --------------------------------------------------------------------------------------------------
# Shadows.

LOW_M, UNDERNEATH = 0.5, 200
"""Things whose underside is below this height hide this much, of 255, of the sky from the
ground."""
REACH_M = 150.0
"""Shadows that begin farther from the camera are not drawn."""


@compiled()
def cast_shadows(
    lens: Lens,
    solids: Solids,
    faces: np.ndarray,
    sun: np.ndarray,
    lit: np.ndarray,
    open_sky: np.ndarray,
) -> None:
    """Darken, in place, the ground pixels of lit and open_sky (H, W) uint8.

    lit is 255 in full sun. open_sky is 255 under the open sky, and less below things whose
    underside is close to the ground.
    """
    points, hull = np.empty((2 * MAX_EDGES, 2)), np.empty((4 * MAX_EDGES + 2, 2))
    world, polygon = np.empty((4 * MAX_EDGES + 2, 3)), np.empty((8 * MAX_EDGES, 2))
    lit[:], open_sky[:] = 255, 255
    for m in range(len(solids.corners)):
        count = int(solids.corners[m])
        if count == 0:
            continue
        dx = solids.footprints[m, 0, 0] - lens.origin[0]
        dy = solids.footprints[m, 0, 1] - lens.origin[1]
        if dx * dx + dy * dy > REACH_M * REACH_M:
            continue
        for k in range(count):
            x, y = solids.footprints[m, k, 0], solids.footprints[m, k, 1]
            for i, z in enumerate((solids.bottoms[m], solids.tops[m])):
                points[2 * k + i, 0] = x - sun[0] / sun[2] * z
                points[2 * k + i, 1] = y - sun[1] / sun[2] * z
        corners = _hull(points[: 2 * count], hull)
        for k in range(corners):
            world[k, 0], world[k, 1], world[k, 2] = hull[k, 0], hull[k, 1], 0.0
        corners = _project_flat(lens, world, corners, polygon)
        if corners >= 3:
            shade = 255
            if solids.extinctions[m] > 0.0:
                thick = solids.tops[m] - solids.bottoms[m]
                shade = int(255.0 * (1.0 - np.exp(-solids.extinctions[m] * thick)))
            _darken(polygon, corners, faces, shade, lit)
        if 0.0 < solids.bottoms[m] < LOW_M:
            for k in range(count):
                world[k, 0], world[k, 1] = solids.footprints[m, k, 0], solids.footprints[m, k, 1]
                world[k, 2] = 0.0
            corners = _project_flat(lens, world, count, polygon)
            if corners >= 3:
                _darken(polygon, corners, faces, UNDERNEATH, open_sky)


@compiled()
def _hull(points: np.ndarray, hull: np.ndarray) -> int:
    """Write the convex hull counter-clockwise; return its corners. Two chains of sorted points."""
    for i in range(1, len(points)):
        x, y, j = points[i, 0], points[i, 1], i - 1
        while j >= 0 and (points[j, 0] > x or (points[j, 0] == x and points[j, 1] > y)):
            points[j + 1, 0], points[j + 1, 1] = points[j, 0], points[j, 1]
            j -= 1
        points[j + 1, 0], points[j + 1, 1] = x, y
    size = 0
    for turn in range(2):
        start = size
        for n in range(len(points)):
            i = n if turn == 0 else len(points) - 1 - n
            x, y = points[i, 0], points[i, 1]
            while size >= start + 2 and _left(hull, size, x, y) <= 0.0:
                size -= 1
            hull[size, 0], hull[size, 1] = x, y
            size += 1
        size -= 1
    return size


@compiled(forceinline=True)
def _left(hull: np.ndarray, size: int, x: float, y: float) -> float:
    ax, ay = hull[size - 2, 0], hull[size - 2, 1]
    turn: float = (hull[size - 1, 0] - ax) * (y - ay) - (hull[size - 1, 1] - ay) * (x - ax)
    return turn


@compiled()
def _project_flat(lens: Lens, world: np.ndarray, corners: int, polygon: np.ndarray) -> int:
    """Clip a polygon at the near plane and write it in pixels; return its corners."""
    count = 0
    last = corners - 1
    x0, y0, z0 = into_camera(lens, world[last, 0], world[last, 1], world[last, 2])
    for k in range(corners):
        x1, y1, z1 = into_camera(lens, world[k, 0], world[k, 1], world[k, 2])
        if (z0 < NEAR_M) != (z1 < NEAR_M):
            share = (NEAR_M - z0) / (z1 - z0)
            x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
            polygon[count, 0] = lens.focal[0] * x / NEAR_M + lens.centre[0]
            polygon[count, 1] = lens.focal[1] * y / NEAR_M + lens.centre[1]
            count += 1
        if z1 >= NEAR_M:
            polygon[count, 0] = lens.focal[0] * x1 / z1 + lens.centre[0]
            polygon[count, 1] = lens.focal[1] * y1 / z1 + lens.centre[1]
            count += 1
        x0, y0, z0 = x1, y1, z1
    return count


@compiled()
def _darken(
    polygon: np.ndarray, corners: int, faces: np.ndarray, shade: int, lit: np.ndarray
) -> None:
    height, width = faces.shape
    top = bottom = polygon[0, 1]
    for k in range(1, corners):
        top, bottom = min(top, polygon[k, 1]), max(bottom, polygon[k, 1])
    first = int(max(0.0, np.ceil(min(top, 1.0 * height) - 0.5)))
    last = int(max(0.0, min(1.0 * height, np.ceil(bottom - 0.5))))
    for r in range(first, last):
        y, left, right = r + 0.5, np.inf, -np.inf
        x0, y0 = polygon[corners - 1, 0], polygon[corners - 1, 1]
        for k in range(corners):
            x1, y1 = polygon[k, 0], polygon[k, 1]
            if (y0 <= y) != (y1 <= y):
                x = x0 + (y - y0) * ((x1 - x0) / (y1 - y0))
                left, right = min(left, x), max(right, x)
            x0, y0 = x1, y1
        if left > right:
            continue
        for k in range(
            int(min(1.0 * width, max(0.0, np.ceil(left - 0.5)))),
            int(min(1.0 * width, max(0.0, np.ceil(right - 0.5)))),
        ):
            if faces[r, k] == GROUND_FACE:
                lit[r, k] = np.uint8(lit[r, k] * (255 - shade) // 255)


@compiled()
def sunlit(solids: Solids, sun: np.ndarray, lens: Lens, shares: np.ndarray) -> None:
    """Fill shares (P,) of the sun that reach the middle of the upper half of each prism."""
    for m in range(len(shares)):
        shares[m] = 1.0
        if solids.corners[m] == 0:
            continue
        x = y = 0.0
        for k in range(solids.corners[m]):
            x += solids.footprints[m, k, 0] / solids.corners[m]
            y += solids.footprints[m, k, 1] / solids.corners[m]
        dx, dy = x - lens.origin[0], y - lens.origin[1]
        if dx * dx + dy * dy > REACH_M * REACH_M:
            continue
        z = 0.25 * solids.bottoms[m] + 0.75 * solids.tops[m]
        for n in range(len(shares)):
            if solids.owners[n] != solids.owners[m] and solids.tops[n] > z:
                path = _path(solids, n, x, y, z, sun)
                if path > 0.0:
                    porous = solids.extinctions[n]
                    shares[m] *= np.exp(-porous * path) if porous > 0.0 else 0.0
                    if shares[m] < 0.01:
                        break


@compiled()
def _path(solids: Solids, n: int, x: float, y: float, z: float, sun: np.ndarray) -> float:
    """Return the length inside a prism of the ray from a point towards the sun."""
    enter = max(0.0, (solids.bottoms[n] - z) / sun[2])
    leave = (solids.tops[n] - z) / sun[2]
    count = solids.corners[n]
    for k in range(count):
        if enter >= leave:
            return 0.0
        after = k + 1 if k + 1 < count else 0
        px, py = solids.footprints[n, k, 0], solids.footprints[n, k, 1]
        nx, ny = solids.footprints[n, after, 1] - py, px - solids.footprints[n, after, 0]
        distance, approach = nx * (px - x) + ny * (py - y), nx * sun[0] + ny * sun[1]
        if approach > 0.0:
            leave = min(leave, distance / approach)
        elif approach < 0.0:
            enter = max(enter, distance / approach)
        elif distance < 0.0:
            return 0.0
    length: float = max(0.0, leave - enter)
    return length


# --------------------------------------------------------------------------------------------------
# The sky, computed at the corners of blocks of pixels, and the skyline at the horizon.

BLOCK = 8
"""Edge of the blocks in pixels; between their corners the sky is linear."""


class Air(NamedTuple):
    """Light and air, see `light.Light`; all light is multiplied by the exposure's gain.

    towards: (3,) unit vector towards the sun. sun, zenith, horizon, ground: (3,) colours. clouds,
    lamps: as in `Light`.
    extinction: 1/m. veil: (3,) brightness of thick fog. wet: 0 to 1, how wet the ground is.
    sky: (3,) light of the open sky on level ground.
    """

    towards: np.ndarray
    sun: np.ndarray
    zenith: np.ndarray
    horizon: np.ndarray
    ground: np.ndarray
    clouds: float
    lamps: bool
    extinction: float
    veil: np.ndarray
    wet: float
    sky: np.ndarray


@compiled(borrowing=True)
def sky_blocks(lens: Lens, air: Air, noise: np.ndarray, blocks: np.ndarray) -> None:
    """Fill blocks (H / 8 + 2, W / 8 + 2, 3) float32 with the sky's light."""
    r = lens.rotation
    for i in range(blocks.shape[0]):
        dv = (i * BLOCK - lens.centre[1]) / lens.focal[1]
        for j in range(blocks.shape[1]):
            du = (j * BLOCK - lens.centre[0]) / lens.focal[0]
            x = r[0, 0] * du + r[1, 0] * dv + r[2, 0]
            y = r[0, 1] * du + r[1, 1] * dv + r[2, 1]
            z = r[0, 2] * du + r[1, 2] * dv + r[2, 2]
            scale = 1.0 / np.sqrt(1.0 + du * du + dv * dv)
            if z * scale > -0.06:
                _sky(air, noise, x * scale, y * scale, z * scale, blocks[i, j])


@compiled(borrowing=True)
def _sky(air: Air, noise: np.ndarray, x: float, y: float, z: float, light: np.ndarray) -> None:
    up = max(0.0, z)
    fall = 1.0 - min(1.0, up)
    share = 1.0 - fall * fall * fall
    toward = max(0.0, x * air.towards[0] + y * air.towards[1] + z * air.towards[2])
    open_share = 1.0 - 0.85 * max(0.0, 2.0 * air.clouds - 1.0)
    glow = open_share * (0.30 * toward**24 + 0.7 * toward**400)
    cloud, shade = 0.0, 1.0
    if air.clouds > 0.0 and up > 0.012:
        cloud, shade = _cloud(air, noise, x, y, up)
    sun = (air.sun[0] + air.sun[1] + air.sun[2]) / 3.0
    white = 0.30 * sun + 0.72 * air.horizon[1]
    haze = 1.0 / (1.0 + 10.0 * up)
    thick = 1.0 - np.exp(-air.extinction * min(9000.0, 250.0 / (up + 0.004)))
    for k in range(3):
        clear = air.horizon[k] + share * (air.zenith[k] - air.horizon[k]) + glow * air.sun[k]
        lit = white * (0.92 * shade + 0.08 * air.sun[k] / max(sun, 1e-9))
        lit += 0.35 * haze * (air.horizon[k] - lit)
        value = clear + cloud * (lit - clear)
        light[k] = value + thick * (air.veil[k] - value)


@compiled(borrowing=True)
def _cloud(air: Air, noise: np.ndarray, x: float, y: float, up: float) -> tuple[float, float]:
    """Return the share of the sky that a cloud hides, and the brightness of its underside."""
    scale = 18.0 / (up + 0.10)
    u, v = x * scale, y * scale
    field = 0.62 * blend_of(noise, u, v) + 0.26 * blend_of(noise, 2.7 * u + 40.0, 2.7 * v)
    field += 0.12 * blend_of(noise, 6.3 * u, 6.3 * v + 90.0) * min(1.0, 8.0 * up) + 0.02
    level = field - 0.78 + 0.62 * air.clouds
    cover = min(1.0, max(0.0, level * 5.0)) * min(1.0, 7.0 * up)
    return cover, 1.0 - 0.75 * min(0.4, max(0.0, level)) * (0.5 + 0.5 * air.clouds)


@compiled(borrowing=True)
def skyline(lens: Lens, noise: np.ndarray, heights: np.ndarray) -> None:
    """Fill heights (W,) with the sine of the elevation of far trees in each column."""
    r = lens.rotation
    for c in range(len(heights)):
        du = (c + 0.5 - lens.centre[0]) / lens.focal[0]
        x, y = r[0, 0] * du + r[2, 0], r[0, 1] * du + r[2, 1]
        bearing = np.arctan2(y, x)
        hill = blend_of(noise, 60.0 * bearing, 3.5)
        trees = blend_of(noise, 900.0 * bearing, 77.5)
        heights[c] = 0.003 + 0.016 * max(0.0, hill - 0.25) + 0.004 * trees


# --------------------------------------------------------------------------------------------------
# Tables for the shading of all pixels.

TRANSMITTANCE_STEPS = 1024
"""Steps of the table of transmittances, up to an optical depth of `GREATEST_DEPTH`."""
GREATEST_DEPTH = 12.0


class ShadingTables(NamedTuple):
    """All that shading needs besides lens, air and appearance.

    footprints: (P, 12, 2), corners: (P,) of the prisms. normals, glow: (P, 14, 3) of the faces:
    outward unit vector, and the light that falls on the face, by colour. lit, open_sky: (H, W)
    uint8, see `cast_shadows`. cells: (3, SIDE, SIDE + PADDING) uint32, middles: (3, 2) of the
    ground. noise: see `noise_tile`. pools: (256, 256, 2), origin: see `light_pools`. blocks: see
    `sky_blocks`. heights: (W,), see `skyline`. transmittances: (1025,) share of transmitted light,
    by optical depth.
    """

    footprints: np.ndarray
    corners: np.ndarray
    normals: np.ndarray
    glow: np.ndarray
    lit: np.ndarray
    open_sky: np.ndarray
    cells: np.ndarray
    middles: np.ndarray
    noise: np.ndarray
    pools: np.ndarray
    origin: Point
    blocks: np.ndarray
    heights: np.ndarray
    transmittances: np.ndarray


@compiled(forceinline=True, borrowing=True)
def transmitted(transmittances: np.ndarray, thickness: float) -> float:
    """Return the transmittance of an optical depth, exp(-thickness), from the table."""
    place = min(thickness, 0.999 * GREATEST_DEPTH) * (TRANSMITTANCE_STEPS / GREATEST_DEPTH)
    step = int(place)
    low: float = transmittances[step]
    share: float = low + (place - step) * (transmittances[step + 1] - low)
    return share
