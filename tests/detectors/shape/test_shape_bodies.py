import numpy as np
import pytest

from roadscope.core import Category
from roadscope.detectors.shape import BODIES, body_table


def test_shares_are_a_distribution():
    assert sum(body.share for body in BODIES) == pytest.approx(1.0, abs=1e-12)
    assert all(body.share > 0 for body in BODIES)


def test_every_category_has_a_body():
    assert {body.category for body in BODIES} == set(Category)


def test_table_has_logs_of_shares_and_all_sizes():
    table = body_table()
    assert table.means.shape == table.spreads.shape == (len(BODIES), 3)
    assert np.exp(table.log_shares).sum() == pytest.approx(1.0)
    for body, means, spreads in zip(BODIES, table.means, table.spreads, strict=True):
        sizes = (body.length, body.width, body.height)
        assert list(zip(means, spreads, strict=True)) == list(sizes)
