"""Checks of constructor arguments."""

from __future__ import annotations

import numpy as np


def check_positive(**values: float) -> None:
    """Raise `ValueError` naming the first value that is not positive and finite."""
    for name, value in values.items():
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive and finite, got {value!r}")


def check_positive_or_infinite(**values: float) -> None:
    """Raise `ValueError` naming the first value that is not above 0."""
    for name, value in values.items():
        if not value > 0:
            raise ValueError(f"{name} must be positive, got {value!r}")


def check_not_negative(**values: float) -> None:
    """Raise `ValueError` naming the first value that is below 0 or not finite."""
    for name, value in values.items():
        if not 0 <= value < np.inf:
            raise ValueError(f"{name} must be 0 or more and finite, got {value!r}")


def check_counts(least: int, **values: int) -> None:
    """Raise `ValueError` naming the first value that is not an integer from `least` on."""
    for name, value in values.items():
        if not isinstance(value, int | np.integer) or value < least:
            raise ValueError(f"{name} must be a whole number from {least} up, got {value!r}")


def check_shares(**values: float) -> None:
    """Raise `ValueError` naming the first value that is not between 0 and 1."""
    for name, value in values.items():
        if not 0 <= value <= 1:
            raise ValueError(f"{name} must lie in 0 to 1, got {value!r}")
