"""The type of functions that show the progress of a run."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with the stage (`traffic`, `tracking board`), steps done and steps in all."""


def silent(stage: str, done: int, total: int) -> None:
    """Show nothing."""
