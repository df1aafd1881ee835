"""Zhang 2017's car, a Ford Fusion, as a body to fit: its outline known, its corner radius not."""

from __future__ import annotations

from roadscope.detectors.pose.body_model import BodyModel, BodySection
from roadscope.envs.world.ford_saloon import AXLES_M, GLASS, LENGTH_M, NARROWING, SLABS, WIDTH_M


def fusion(radius_m: tuple[float, float] = (0.0, 0.4)) -> BodyModel:
    """Return the car with the maker's sizes; radius_m: least and greatest corner radius."""
    rear, front = AXLES_M
    windows = [slab for slab in SLABS if slab.reflectivity == GLASS]
    return BodyModel(
        (LENGTH_M, 0.0),
        (WIDTH_M, 0.0),
        radius_m,
        tuple(
            BodySection(slab.bottom_m, slab.top_m, slab.from_tail_m, slab.from_nose_m, slab.breadth)
            for slab in SLABS
        ),
        (rear / LENGTH_M, front / LENGTH_M),
        NARROWING,
        glass_m=(windows[0].bottom_m, windows[-1].top_m),
    )
