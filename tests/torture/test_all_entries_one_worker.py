"""All hostile acts on all boards that they are for, with one worker."""

import pytest

from tests.torture.entries import EntryTests


@pytest.mark.slow
class TestOneWorker(EntryTests):
    jobs, quick = 1, False
