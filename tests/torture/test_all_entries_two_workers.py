"""All hostile acts on all boards that they are for, with two workers."""

import pytest

from tests.torture.entries import EntryTests


@pytest.mark.slow
class TestTwoWorkers(EntryTests):
    jobs, quick = 2, False
