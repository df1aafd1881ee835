"""Moving objects in a scan, from comparison with earlier ones."""

from roadscope.detectors.moving.extraction import Candidate, extract
from roadscope.detectors.moving.view import Memory

__all__ = ["Candidate", "Memory", "extract"]
