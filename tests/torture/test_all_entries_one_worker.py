"""All hostile acts on all boards that they are for, with one worker."""

from tests.torture.entries import EntryTests


class TestOneWorker(EntryTests):
    jobs = 1
