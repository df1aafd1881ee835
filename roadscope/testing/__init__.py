"""The contract of plug-ins: what every plug-in of a kind promises.

`roadscope check SPEC` and `check` go through all promises of a plug-in and report each. In a test
suite of your own, with pytest:

    import pytest
    from roadscope.testing import contract_items

    @pytest.mark.parametrize("item", contract_items("my_tracker.py:MyTracker"), ids=str)
    def test_contract(item):
        item.verify()

The tests of roadscope do the same with every registered name. A class that is not part of
roadscope runs in a process of its own.
"""

from roadscope.testing.contract import ContractItem, Item, Report, check, contract_items
from roadscope.testing.subject import PromiseError

__all__ = ["ContractItem", "Item", "PromiseError", "Report", "check", "contract_items"]
