"""All hostile acts, with one worker."""

from tests.torture.entries import EntryTests


class TestOneWorker(EntryTests):
    jobs = 1
