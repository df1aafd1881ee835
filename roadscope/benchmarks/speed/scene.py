"""The scenes on which speed is measured, for our caster and as triangles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Category, Pose
from roadscope.envs.raycast.cast import Columns
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.world.bodies import body_prisms
from roadscope.envs.world.prisms import Prisms

SENSOR_HEIGHT_M = 1.9
CLEARANCE_M = 9.0
RADIUS_M = 95.0
SPEED_M_S = 20.0
KNOTS_S = np.linspace(-0.05, 0.05, 6)
_SIZES = {
    Category.CAR: (4.5, 1.8, 1.5),
    Category.VAN: (5.5, 2.0, 2.4),
    Category.TRUCK: (12.0, 2.5, 3.6),
}
_MIX = (Category.CAR, Category.CAR, Category.CAR, Category.VAN, Category.TRUCK)


def parked_scene(bodies: int, seed: int = 0) -> Scene:
    """Scatter bodies evenly over a disc around the sensor, nothing moves."""
    rng = np.random.default_rng([seed, bodies])
    parts, poses = [], np.empty((bodies, 3))
    for row in range(bodies):
        category = _MIX[rng.integers(len(_MIX))]
        body = body_prisms(category, np.array(_SIZES[category]), rng)
        parts.append(replace(body, owners=np.full(len(body), row, np.int32)))
        distance = np.sqrt(rng.uniform(CLEARANCE_M**2, RADIUS_M**2))
        bearing, yaw = rng.uniform(-np.pi, np.pi, 2)
        poses[row] = distance * np.cos(bearing), distance * np.sin(bearing), yaw
    return Scene.still(Prisms.empty(), Prisms.join(parts), poses)


def driving_scene(bodies: int, seed: int = 0) -> Scene:
    """Let every body of the parked scene drive on with up to 20 m/s, turning."""
    scene = parked_scene(bodies, seed)
    rng = np.random.default_rng([seed, bodies, 1])
    yaws = scene.poses[0, :, 2]
    speeds, turns = rng.uniform(-SPEED_M_S, SPEED_M_S, bodies), rng.uniform(-0.3, 0.3, bodies)
    rates = np.column_stack([speeds * np.cos(yaws), speeds * np.sin(yaws), turns])
    return replace(scene, knots_s=KNOTS_S, poses=scene.poses + KNOTS_S[:, None, None] * rates)


def sensor_poses(pitch: float, roll: float, *, moving: bool) -> list[Pose]:
    """Stand at the origin, or drive through it at 20 m/s; pitch and roll in radians."""
    places = SPEED_M_S * KNOTS_S if moving else np.zeros(1)
    return [Pose.from_euler(x, 0.0, SENSOR_HEIGHT_M, pitch=pitch, roll=roll) for x in places]


def ray_table(columns: Columns, slopes: np.ndarray) -> np.ndarray:
    """Return (C, B, 6) float32 origins and unit directions."""
    directions = columns.ahead[:, None] + slopes[:, None] * columns.up[:, None]
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    origins = np.broadcast_to(columns.origins[:, None], directions.shape)
    return np.concatenate([origins, directions], axis=-1).astype(np.float32)


def triangulate(scene: Scene, ground_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices, triangles and each triangle's owner of a scene at its first knot.

    The ground, owner -1, is a square that reaches `ground_m` to each side.
    """
    square = ground_m * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    vertices = [np.column_stack([square, np.zeros(4)])]
    triangles, owners = [np.array([[0, 1, 2], [0, 2, 3]])], [np.full(2, -1)]
    start = 4
    prisms = Prisms.join([scene.static, scene.moving])
    for m, owner in enumerate(prisms.owners):
        corners = prisms.footprints[m, : prisms.corners[m]]
        if owner >= 0:
            if not scene.present[owner]:
                continue
            x, y, yaw = scene.poses[0, owner]
            corners = Pose.planar(x, y, yaw).apply(np.pad(corners, ((0, 0), (0, 1))))[:, :2]
        heights = np.repeat([prisms.bottoms[m], prisms.tops[m]], len(corners))
        vertices.append(np.column_stack([np.tile(corners, (2, 1)), heights]))
        faces = start + _prism_faces(len(corners))
        triangles.append(faces)
        owners.append(np.full(len(faces), owner))
        start += 2 * len(corners)
    return np.concatenate(vertices), np.concatenate(triangles), np.concatenate(owners)


def _prism_faces(corners: int) -> np.ndarray:
    """Triangles of a prism whose vertices are the bottom ring, then the top ring."""
    near = np.arange(corners)
    far = (near + 1) % corners
    lid = np.column_stack([np.zeros(corners - 2, np.int64), near[1:-1], near[2:]])
    return np.concatenate(
        [
            np.column_stack([near, far, near + corners]),
            np.column_stack([far, far + corners, near + corners]),
            lid,
            lid + corners,
        ]
    )
