"""The quick set of hostile acts, with one worker and with two."""

from tests.torture.entries import EntryTests


class TestOneWorker(EntryTests):
    jobs = 1


class TestTwoWorkers(EntryTests):
    jobs = 2
