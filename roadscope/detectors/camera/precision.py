"""The number formats with which a network computes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from timeit import repeat
from typing import Any

AUTO = "auto"
PRECISIONS = (AUTO, "float32", "bfloat16")
TURNS = 5
"""Number of times that a convolution is timed; the first one warms up."""


@cache
def fastest(device: str) -> str:
    """Return the faster of `float32` and `bfloat16` on a device such as `cpu` or `cuda:0`.

    On a processor both are timed once, with a convolution of the network's size: some processors
    that know bfloat16 are slower with it.
    """
    if device.partition(":")[0] == "cuda":
        return "bfloat16"
    return min(("float32", "bfloat16"), key=_duration_s)


def _duration_s(precision: str) -> float:
    """Return how long a convolution takes on the processor."""
    import torch

    dtype = getattr(torch, precision)
    image = torch.ones(1, 64, 60, 80, dtype=dtype).to(memory_format=torch.channels_last)
    weights = torch.ones(64, 64, 3, 3, dtype=dtype)
    return min(repeat(lambda: torch.conv2d(image, weights), number=1, repeat=TURNS))


@contextmanager
def whole_float32() -> Iterator[None]:
    """Let a graphics card compute with all digits of float32: by default torch drops ten bits."""
    import torch

    cudnn: Any = torch.backends.cudnn
    convolutions = cudnn.conv
    before = convolutions.fp32_precision
    convolutions.fp32_precision = "ieee"
    try:
        yield
    finally:
        convolutions.fp32_precision = before
