"""Vehicles of shapes that no detector of the package was taught, in place of the usual ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from roadscope.core import Category
from roadscope.envs.traffic.mix import Size
from roadscope.envs.traffic.timeline import Timeline

UNSEEN: Mapping[Category, Mapping[str, Size]] = MappingProxyType(
    {
        Category.CAR: {"tall-box": (3.395, 1.475, 1.790), "pickup": (4.480, 1.732, 1.577)},
        Category.VAN: {"dropside": (4.220, 1.680, 1.920), "camper": (5.350, 2.010, 2.750)},
        Category.TRUCK: {
            "flatbed": (5.900, 2.100, 2.300), "tanker": (8.400, 2.500, 3.200),
            "tank-trailer": (16.000, 2.550, 3.600), "long-flatbed": (11.800, 2.540, 3.000),
        },
        Category.BUS: {"double-decker": (10.500, 2.520, 4.300)},
    }
)  # fmt: skip
"""Sizes of such vehicles, rounded and from memory, not of one model each. They stand for shapes:
`world.unseen_bodies` builds a body of its own for each of these sizes, and no mix has them."""
SALT = 0x556E7365


def with_unseen_bodies(timeline: Timeline) -> Timeline:
    """Return the same traffic with other bodies, each inside the one that it stands in for.

    So nobody comes closer to anybody than before. Motorcycles and people stay as they are, and
    so does the ego.
    """
    sizes = timeline.sizes.copy()
    rows = zip(timeline.ids.tolist(), timeline.categories.tolist(), strict=True)
    for row, (actor, category) in enumerate(rows):
        known = UNSEEN.get(Category(category), {}).values()
        fit = [s for s in known if s[0] <= sizes[row, 0] and s[1] <= sizes[row, 1]]
        if row > 0 and fit:
            rng = np.random.default_rng([SALT, abs(actor)])
            sizes[row] = fit[int(rng.integers(len(fit)))]
    return replace(timeline, sizes=sizes)
