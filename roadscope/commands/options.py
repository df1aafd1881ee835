"""Options that several commands have."""

from __future__ import annotations

from typing import Annotated

import typer

Jobs = Annotated[int, typer.Option(min=0, help="Worker processes; 0: one for each core.")]


def workers(jobs: int) -> int:
    """Return how many processes are meant: 0 stands for one on each core."""
    from joblib import cpu_count

    return jobs or int(cpu_count())
