"""The folders in which the machine code of kernels is kept; Numba is not loaded to find them."""

from __future__ import annotations

import os
from pathlib import Path

PACKAGE_FOLDER = Path(__file__).parents[1]
"""The folder of this package."""


def user_folder() -> Path:
    """Return the folder for machine code that cannot be kept beside the sources."""
    from platformdirs import user_cache_path

    return user_cache_path("roadscope", appauthor=False) / "kernels"


def kernel_folders() -> tuple[Path, ...]:
    """Return the folders below which machine code may be kept; the first writable one is used.

    If `NUMBA_CACHE_DIR` names a folder, it is that one alone. Otherwise it is `__pycache__` beside
    the sources, then `kernels` in the user's cache folder of roadscope.
    """
    named = os.environ.get("NUMBA_CACHE_DIR")
    return (Path(named),) if named else (PACKAGE_FOLDER, user_folder())


def nothing_is_compiled() -> bool:
    """Return whether no machine code is kept yet, though functions are compiled when called."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") == "0" and count_kernels() == 0


def count_kernels() -> int:
    """Return how many pieces of machine code are kept."""
    return sum(1 for folder in kernel_folders() for _ in folder.rglob("*.nbc"))
