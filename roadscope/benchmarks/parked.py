"""Cars parked beside the road are scenery: finding one is neither right nor wrong."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from roadscope.benchmarks.episode import Episode, timeline_of
from roadscope.core import Truth


def parked_owners(truth: Truth) -> set[int]:
    """Return the owners of the parked cars that gave returns to a scan."""
    from roadscope.envs.world.roadside import KINDS, kinds_of

    owners = np.unique(truth.sources)
    return set(owners[kinds_of(owners) == list(KINDS).index("parked_cars")].tolist())


def parked_centres(episode: Episode, owners: Iterable[int]) -> np.ndarray:
    """Return (P, 2) box centres of parked cars, metres, world frame."""
    from roadscope.envs.sensors.sensing import world_of

    wanted = sorted(owners)
    if not wanted:
        return np.empty((0, 2))
    timeline = timeline_of(episode)
    scenery = world_of(timeline, episode.seed).scenery.along(timeline.axles[:, 0])
    outlines = (scenery.footprints[scenery.owners == owner].reshape(-1, 2) for owner in wanted)
    # The outline of a body is the same seen from its other side, so this is its middle however
    # the car stands.
    return np.array([(o.min(axis=0) + o.max(axis=0)) / 2 for o in outlines])


def parked_among(episode: Episode, truths: Iterable[Truth]) -> np.ndarray:
    """Return (N, 2) centres, world frame, of the parked cars that any of the truths shows."""
    return parked_centres(episode, set().union(*map(parked_owners, truths)))
