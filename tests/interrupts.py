"""Ctrl-C for processes that tests start."""

import signal


def heed_interrupts() -> None:
    """Undo what a shell does to its background jobs, tests among them: ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
