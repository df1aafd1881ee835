"""Every registered camera detector and fusion: the contract of its kind."""

import pytest

from roadscope import CAMERA_DETECTORS, FUSIONS
from roadscope.testing import contract_items

ITEMS = [
    item
    for registry in (CAMERA_DETECTORS, FUSIONS)
    for name in registry.installed()
    for item in contract_items(name)
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("item", ITEMS, ids=str)
def test_contract(item):
    item.verify()
