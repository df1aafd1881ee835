"""Compilation of kernels lives in `roadscope.core.jit`."""

from roadscope.core.jit import compiled

__all__ = ["compiled"]
