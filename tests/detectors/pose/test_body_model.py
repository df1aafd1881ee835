"""What the unknowns of a body make of its outline."""

import numpy as np
import pytest

from roadscope.detectors.pose import VALUES, BodyModel, fill_outlines, new_outlines, saloon

STATES = np.random.default_rng(0).standard_normal((64, VALUES))


def outlines(model, state):
    filled = new_outlines(len(model.sections))
    fill_outlines(model.shape, state, filled)
    return filled


def test_no_corner_stands_out_beyond_its_section():
    """A roof that ends between the axles has its corners where it ends."""
    model = saloon((4.7, 0.2), (1.8, 0.05))
    for state in STATES:
        filled = outlines(model, state)
        for p, part in enumerate(model.parts(state)):
            assert filled.x[p].max() == pytest.approx(part.front)
            assert filled.x[p].min() == pytest.approx(part.rear)
            assert filled.y[p].max() == pytest.approx(part.half, abs=0.03)
            assert np.allclose(filled.y[p], -filled.y[p][::-1])


def test_outlines_are_all_but_convex_and_counter_clockwise():
    """Where an axle is a centimetre from a corner, the flank narrows within it."""
    model = saloon((4.7, 0.2), (1.8, 0.05))
    for state in STATES:
        filled = outlines(model, state)
        for x, y in zip(filled.x, filled.y, strict=True):
            sides = np.stack([np.roll(x, -1) - x, np.roll(y, -1) - y], axis=1)
            after = np.roll(sides, -1, axis=0)
            assert (sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0] > -1e-3).all()


def test_a_sharp_brick_has_its_area_and_a_rounded_one_less():
    areas = []
    for radius in (0.0, 0.4):
        filled = outlines(BodyModel((4.0, 0.0), (2.0, 0.0), (radius, radius)), np.zeros(VALUES))
        x, y = filled.x[0], filled.y[0]
        areas.append(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    assert areas[0] == pytest.approx(8.0)
    # Four corners of three facets each in place of squares.
    facets = 6 * np.sin(np.radians(30.0))
    assert areas[1] == pytest.approx(8.0 - 0.4**2 * (4.0 - facets))
