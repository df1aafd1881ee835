"""The sizes of road users: the prior by which a body is completed if only a part was measured.

The figures are means and standard deviations over the outer dimensions that makers publish, without
mirrors: small to large cars, small and large vans, rigid trucks of 6 to 9 m, rigid and articulated
trucks at the length that Directive 96/53/EC allows, city buses, and two-wheelers with their riders.

Shares sum to one. They are our guess at mixed European traffic, not statistics. Only their ratios
matter, and only if several bodies fit: one that is twice as common, but 1.2 standard deviations off
in one dimension, is as likely as one that fits exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core import Category


class Body(NamedTuple):
    """One kind of road user.

    share: of all road users; length, width, height: mean and standard deviation in metres.
    """

    category: Category
    share: float
    length: tuple[float, float]
    width: tuple[float, float]
    height: tuple[float, float]


_WEIGHED = (
    Body(Category.CAR, 0.67, (4.40, 0.38), (1.82, 0.09), (1.49, 0.10)),
    Body(Category.VAN, 0.09, (4.70, 0.30), (1.88, 0.07), (1.90, 0.12)),
    Body(Category.VAN, 0.07, (5.70, 0.40), (2.03, 0.07), (2.55, 0.15)),
    Body(Category.TRUCK, 0.05, (7.40, 1.10), (2.40, 0.18), (3.30, 0.30)),
    Body(Category.TRUCK, 0.02, (12.00, 0.80), (2.55, 0.06), (3.80, 0.20)),
    Body(Category.TRUCK, 0.02, (16.50, 0.60), (2.55, 0.06), (4.00, 0.15)),
    Body(Category.BUS, 0.04, (11.40, 0.80), (2.55, 0.06), (3.12, 0.15)),
    Body(Category.MOTORCYCLE, 0.05, (2.05, 0.20), (0.82, 0.15), (1.70, 0.12)),
    Body(Category.CYCLIST, 0.02, (1.80, 0.12), (0.65, 0.12), (1.75, 0.12)),
    Body(Category.PEDESTRIAN, 0.05, (0.50, 0.20), (0.60, 0.12), (1.72, 0.12)),
)

_TOTAL = sum(body.share for body in _WEIGHED)
BODIES = tuple(body._replace(share=body.share / _TOTAL) for body in _WEIGHED)

BOX_SHAPED = (Category.CAR, Category.VAN, Category.TRUCK, Category.BUS)
"""Categories with straight faces; people and cyclists have none."""
LONGEST_M = 18.5
"""Length of the longest vehicle that needs no permit, and a little for noise."""
WIDEST_M = 3.0
"""Width of the widest vehicle, with mirrors and noise."""


class BodyTable(NamedTuple):
    """`BODIES` as arrays.

    log_shares: (K,) natural logarithms. means, spreads: (K, 3) mean and standard deviation of
    length, width and height in metres.
    """

    log_shares: np.ndarray
    means: np.ndarray
    spreads: np.ndarray


def body_table() -> BodyTable:
    """Return the kinds of road users as arrays."""
    sizes = np.array([[b.length, b.width, b.height] for b in BODIES])
    means, spreads = sizes[..., 0].copy(), sizes[..., 1].copy()
    return BodyTable(np.log([b.share for b in BODIES]), means, spreads)
