"""Scores as pure functions over records of arrays."""

METRIC_VERSION = 4
"""Raised whenever a score's meaning changes; results of different versions are never mixed."""
