"""The world that sensors measure: scenery beside the road and a body for every actor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from roadscope.core import Category
from roadscope.core.record import Record
from roadscope.envs.traffic.timeline import Timeline
from roadscope.envs.world.bodies import body_prisms
from roadscope.envs.world.materials import CONCRETE
from roadscope.envs.world.prisms import Prisms, placed, rectangle
from roadscope.envs.world.roadside import MOST_THINGS, OBSTACLE_KIND, Scenery
from roadscope.envs.world.things import with_owners

# --------------------------------------------------------------------------------------------------
# Bodies of obstacles on the road.

OBSTACLE_REFLECTIVITY = 0.35
"""Concrete at 905 nm."""


def obstacle_prisms(obstacles: np.ndarray) -> Prisms:
    """Return one upright box for each obstacle, world frame, as scenery of `OBSTACLE_KIND`.

    obstacles: (O, 6) as `Timeline.obstacles`: centre x and y, yaw, length, width, height.
    """
    boxes = []
    for number, (x, y, yaw, length, width, height) in enumerate(obstacles):
        outline = placed(rectangle(length, width), np.array([[x, y]]), np.array([yaw]))[0]
        owner = -2 - (OBSTACLE_KIND * MOST_THINGS + number)
        boxes.append(
            Prisms.of(
                outline,
                0.0,
                height,
                owner=owner,
                reflectivity=OBSTACLE_REFLECTIVITY,
                material=CONCRETE,
            )
        )
    return Prisms.join(boxes)


# --------------------------------------------------------------------------------------------------
# Scenery and bodies of an episode.

SALT = 0x426F6479
"""Part of the seed that makes these random numbers differ from others of the same episode."""


@dataclass(frozen=True, slots=True, eq=False)
class World(Record):
    """Scenery and bodies of one episode.

    scenery: things beside the road, created where they are needed.
    obstacles: obstacles on the road, world frame.
    moving: bodies of all actors, each in the frame of its box centre; the owner of a body is its
        row in the timeline.
    ids, categories, sizes: (A,), (A,), (A, 3) of the actors, as in the timeline.
    seed: of all random properties of scenery and bodies.
    """

    scenery: Scenery
    obstacles: Prisms
    moving: Prisms
    ids: np.ndarray
    categories: np.ndarray
    sizes: np.ndarray
    seed: int

    def static_around(self, position: np.ndarray, radius_m: float = 200.0) -> Prisms:
        """Return all obstacles and at least all scenery within the radius of an (x, y) position."""
        scenery = self.scenery.around(position, radius_m)
        return Prisms.join([scenery, self.obstacles]) if len(self.obstacles) else scenery

    def with_actors(self, timeline: Timeline) -> World:
        """Return the world with bodies for the actors that the timeline has now."""
        actors = {name: getattr(timeline, name) for name in ("ids", "categories", "sizes")}
        if all(np.array_equal(getattr(self, name), value) for name, value in actors.items()):
            return self
        return replace(self, moving=actor_bodies(timeline, self.seed), **actors)


def build_world(timeline: Timeline, seed: int, style: str | None = None) -> World:
    """Return the world of a timeline; `style` replaces the style of the timeline."""
    scenery = Scenery(timeline.road, timeline.style if style is None else style, seed)
    return World(
        scenery,
        obstacle_prisms(timeline.obstacles),
        actor_bodies(timeline, seed),
        timeline.ids,
        timeline.categories,
        timeline.sizes,
        int(seed),
    )


def actor_bodies(timeline: Timeline, seed: int) -> Prisms:
    """Return a body for each actor; a body depends on seed, id, category and size alone."""
    bodies = [
        _body(int(seed), int(actor), int(category), tuple(map(float, size)))
        for actor, category, size in zip(
            timeline.ids, timeline.categories, timeline.sizes, strict=True
        )
    ]
    rows = np.repeat(np.arange(len(bodies)), list(map(len, bodies)))
    return with_owners(Prisms.join(bodies), rows)


@lru_cache(maxsize=4096)
def _body(seed: int, actor: int, category: int, size: tuple[float, ...]) -> Prisms:
    # Seeds take no negative numbers.
    words = [SALT, seed, 2 * actor if actor >= 0 else -2 * actor - 1]
    rng = np.random.default_rng(np.random.SeedSequence(words))
    return body_prisms(Category(category), np.array(size), rng)
