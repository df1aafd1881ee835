"""All hostile acts, with two workers and with one."""

from tests.torture.entries import EntryTests


class TestTwoWorkers(EntryTests):
    jobs = 2


class TestOneWorker(EntryTests):
    jobs = 1
