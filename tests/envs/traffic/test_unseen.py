"""Vehicles of shapes that nothing was taught."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from roadscope.core import Category
from roadscope.envs.traffic import MIXES, UNSEEN, record
from roadscope.envs.world import BY_SIZE, body_prisms

CASES = [(c, n, s) for c, models in UNSEEN.items() for n, s in models.items()]
MODELS = pytest.mark.parametrize(("category", "name", "size"), CASES)
USUAL = {size for mix in MIXES.values() for _, _, sizes in mix for size in sizes}


@pytest.mark.slow
@pytest.mark.parametrize("usual", ["motorway", "street"])
def test_only_the_bodies_differ_from_the_usual_traffic(usual: str) -> None:
    known, unseen = record(usual, 2, 1.0), record(f"unseen-{usual}", 2, 1.0)
    for field in fields(known):
        if field.name not in ("sizes", "road"):
            np.testing.assert_equal(getattr(known, field.name), getattr(unseen, field.name))
    strange = {size for models in UNSEEN.values() for size in models.values()}
    for row, category in enumerate(known.categories.tolist()):
        before, now = known.sizes[row], unseen.sizes[row]
        if row > 0 and Category(category) in UNSEEN:
            assert tuple(now) in strange
            assert (now[:2] <= before[:2]).all()
        else:
            assert (now == before).all()
    assert (known.sizes != unseen.sizes).any()
    assert (record(f"unseen-{usual}", 2, 1.0).sizes == unseen.sizes).all()


@MODELS
def test_no_mix_has_them_and_each_has_a_shape_of_its_own(category, name, size) -> None:
    assert size not in USUAL
    assert size in BY_SIZE
    unlike = np.array(size) + 0.001
    strange, usual = (
        body_prisms(category, np.array(s), np.random.default_rng(1)) for s in (size, unlike)
    )
    assert len(strange) != len(usual) or not np.allclose(strange.tops, usual.tops, atol=0.05)


@MODELS
def test_every_road_user_of_a_kind_can_be_replaced(category, name, size) -> None:
    for other in (
        s for mix in MIXES.values() for c, _, sizes in mix for s in sizes if c == category
    ):
        assert any(s[0] <= other[0] and s[1] <= other[1] for s in UNSEEN[category].values())
