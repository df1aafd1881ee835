"""All hostile acts, with two workers."""

from tests.torture.entries import EntryTests


class TestTwoWorkers(EntryTests):
    jobs = 2
