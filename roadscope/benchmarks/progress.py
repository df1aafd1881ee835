"""How a run tells what it is doing."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Told the stage (`traffic`, `detection`, `tracking`), steps done and steps in all."""


def silent(stage: str, done: int, total: int) -> None:
    """Tell nobody."""
