"""All hostile acts on all boards that they are for, with two workers."""

from tests.torture.entries import EntryTests


class TestTwoWorkers(EntryTests):
    jobs = 2
