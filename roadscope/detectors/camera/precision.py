"""The number formats with which a network computes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from timeit import timeit
from typing import Any

AUTO = "auto"
PRECISIONS = (AUTO, "float32", "bfloat16")
TURNS = 5
"""Number of times that a convolution is timed; the first one warms up."""
LEAST_GAIN = 0.2
"""Share of the time that bfloat16 has to save; chosen by hand."""


@cache
def fastest(device: str) -> str:
    """Return the faster of `float32` and `bfloat16` on a device such as `cpu` or `cuda:0`.

    On a processor both are timed once, with a convolution of the network's size and one thread:
    some processors that know bfloat16 are slower with it. It has to save `LEAST_GAIN` of the time,
    so that all processes of a run choose the same.
    """
    if device.partition(":")[0] == "cuda":
        return "bfloat16"
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        turns = [(_duration_s("float32"), _duration_s("bfloat16")) for _ in range(TURNS)]
    finally:
        torch.set_num_threads(threads)
    whole_s, half_s = map(min, zip(*turns, strict=True))
    return "bfloat16" if half_s < (1.0 - LEAST_GAIN) * whole_s else "float32"


def _duration_s(precision: str) -> float:
    """Return how long a convolution takes on the processor."""
    import torch

    dtype = getattr(torch, precision)
    image = torch.ones(1, 64, 60, 80, dtype=dtype).to(memory_format=torch.channels_last)
    weights = torch.ones(64, 64, 3, 3, dtype=dtype)
    return timeit(lambda: torch.conv2d(image, weights), number=1)


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
