"""All hostile acts with two workers, and one of each kind with one."""

from tests.torture.entries import EntryTests


class TestTwoWorkers(EntryTests):
    jobs = 2


class TestOneWorker(EntryTests):
    jobs = 1
